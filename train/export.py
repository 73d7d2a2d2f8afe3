"""Write a trained planner as an ONNX file: ``python train/export.py --help``."""

from pacman_env.training.export import main

if __name__ == "__main__":
    raise SystemExit(main())
