"""What is there before any game: occupancy maps, path lengths, physics, navigator, localization and lidar."""
