"""The policy ``rollouts`` and the games that it plays."""
