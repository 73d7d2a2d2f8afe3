"""The processes of a game in the order of their start, their parameters, and what follows when a process ends.

Used by ``pacman-env ros up``, ``launch/game.launch.py`` and ``setup.py``; does not import ROS."""

from __future__ import annotations

import json
import math
import re
from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pacman_env.config import Config

NAMESPACE = "robot_15"  # the experiment's robot
SIMULATOR = "sim_robot"
WAIT = "wait_for_amcl_pose"
SELECTOR = "goal_selector"
ORIGINAL_SELECTOR = "planner_stub"  # the corresponding node of the experiment's software
REFEREE = "game_controller"
LOCK_STEP = "lock_step_game"  # the process that hosts all nodes of a lock-step game
COMPOSED = "composed_nodes"  # the process that hosts the nodes of GAME
NAV2 = "nav2"  # a real Nav2 for the simulated base; not a node of the game
NAV2_BRINGUP, NAV2_BY_HAND = "bringup", "none"  # values of ``nav2``: Nav2's launch file; start by hand
PAGE = "operator_page"  # optional; not a node of the game

#: What follows the end of a process. RESTARTED: a restart. SPARE: a restart, or none if restarts do not help.
#: FIRST_STEP: the start of the next process, if the exit status is 0. FINAL: the end of the game.
RESTARTED, SPARE, FIRST_STEP, FINAL = "restarted", "spare", "first step", "final"


@dataclass(frozen=True)
class GameProcess:
    name: str
    folder: str = "nodes"  # folder of its module, in pacman_env/ros
    parameters: tuple[str, ...] = ()  # from the setup, in addition to the configuration of every node
    configured: bool = True
    end: str = RESTARTED
    after: str = ""  # the process whose success starts it


