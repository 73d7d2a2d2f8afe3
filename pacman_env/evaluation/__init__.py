"""Evaluation of policies: rounds, tables, reports, films, and checks of the simulator; ``eval/`` starts them."""
