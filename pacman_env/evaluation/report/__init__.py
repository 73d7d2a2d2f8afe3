"""The page that explains a comparison: ``pacman-env report``."""