PROCESSES = {
    process.name: process
    for process in (
        GameProcess(SIMULATOR, "simulated_robot", ("map_yaml", "speed", "home")),
        GameProcess(NAV2, configured=False),
        GameProcess("pellet_manager", parameters=("map_yaml",)),
        GameProcess("audio_node"),
        GameProcess("game_light_node"),
        GameProcess("clyde_ghost_node", parameters=("map_yaml",)),
        GameProcess("game_event_mapper"),
        GameProcess(REFEREE),
        GameProcess(WAIT, configured=False, end=FIRST_STEP),
        GameProcess(SELECTOR, "selector", ("map_yaml", "policy", "home"), after=WAIT),
        GameProcess(PAGE, "operator_page", end=SPARE),
        GameProcess(LOCK_STEP, "lock_step", end=FINAL),
        GameProcess(COMPOSED),
    )
}
#: Processes that are nodes, in order: the simulated robot, the game, the wait for a pose, the goal selector.
NODES = tuple(name for name in PROCESSES if name not in (NAV2, PAGE, LOCK_STEP, COMPOSED))
#: Nodes that only subscribe, publish and respond.
GAME = tuple(name for name in NODES if name not in (SIMULATOR, WAIT, SELECTOR))
#: Processes that move the robot and therefore stop first.
MOVERS = (SELECTOR, COMPOSED, "game_event_mapper")
#: Nodes that stop first in lock-step. Separate processes stop together, except the movers and the simulated robot.
STOP_ORDER = (*MOVERS, "game_light_node", PAGE, "audio_node", REFEREE)

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
    extra: dict[str, dict[str, Value]] = field(default_factory=dict)  # by node: more parameters
    web: int | None = None  # the operator's page on this port of this machine
    lock_step: bool = False  # all nodes in one process; simulated time waits for them
    seed: int = 0  # random seed of a lock-step game
    composed: bool = False  # the nodes of GAME in one process
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
        if self.nav2 and self.lock_step:
            raise ValueError("nav2: must not be combined with lock-step, for which a real Nav2 does not wait")
        if self.lock_step and not self.sim:
            raise ValueError("lock-step: only with a simulated robot (--sim)")
        if self.lock_step and self.speed != 1.0:
            raise ValueError(f"speed {self.speed:g}: a lock-step game is as fast as its nodes")
        if self.composed and self.lock_step:
            raise ValueError("composed: a lock-step game is one process anyway")
        if self.home is not None and not all(map(math.isfinite, self.home)):
            raise ValueError(f"home {self.home}: must be three finite numbers, x, y (m) and heading (rad)")
        full_namespace(self.namespace)
        self.config()

    def config(self) -> Config:
        from pacman_env.config import make_config, parse_settings

        return make_config(self.preset, self.execution, **parse_settings(self.settings))

    @property
    def first_nodes(self) -> tuple[str, ...]:
        return tuple(name for name in NODES if not PROCESSES[name].after and (self.sim or name != SIMULATOR))

    @property
    def starts_nav2(self) -> bool:
        return self.nav2 not in ("", NAV2_BY_HAND)

    @property
    def first_processes(self) -> tuple[str, ...]:
        nodes = (LOCK_STEP,) if self.lock_step else self.first_nodes
        if self.starts_nav2:
            nodes = (nodes[0], NAV2, *nodes[1:])
        if self.composed:
            nodes = tuple(dict.fromkeys(COMPOSED if name in GAME else name for name in nodes))
        return nodes if self.web is None else (*nodes, PAGE)

    def parameters(self, node: str) -> dict[str, Value]:
        """Return the parameters with which ``node`` is started; its other parameters have their defaults."""
        process, home = PROCESSES[node], self.home
        values: dict[str, Value] = {"map_yaml": self.map, "policy": self.policy, "speed": self.speed}
        if home is not None:
            values["home"] = ",".join(map(repr, home)) if node == SIMULATOR else list(home)
        parameters = {name: values[name] for name in process.parameters if name in values}
        if process.configured:
            configuration: dict[str, Value] = {"preset": self.preset, "execution": self.execution}
            configuration["settings"] = list(self.settings)
            standard = {"preset": "robot", "execution": "robust", "settings": []}  # ROS cannot pass empty lists
            parameters |= {name: value for name, value in configuration.items() if value != standard[name]}
        if self.sim:
            parameters["use_sim_time"] = True
        if self.nav2 and node == SIMULATOR:
            parameters |= dict.fromkeys(("navigation", "localization", "map_out"), False)
        return parameters | self.extra.get(node, {})

    def as_json(self) -> str:
        """Encode all fields for a process with several nodes (:func:`from_json`)."""
        return json.dumps(asdict(self), ensure_ascii=False)

    def command(self, node: str) -> list[str]:
        """Return module and arguments that start ``node``, or the page, after ``python -m``."""
        if node == PAGE:
            words = ["pacman_env.ros.operator_page", "--namespace", self.namespace, "--map", self.map]
            return [*words, "--port", str(self.web), *(["--sim"] if self.sim else [])]
        if node == LOCK_STEP:
            return ["pacman_env.ros.lock_step", self.as_json()]
        if node == COMPOSED:
            return ["pacman_env.ros.composed", self.as_json()]
        words = [module_of(node), "--ros-args", *QUIET, "-r", f"__ns:={full_namespace(self.namespace)}"]
        for name, value in self.parameters(node).items():
            words += ["-p", f"{name}:={json.dumps(value, ensure_ascii=False)}"]  # quoted: a map's name may be 1e3
        return words


def module_of(node: str) -> str:
    return f"pacman_env.ros.{PROCESSES[node].folder}.{node}"


def following(name: str) -> list[str]:
    return [process.name for process in PROCESSES.values() if process.after == name]


def from_json(text: str) -> GameSetup:
    try:
        fields = json.loads(text)
        home = fields["home"]
        fields |= {"settings": tuple(fields["settings"]), "home": None if home is None else tuple(home)}
        return GameSetup(**fields)
    except (TypeError, LookupError) as error:
        raise ValueError(f"no setup of a game: {error}") from None


def full_namespace(name: str) -> str:
    """Convert ``robot_15`` to ROS's form ``/robot_15``; "" is the root."""
    bare = name.strip("/")
    if bare and not re.fullmatch(r"[A-Za-z_]\w*(/[A-Za-z_]\w*)*", bare, re.ASCII):
        raise ValueError(f"namespace {name!r}: letters, digits and _, not beginning with a digit, / between parts")
    return f"/{bare}"
