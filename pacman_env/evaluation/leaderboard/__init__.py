"""The league table of policies: ``pacman-env leaderboard``."""
