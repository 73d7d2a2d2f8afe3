"""What a policy sees of a game: situations, features, pictures, predictions."""
