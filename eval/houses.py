"""Check that generated houses can be played: ``python eval/houses.py --help``."""

from pacman_env.evaluation.checks.generated_levels import main

if __name__ == "__main__":
    raise SystemExit(main())
