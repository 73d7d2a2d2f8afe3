"""The operator's page over a running game: what the page's server asks of a game, by ROS."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pacman_env.web.game import Game


def open_game(
    namespace: str = "robot_15", domain: int | None = None, sim: bool = False, map: str | None = None
) -> Game:
    """The game that is up in a robot's namespace, be it there yet or not.

    Args:
        namespace: of the robot, with or without its slash.
        domain: ROS_DOMAIN_ID; None: that of the environment.
        sim: a simulated robot, on this machine alone.
        map: the game's map, a file or a shipped one's name, for the readiness list to compare with the robot's.

    Raises:
        ValueError: a namespace, domain or map that there is not.
        ModuleNotFoundError: ROS is missing.
    """
    from pacman_env.ros.discovery import join
    from pacman_env.ros.operator_page.ros_game import RosGame
    from pacman_env.ros.supervisor.game_nodes import full_namespace

    return RosGame(full_namespace(namespace), join(domain, this_machine=sim), sim, map)
