"""Compile kernels in advance, for an image or a new machine: ``pacman-env warm-up``.

The command plays small games that need the kernels. It creates an empty file in the cache for each finished part, which
a later call with the same compiler and processor skips.
"""

import hashlib
import itertools
import sys
import time
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

from pacman_env.command_line.command import whole_number

_STEPS = 12
_LONGEST = 10  # kernels that --verbose prints
_SHORT = {"time_limit_s": 4.0}  # short, so that rounds end and start
_EVENTFUL = {
    **_SHORT,
    "execution.pickup_radius_m": 30.0,  # rounds are complete at once, and the next ones start
    "nav2.abort_rate": 1.0,  # goals are aborted
    "randomize.speed_mps": (0.2, 0.3),
}


def add_warm_up(commands: Any) -> None:
    parser = commands.add_parser("warm-up", help="compile all kernels in advance (for images and new machines)")
    parser.add_argument("--robot", action="store_true", help="also compile kernels of the ROS nodes; needs no ROS")
    houses = "also prepare the first N training houses and the first N of the 200 test houses"
    parser.add_argument("--houses", type=whole_number(0), default=0, metavar="N", help=houses)
    parser.add_argument("--verbose", action="store_true", help="also print the kernels that took longest to compile")
    parser.set_defaults(run=lambda arguments: _report(arguments.robot, arguments.houses, arguments.verbose))


def _report(robot: bool, houses: int, verbose: bool) -> int:
    from numba.core.event import install_recorder

    from pacman_env.engine.cache_folder import check_kept, kernel_folder, mark
    from pacman_env.engine.jit import require_compiler

    require_compiler()
    parts = PARTS | ROBOT_PARTS if robot else PARTS
    if verbose and (ahead := mark("compiled-ahead")) is not None:
        ahead.touch()  # no other process compiles for this one
    with install_recorder("numba:compile") as recorded:
        for name, work in parts.items():
            _compile(name, work)
    if verbose:
        print(_compile_times(recorded.buffer))
    print(f"cache folder: {kernel_folder()}")
    if houses:
        _prepare_houses(houses)
        check_kept()
    return 0


def _compile_times(events: Sequence[tuple[float, Any]]) -> str:
    """Return how long the slowest kernels took, from starts and ends of compilations and their times, s.

    The kernels that a kernel calls count for themselves.
    """
    seconds: dict[str, float] = defaultdict(float)
    running: list[str] = []  # the innermost kernel last
    for (began_s, event), (ended_s, _) in itertools.pairwise(events):
        if event.is_start:
            kernel = event.data["dispatcher"].py_func
            running.append(f"{kernel.__module__.removeprefix('pacman_env.')}.{kernel.__name__}")
        else:
            running.pop()
        if running:
            seconds[running[-1]] += ended_s - began_s
    longest = sorted(seconds.items(), key=lambda one: -one[1])[:_LONGEST]
    rows = [*longest, (f"all {len(seconds)} kernels", sum(seconds.values()))]
    return "\n".join(f"{name:<48} {passed_s:5.1f} s" for name, passed_s in rows)


def _compile(name: str, work: Callable[[], None]) -> None:
    """Do a part of the work unless it is done, and print how long it took."""
    from pacman_env.engine.cache_folder import cache_dir, check_kept, mark

    done = mark(f"warm-up-{'-'.join(name.split())}-{_compiler()}")
    if done is None:
        rule = "set PACMAN_ENV_CACHE to a folder that can be written"
        raise OSError(f"{cache_dir()}: cannot be written, so compiled code would be lost; {rule}")
    if done.exists():
        print(f"{name:<16} already compiled")
        return
    began = time.monotonic()
    work()
    check_kept()
    done.touch()
    print(f"{name:<16} {time.monotonic() - began:6.1f} s", flush=True)


def _prepare_houses(count: int) -> None:
    """Prepare the houses that are not cached yet, with a progress line on a terminal."""
    from pacman_env.config import make_config
    from pacman_env.levels.level_source import TEST_LEVEL, GeneratedMaps

    config, began = make_config(), time.monotonic()
    train = GeneratedMaps(config, 0, count)
    test = GeneratedMaps(config, TEST_LEVEL, min(count, train.family.test_set))
    levels = [(maps, maps.start_level + k) for maps in (train, test) for k in range(maps.num_levels)]
    for done, (maps, level) in enumerate(levels):
        if sys.stdout.isatty():
            print(f"\r{done:,} of {len(levels):,} houses", end="\r", flush=True)
        if not maps.files.has(level):
            maps.prepare(level)
    print(f"{len(levels):,} houses{time.monotonic() - began:13.1f} s")


