"""Simulate a robot on a map: path lengths, physics, a simulated Nav2, localization and lidar."""
