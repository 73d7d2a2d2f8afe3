"""Record games in ROS 2 bags, check the bags, and replay the games."""
