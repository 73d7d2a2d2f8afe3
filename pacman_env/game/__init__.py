"""The rules of the game, once, without clock, I/O, physics or ROS: pellets, Clyde, rounds, events, shows.

The simulator calls them in simulated time and the robot's nodes in wall time; nothing here knows which.
"""
