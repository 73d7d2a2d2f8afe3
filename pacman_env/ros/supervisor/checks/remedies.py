"""Commands that several checks give as remedies."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .check import Observations

FIREWALL = "sudo ufw allow proto udp from 192.168.0.0/16"
RESTART = "sudo systemctl restart turtlebot4"


def up(robot: Observations) -> str:
    """The command that starts the game."""
    sim = " --sim" if robot.virtual else ""
    where = robot.namespace.strip("/") or "/"
    return f"pacman-env ros up --map {robot.map_file or 'FILE_OR_NAME'} --namespace {where}{sim}"


def localize(robot: Observations) -> str:
    """The command that starts localization on the game's map."""
    file = robot.map_file or "$PWD/home.yaml"
    return _launch(robot, "localization", f"map:={file if file.endswith('.yaml') else f'$PWD/maps/{file}.yaml'}")


def nav2(robot: Observations) -> str:
    """The command that starts Nav2 with the game's configuration."""
    return _launch(robot, "nav2", "params_file:=$PWD/config/nav2.yaml")


def patience(robot: Observations, topic: str) -> tuple[str, str]:
    """Remedy and command where a topic that may be published rarely was not received."""
    if topic in robot.unavailable:
        build = "python -m tools.ros_interfaces.build"
        return "source /opt/ros/jazzy/setup.bash; without a ROS installation", build
    return "some bases publish it rarely: listen for longer, --wait 60", ""


def other_domain(domain: int) -> int:
    """A domain that is not this one."""
    return domain + 1 if domain < 101 else 1


def _launch(robot: Observations, file: str, more: str) -> str:
    namespace = f" namespace:={robot.namespace}" if robot.namespace != "/" else ""
    return f"ros2 launch turtlebot4_navigation {file}.launch.py{namespace} {more}"
