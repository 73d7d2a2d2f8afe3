"""Rules of the game without clock, I/O, physics or ROS: pellets, Clyde, rounds, events, shows.

The same code serves the simulator, in simulated time, and the robot's nodes, in wall time.
"""
