"""Draw games as images, and show them in a window."""
