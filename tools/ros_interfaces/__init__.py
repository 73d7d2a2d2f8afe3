"""Message types that robots have and ROS's wheels for pip have not: their definitions, and the tool that builds them.

``python -m tools.ros_interfaces.build`` builds what cannot be imported. On a robot, and wherever ROS comes from
the system's packages, these types are there already and nothing here is used. The definitions are the fields that
nav2_msgs, irobot_create_msgs and tf2_msgs have in ROS 2 Jazzy; no node reads them.
"""
