"""The world without a game: occupancy maps, path lengths, physics, navigator, localization and lidar."""
