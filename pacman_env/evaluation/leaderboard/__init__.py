"""League table of policies: ``pacman-env leaderboard``."""
