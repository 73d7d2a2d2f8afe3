"""Run the same training from several seeds: ``python train/seeds.py --help``."""

from pacman_env.training.seeds import main

if __name__ == "__main__":
    raise SystemExit(main())
