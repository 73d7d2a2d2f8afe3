"""Training of planners. Run from the checkout: ``python -m train.ppo``."""
