"""Train a planner: ``python train/ppo.py --help``."""

from pacman_env.training.ppo import main

if __name__ == "__main__":
    raise SystemExit(main())
