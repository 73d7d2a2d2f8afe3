"""Search for hyperparameters: ``python train/tune.py --help``."""

from pacman_env.training.tune import main

if __name__ == "__main__":
    raise SystemExit(main())
