"""Train a planner and a Clyde against each other: ``python train/adversary.py --help``."""

from pacman_env.training.adversary import main

if __name__ == "__main__":
    raise SystemExit(main())
