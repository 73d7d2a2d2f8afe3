"""A preset: fields of the configuration by their dotted names."""

SLEEPY = {"robot.speed_mps": 0.2, "clyde.speed_mps": 0.1, "clyde.spawn_distance_m": 3.0}
