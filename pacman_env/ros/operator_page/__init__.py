"""The operator's page for a running game: the game interface of the page's server, over ROS."""
