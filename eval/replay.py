"""Replay one round as a film: ``python eval/replay.py --help``."""

from pacman_env.evaluation.replay import main

if __name__ == "__main__":
    raise SystemExit(main())
