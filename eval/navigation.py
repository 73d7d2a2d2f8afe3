"""Measure how well the Nav2 stand-in drives: ``python eval/navigation.py --help``."""

from pacman_env.evaluation.checks.navigator_accuracy import main

if __name__ == "__main__":
    raise SystemExit(main())
