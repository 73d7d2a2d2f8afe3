"""What colcon needs beyond pyproject.toml to make this checkout an ament_python package.

Ubuntu 24.04's setuptools (68) does not know a licence that is a plain string in pyproject.toml, and colcon cannot read
``requires-python`` there: so both are here.
"""

import sys
from pathlib import Path

from setuptools import setup

NAME = "pacman_env"
#: The nodes as commands of `ros2 run`; tests/ros/test_launch.py holds this list to the package's.
NODES = (
    "simulated_robot.sim_robot",
    "nodes.pellet_manager",
    "nodes.audio_node",
    "nodes.game_light_node",
    "nodes.clyde_ghost_node",
    "nodes.game_event_mapper",
    "nodes.game_controller",
    "nodes.wait_for_amcl_pose",
    "selector.goal_selector",
)
SHARED = ("launch/*.py", "config/*", "maps/*.yaml", "maps/*.pgm")

commands = [f"pacman-env = {NAME}.cli.main:main"]
data_files = []
if not {"bdist_wheel", "dist_info", "editable_wheel"} & set(sys.argv):  # pip's way: no ten commands on a user's path
    commands += [f"{node.partition('.')[2]} = {NAME}.ros.{node}:main" for node in NODES]
    data_files = [
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        *((f"share/{NAME}/{path.parent}", [str(path)]) for pattern in SHARED for path in sorted(Path().glob(pattern))),
    ]

setup(license="MIT", python_requires=">=3.11", entry_points={"console_scripts": commands}, data_files=data_files)
