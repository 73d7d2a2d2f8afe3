"""The operator's page over a running game: what the page's server requires of a game, by ROS."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pacman_env.web.game import Game


def open_game(
    namespace: str = "robot_15", domain: int | None = None, sim: bool = False, map: str | None = None
) -> Game:
    """The game in a robot's namespace, running or not yet; ``sim``: of a simulated robot, on this machine alone.

    ``domain`` is the ROS_DOMAIN_ID, None: that of the environment; ``map`` the game's, a file or a shipped one's name,
    for the readiness list to compare with the robot's. Raises ValueError for one of them that does not exist.
    """
    from pacman_env.ros.discovery import join
    from pacman_env.ros.operator_page.ros_game import RosGame
    from pacman_env.ros.supervisor.game_nodes import full_namespace

    return RosGame(full_namespace(namespace), join(domain, this_machine=sim), sim, map)
