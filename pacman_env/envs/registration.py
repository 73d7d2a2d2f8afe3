"""Register the environments with Gymnasium and PettingZoo, whether these are imported before or after this package.

Importing this package loads neither, because the nodes on the robot and ``pacman-env --help`` do not need them.
Gymnasium has no entry points for plug-ins, and the standard library has no hook for the end of an import, so a finder
in ``sys.meta_path`` waits for it. Registering only if Gymnasium is imported already is not enough: a worker process may
load this package earlier, with a policy.
"""

import sys
from collections.abc import Callable
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec
from types import ModuleType
from typing import Any, NamedTuple


class Registered(NamedTuple):
    """An id with its arguments, for programs that only receive an id."""

    purpose: str  # one line for listings
    kwargs: dict[str, Any] = {}  # noqa: RUF012  # of the single-agent environment
    #: Arguments of the PettingZoo environment of the same name; None: not registered there.
    several: dict[str, Any] | None = {}  # noqa: RUF012
    solved: float | None = None  # Gymnasium's ``reward_threshold``: about 92 % of the rounds completed


ENV_ID = "pacman_env/PacManBot-v2"
#: The same game for stock learners: with ``flat=True``.
FLAT_ID = "pacman_env/PacManBotFlat-v2"
_GENERATED, _ENDLESS, _FOUR = {"map": "generated"}, {"defaults": {"endless": True}}, {"ghosts": ("policy",) * 4}
_ARCADE = {"preset": "arcade"}
#: Stock PPO learns to drive with these (train/hyperparameters/baselines.yaml).
_DRIVING = {
    "decisions.when": "tick",
    "observation.candidates": "all",
    "action_range": "unit",
    "reward.progress": 1.0,
}
#: Every id. Variants differ by name; docs/environments/ids.md says when the number counts up.
IDS = {
    ENV_ID: Registered("The robot's game on one map: every 0.5 s the agent chooses the goal to drive to", solved=15.5),
    "pacman_env/PacManBotGenerated-v2": Registered(
        "The robot's game, in a new generated house for every episode", _GENERATED, _GENERATED, 10.0
    ),
    "pacman_env/PacManBotEndless-v2": Registered(
        "The robot's game without end: after a completed round the next one follows, with a faster Clyde",
        _ENDLESS,
        _ENDLESS,
    ),
    "pacman_env/PacManBotVelocity-v2": Registered(
        "The agent drives the robot itself: v in m/s and omega in rad/s, without a navigator",
        {"action": "velocity"},
        {"action": "velocity"},
    ),
    "pacman_env/PacManBotGhosts-v2": Registered(
        "Four ghosts that approach the robot and turn to their corners when near, like Clyde in the arcade game",
        {"ghosts": ("arcade",) * 4},
        _FOUR,
    ),
    FLAT_ID: Registered(
        "For stock learners: seven actions, one array in [-1, 1], and a decision after each event",
        {"flat": True},
        {"flat": True},
        15.5,
    ),
    "pacman_env/PacManBotFlatGenerated-v2": Registered(
        "For stock learners, in a new generated house for every episode",
        {"flat": True, **_GENERATED},
        {"flat": True, **_GENERATED},
        10.0,
    ),
    "pacman_env/PacManBotFlatEndless-v2": Registered(
        "For stock learners, without end: Clyde is faster after each completed round",
        {"flat": True, **_ENDLESS},
        {"flat": True, **_ENDLESS},
    ),
    "pacman_env/PacManBotFlatVelocity-v2": Registered(
        "For stock learners that drive: v and omega in [-1, 1] from one array of lidar ranges and bearings",
        {"flat": True, "action": "velocity", "observation": ("scan", "flat"), "defaults": _DRIVING},
        None,  # its agents would have spaces of different shapes
    ),
    "pacman_env/PacManBotFlatGhosts-v2": Registered(
        "For stock learners, with four ghosts that approach the robot like Clyde in the arcade game",
        {"flat": True, "ghosts": ("arcade",) * 4},
        {"flat": True, **_FOUR},
    ),
    "pacman_env/PacManBotArcade-v2": Registered(
        "Four power pellets and four ghosts of three kinds: a frightened ghost flees and can be caught",
        _ARCADE,
        {**_ARCADE, **_FOUR},
    ),
    "pacman_env/PacManBotFlatArcade-v2": Registered(
        "For stock learners, with power pellets and four ghosts of three kinds",
        {"flat": True, **_ARCADE},
        {"flat": True, **_ARCADE, **_FOUR},
    ),
}


def register_envs() -> None:
    """Register every id with Gymnasium (``gymnasium.pprint_registry()``); a second call changes nothing."""
    import gymnasium as gym

    for name, entry in IDS.items():
        if name not in gym.registry:
            gym.register(
                name,
                entry_point="pacman_env.envs.pacmanbot:PacManBotEnv",
                vector_entry_point="pacman_env.envs.pacmanbot_vector:PacManBotVectorEnv",
                kwargs=dict(entry.kwargs),
                reward_threshold=entry.solved,
            )


def register_parallel_envs() -> None:
    """Register the same names with PettingZoo; does nothing before PettingZoo 1.27, which has no registry."""
    import pettingzoo

    if not hasattr(pettingzoo, "register"):
        return
    for kind, registry in (("parallel", pettingzoo.parallel_registry), ("aec", pettingzoo.aec_registry)):
        entry_point = f"pacman_env:{'parallel_env' if kind == 'parallel' else 'env'}"
        for name, entry in IDS.items():
            if entry.several is not None and name not in registry:
                pettingzoo.register(kind, name, entry_point, kwargs=dict(entry.several))


def register_when_imported() -> None:
    """Register with each library now if it is imported, otherwise at the end of its import."""
    for name, register in (("gymnasium", register_envs), ("pettingzoo", register_parallel_envs)):
        if name in sys.modules:
            register()
        else:
            sys.meta_path.insert(0, _Finder(name, register))


class _Finder(MetaPathFinder):
    """Call ``then`` after ``module`` was imported; ``find_spec`` alone, without an import, does not call it."""

    def __init__(self, module: str, then: Callable[[], None]) -> None:
        self._module, self._then = module, then

    def find_spec(self, fullname: str, path: Any = None, target: ModuleType | None = None) -> ModuleSpec | None:
        if fullname != self._module:
            return None
        others = (finder for finder in sys.meta_path if finder is not self)
        spec = next((candidate for one in others if (candidate := one.find_spec(fullname, path, target))), None)
        if spec is not None and spec.loader is not None:
            load = spec.loader.exec_module

            def load_and_register(module: ModuleType) -> None:
                load(module)
                if self in sys.meta_path:
                    sys.meta_path.remove(self)
                self._then()

            spec.loader.exec_module = load_and_register  # type: ignore[method-assign]
        return spec
