"""Training of planners: networks, learners, opponents, and the commands that ``train/`` starts."""
