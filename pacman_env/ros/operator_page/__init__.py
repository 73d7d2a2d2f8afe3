"""The operator's page over a running game: what the page's server requires of a game, by ROS."""
