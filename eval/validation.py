"""Compare the simulator with the ten real trials: ``python eval/validation.py --help``."""

from pacman_env.evaluation.checks.validation import main

if __name__ == "__main__":
    raise SystemExit(main())
