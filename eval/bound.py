"""Bound the share of rounds that can be completed on a map: ``python eval/bound.py --help``."""

from pacman_env.evaluation.bound.__main__ import main

if __name__ == "__main__":
    raise SystemExit(main())
