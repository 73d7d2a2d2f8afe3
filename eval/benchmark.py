"""Measure how fast the environments are: ``python eval/benchmark.py --help``."""

from pacman_env.evaluation.benchmark import main

if __name__ == "__main__":
    raise SystemExit(main())
