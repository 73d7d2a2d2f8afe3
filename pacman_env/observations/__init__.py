"""Inputs of policies: situations, features, images and predictions."""
