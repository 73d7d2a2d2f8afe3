"""A robot in a map: path lengths, physics, the Nav2 stand-in, localization, lidar."""
