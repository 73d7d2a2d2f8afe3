"""Which nodes make up a game, in the order in which they start and stop, and their parameters.

Read by the command that starts them (``up.py``) and by ``launch/game.launch.py``; imports nothing of ROS.
"""

from __future__ import annotations

import json
import re
from dataclasses import dataclass, field

NAMESPACE = "robot_15"  # the experiment's robot
SIMULATOR = "sim_robot"
WAIT = "wait_for_amcl_pose"
SELECTOR = "goal_selector"
REFEREE = "game_controller"
#: Those that only listen and answer, in the order of their start.
GAME = (
    "pellet_manager",
    "audio_node",
    "game_light_node",
    "clyde_ghost_node",
    "game_event_mapper",
    REFEREE,
)
#: All that can be started, in order: the robot where it is simulated, the game, then who needs a pose.
NODES = (SIMULATOR, *GAME, WAIT, SELECTOR)
_FOLDERS = {SIMULATOR: "simulated_robot", SELECTOR: "selector"}  # all others are in ``nodes``
#: What moves the robot stops first, then the lights: the others may take their time.
STOP_ORDER = (SELECTOR, "game_event_mapper", "game_light_node", "audio_node", REFEREE)

QUIET = ("--disable-external-lib-logs",)  # what a node says is kept once, by who started it

Value = str | bool | int | float


@dataclass(frozen=True)
class Game:
    """One game on one robot, as the nodes need to know it."""

    map: str
    policy: str = "ppo"
    namespace: str = NAMESPACE
    sim: bool = False
    speed: float = 1.0  # of the simulated robot's clock
    extra: dict[str, dict[str, Value]] = field(default_factory=dict)  # by node: further parameters

    def __post_init__(self) -> None:
        if not 1.0 <= self.speed <= 10.0:
            raise ValueError(f"speed {self.speed:g}: must be 1 to 10")
        if self.speed != 1.0 and not self.sim:
            raise ValueError(f"speed {self.speed:g}: only a simulated robot (--sim) can be faster than time")
        full_namespace(self.namespace)

    def parameters(self, node: str) -> dict[str, Value]:
        """The parameters that ``node`` is started with; all others have their defaults."""
        own: dict[str, dict[str, Value]] = {
            SIMULATOR: {"map_yaml": self.map, "speed": self.speed},
            "pellet_manager": {"map_yaml": self.map},
            "clyde_ghost_node": {"map_yaml": self.map},
            SELECTOR: {"map_yaml": self.map, "policy": self.policy},
        }
        clock: dict[str, Value] = {"use_sim_time": True} if self.sim else {}
        return {**own.get(node, {}), **clock, **self.extra.get(node, {})}

    def arguments(self, node: str) -> list[str]:
        """What follows the module on the command line of ``node``."""
        words = ["--ros-args", *QUIET, "-r", f"__ns:={full_namespace(self.namespace)}"]
        for name, value in self.parameters(node).items():
            words += ["-p", f"{name}:={json.dumps(value, ensure_ascii=False)}"]  # quoted: a map may be called 1e3
        return words


def module_of(node: str) -> str:
    """The module that ``python -m`` runs as that node."""
    return f"pacman_env.ros.{_FOLDERS.get(node, 'nodes')}.{node}"


def full_namespace(name: str) -> str:
    """``robot_15`` as ROS wants it, ``/robot_15``; "" is the root.

    Raises:
        ValueError: no namespace.
    """
    bare = name.strip("/")
    if bare and not re.fullmatch(r"[A-Za-z_]\w*(/[A-Za-z_]\w*)*", bare, re.ASCII):
        raise ValueError(f"namespace {name!r}: letters, digits and _, not beginning with a digit, / between parts")
    return f"/{bare}"
