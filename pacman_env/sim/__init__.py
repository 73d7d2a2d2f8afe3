"""The batch of games: world, rules and belief stepped together, and what a policy sees of them."""
