"""Write the league table of policies: ``python eval/leaderboard.py --help``."""

from pacman_env.evaluation.leaderboard.__main__ import main

if __name__ == "__main__":
    raise SystemExit(main())
