"""Compare policies in the same rounds: ``python eval/compare.py --help``."""

from pacman_env.evaluation.compare.__main__ import main

if __name__ == "__main__":
    raise SystemExit(main())
