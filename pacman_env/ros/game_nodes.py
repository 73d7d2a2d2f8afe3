"""The processes of a game in the order of their start, and their parameters.

Used by ``pacman-env ros up``, ``launch/game.launch.py`` and ``setup.py``; does not import ROS."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Collection
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pacman_env.config import Config

NAMESPACE = "robot_15"  # the experiment's robot
SIMULATOR = "sim_robot"
WATCHER = "watcher"  # halts the robot if the game dies
GAME = "pacman_game"  # the process with referee, pellets, ghosts, goal selector and the listeners
LISTENERS = ("game_event_mapper", "game_light_node", "audio_node")
SELECTOR = "goal_selector"  # a process only in a foreign game
ORIGINAL_SELECTOR = "planner_stub"  # the corresponding node of the experiment's software
ORIGINAL_REFEREE = "game_controller"
#: Nodes of the experiment's software that are not started here; they have no namespace.
ORIGINALS = (ORIGINAL_SELECTOR, ORIGINAL_REFEREE, "pellet_manager", "clyde_ghost_node")
SHADOW = "shadow"  # a goal selector that sends nothing
POLICY = "policy"  # the child process of the game that runs the policies
NAV2 = "nav2"  # a real Nav2 for the simulated base; not a node of the game
NAV2_BRINGUP, NAV2_BY_HAND = "bringup", "none"  # values of ``nav2``: Nav2's launch file; start by hand
PAGE = "operator_page"  # optional; not a node of the game

#: Who sends goals: our goal selector; a foreign one, which is not started here; no process.
SELECTORS = OURS, ORIGINAL, _NONE = ("ours", "original", "none")

#: Modules of nodes by the name of their executable.
MODULES = {
    SIMULATOR: "pacman_env.ros.simulated_robot.sim_robot",
    WATCHER: "pacman_env.ros.supervisor.watcher",
    GAME: "pacman_env.ros.pacman_game.pacman_game",
    SELECTOR: "pacman_env.ros.selector.goal_selector_node",
    **{name: f"pacman_env.ros.nodes.{name}" for name in (*LISTENERS, "wait_for_amcl_pose")},
}
#: Topics of a goal selector, which a shadow publishes under its own name.
_OF_SELECTOR = ("scores", "why", "candidates", "diagnostics", "continue")

QUIET = ("--disable-external-lib-logs",)  # a node's output is stored once, by the process that started it

Value = str | bool | int | float | list[str] | list[float]


@dataclass(frozen=True)
class GameSetup:
    map: str
    policy: str = "ppo"
    namespace: str = NAMESPACE
    sim: bool = False
    speed: float = 1.0  # speed of the simulated robot's clock
    preset: str = "robot"
    execution: str = "robust"
    settings: tuple[str, ...] = ()  # name=value
    home: tuple[float, float, float] | None = None  # x, y, heading, m and rad; None: the robot's pose in the menu
    extra: dict[str, dict[str, Value]] = field(default_factory=dict)  # by process: more parameters
    params_file: str = ""  # ROS parameters in YAML (config/game.yaml); the other fields have priority
    selector: str = OURS  # one of ``SELECTORS``
    shadow: str = ""  # policy of a goal selector that decides and logs but sends nothing
    web: int | None = None  # the operator's page on this port of this machine
    nav2: str = ""  # Nav2 of the simulated base: NAV2_BRINGUP, NAV2_BY_HAND or a command; "": simulated

    def __post_init__(self) -> None:
        if not 1.0 <= self.speed <= 10.0:
            raise ValueError(f"speed {self.speed:g}: must be 1 to 10")
        if self.speed != 1.0 and not self.sim:
            raise ValueError(f"speed {self.speed:g}: only a simulated robot (--sim) can be faster than real time")
        if self.nav2 and not self.sim:
            raise ValueError(
                "nav2: only with a simulated robot (--sim); a real one has its own (docs/robot/first_game.md, step 5)"
            )
        if self.starts_nav2 and self.speed != 1.0:
            raise ValueError(f"speed {self.speed:g}: must be 1 with nav2, whose loops run in real time")
        if self.selector not in SELECTORS:
            raise ValueError(f"selector {self.selector!r}: must be one of {', '.join(SELECTORS)}")
        if self.home is not None and not all(map(math.isfinite, self.home)):
            raise ValueError(f"home {self.home}: must be three finite numbers, x, y (m) and heading (rad)")
        full_namespace(self.namespace)
        self.config()

    def config(self) -> Config:
        from pacman_env.config import make_config, parse_settings

        return make_config(self.preset, self.execution, **parse_settings(self.settings))

    @property
    def starts_nav2(self) -> bool:
        return self.nav2 not in ("", NAV2_BY_HAND)

    @property
    def processes(self) -> tuple[str, ...]:
        """Names of the processes in the order of their start; the nodes among them have the same names."""
        optional = {
            SIMULATOR: self.sim,
            NAV2: self.starts_nav2,
            SHADOW: bool(self.shadow),
            PAGE: self.web is not None,
        }
        return tuple(name for name in (SIMULATOR, NAV2, WATCHER, GAME, SHADOW, PAGE) if optional.get(name, True))

    def parameters(self, name: str) -> dict[str, Value]:
        """Return the parameters with which a process is started; its other parameters have their defaults."""
        if name == WATCHER:
            return {}
        parameters: dict[str, Value] = {"map_yaml": self.map}
        if self.home is not None:
            parameters["home"] = ",".join(map(repr, self.home)) if name == SIMULATOR else list(self.home)
        if name == GAME:
            parameters |= {"policy": self.policy, "selector": self.selector}
        elif name == SELECTOR:
            parameters["policy"] = self.policy
        elif name == SHADOW:
            parameters |= {"policy": self.shadow, "shadow": True}
        elif name == SIMULATOR:
            parameters["speed"] = self.speed
            parameters |= dict.fromkeys(("navigation", "localization", "map_out"), False) if self.nav2 else {}
        standard = {"preset": "robot", "execution": "robust", "settings": []}  # ROS cannot pass empty lists
        rules: dict[str, Value] = {"preset": self.preset, "execution": self.execution, "settings": list(self.settings)}
        parameters |= {rule: value for rule, value in rules.items() if value != standard[rule]}
        if self.sim:
            parameters["use_sim_time"] = True
        return parameters | self.extra.get(name, {})

    def remappings(self, name: str) -> list[tuple[str, str]]:
        """Return the names of a process's topics that differ from the usual ones."""
        return [(f"{SELECTOR}/{one}", f"{SHADOW}/{one}") for one in _OF_SELECTOR] if name == SHADOW else []

    def command(self, name: str) -> list[str]:
        """Return module and arguments that start a process, after ``python -m``."""
        if name == PAGE:
            words = ["pacman_env.cli.main", "web", "--ros", "--namespace", self.namespace, "--map", self.map]
            return [*words, "--port", str(self.web), *(["--sim"] if self.sim else [])]
        words = [module_of(name), "--ros-args", *QUIET, "-r", f"__ns:={full_namespace(self.namespace)}"]
        if name == SHADOW:
            words += ["-r", f"__node:={SHADOW}"]
        for old, new in self.remappings(name):
            words += ["-r", f"{old}:={new}"]
        if self.params_file:
            words += ["--params-file", self.params_file]
        for parameter, value in self.parameters(name).items():
            words += ["-p", f"{parameter}:={json.dumps(value, ensure_ascii=False)}"]  # quoted: a map may be named 1e3
        return words


def needed_nodes(sim: bool, originals: Collection[str], selector: str = OURS) -> list[str]:
    """Return the nodes that a game needs, given the discovered nodes of the original game and who sends goals."""
    if ORIGINAL_REFEREE not in originals:
        nodes = [GAME, *LISTENERS, *([ORIGINAL_SELECTOR] if selector == ORIGINAL else [])]
    else:
        nodes = [] if ORIGINAL_SELECTOR in originals else [SELECTOR]
    return [*([SIMULATOR] if sim else []), *nodes]


def executable(name: str) -> str:
    """Return the name of the executable of a process."""
    return SELECTOR if name == SHADOW else name


def module_of(name: str) -> str:
    return MODULES[executable(name)]


def full_namespace(name: str) -> str:
    """Convert ``robot_15`` to ROS's form ``/robot_15``; "" is the root."""
    bare = name.strip("/")
    if bare and not re.fullmatch(r"[A-Za-z_]\w*(/[A-Za-z_]\w*)*", bare, re.ASCII):
        raise ValueError(f"namespace {name!r}: letters, digits and _, not beginning with a digit, / between parts")
    return f"/{bare}"
