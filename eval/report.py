"""Compare policies in the same rounds on an HTML page: ``python eval/report.py --help``."""

from pacman_env.evaluation.report.__main__ import main

if __name__ == "__main__":
    raise SystemExit(main())
