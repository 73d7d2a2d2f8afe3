"""Measure how fast stock learners learn: ``python train/learning_curves.py --help``."""

from pacman_env.training.learning_curves import main

if __name__ == "__main__":
    raise SystemExit(main())