def _compiler() -> str:
    """Return a hash of everything that separates entries of Numba's cache: versions and the processor."""
    import numba
    from numba.core.registry import cpu_target

    what = numba.__version__, sys.version_info[:2], cpu_target.target_context.codegen().magic_tuple()
    return hashlib.sha256(repr(what).encode()).hexdigest()[:12]


def _play(settings: Mapping[str, Any] = _SHORT, **arguments: Any) -> None:
    import numpy as np

    from pacman_env.envs.pacmanbot import PacManBotEnv
    from pacman_env.envs.pacmanbot_vector import PacManBotVectorEnv

    games = PacManBotEnv(settings=settings, **arguments), PacManBotVectorEnv(2, settings=settings, **arguments)
    env: Any
    for env in games:
        env.reset(seed=0)
        env.action_space.seed(0)
        for _ in range(_STEPS):
            drives = arguments.get("action") == "velocity"
            action = env.action_space.sample() if drives else env.action_masks().argmax(axis=-1)
            _, _, ended, cut, _ = env.step(action)
            if np.all(np.logical_or(ended, cut)):
                env.reset()


def _every_argument() -> None:
    from pacman_env.observations.kinds import BUILT_IN_KINDS
    from pacman_env.sim.ghost_state import BEHAVIOUR_NAMES

    kinds = tuple(BUILT_IN_KINDS)
    _play(observation=kinds)
    _play(observation=kinds, ghosts=BEHAVIOUR_NAMES)
    _play(action="velocity", observation="scan")
    _play({**_SHORT, "observation.normalize": True}, action="velocity", observation=("scan", "flat"))
    _play({**_SHORT, "execution.rules": "as_built", "observation.candidates": "nearest"}, preset="ideal")
    _play({**_EVENTFUL, "endless": True})


def _policies() -> None:
    import numpy as np

    from pacman_env.envs.pacmanbot import PacManBotEnv
    from pacman_env.policies.registry import make_policy, policy_names
    from pacman_env.sim.ghost_state import BEHAVIOUR_NAMES

    env = PacManBotEnv(settings=_SHORT, ghosts=BEHAVIOUR_NAMES)  # search compiles nothing if all ghosts wander
    env.reset(seed=0)
    for name in policy_names():
        policy = make_policy(name)
        policy.reset(np.ones(1, np.bool_), env.config)
        policy.select(env.situation)
        policy.explain(env.situation)


def _two_players() -> None:
    from pacman_env.envs.pettingzoo_env import PacManBotParallelEnv

    env = PacManBotParallelEnv(settings={**_SHORT, "zero_sum": False})
    observations, _ = env.reset(seed=0)
    for _ in range(_STEPS):
        if not env.agents:
            observations, _ = env.reset()
        observations, *_ = env.step({agent: int(observations[agent]["action_mask"].argmax()) for agent in env.agents})


def _robot() -> None:
    from pacman_env.levels.assets import map_assets
    from pacman_env.observations.robot_view import RobotView
    from pacman_env.policies.registry import policy_names
    from pacman_env.ros.game_nodes import GameSetup
    from pacman_env.ros.selector.policy_child import Policies, PolicySetup
    from pacman_env.sim.ghost_state import MapGhosts
    from pacman_env.sim.robot_simulation import SimulatedRobot
    from pacman_env.world.maps.occupancy import load_map

    setup, occupancy = GameSetup("house", sim=True), load_map("house")
    for policy in policy_names():
        Policies(PolicySetup(policy, setup.map, setup.preset, setup.execution, []))
    assets = map_assets(occupancy, setup.config())
    RobotView(assets, setup.config()).compile_kernels()
    MapGhosts(assets, setup.config(), 0).compile_kernels()
    SimulatedRobot(occupancy, setup.config(), 0).compile_kernels()


#: Parts by their printed name.
PARTS: dict[str, Callable[[], None]] = {
    "PacManBotFlat-v2": partial(_play, flat=True),
    "all arguments": _every_argument,
    "generated houses": partial(_play, {**_SHORT, "num_levels": 1}, map="generated"),
    "two players": _two_players,
    "policies": _policies,
}
ROBOT_PARTS: dict[str, Callable[[], None]] = {"robot": _robot}
