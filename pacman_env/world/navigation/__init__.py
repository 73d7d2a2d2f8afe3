"""Simulate a robot on a map: path lengths, physics, a Nav2 stand-in, localization and lidar."""
