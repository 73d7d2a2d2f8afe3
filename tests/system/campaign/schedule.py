"""The schedule of a randomised game of the robot's nodes: its arena, policy, Clyde, faults, interferences and outages.

All of it is drawn from the game's seed, as plain values. ``games`` makes it happen, ``verdict`` decides whether the
nodes withstood it. ROS is not imported.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from pacman_env.ros.simulated_robot.sim_faults import FAULTS
from pacman_env.ros.standstill import DEFAULT_LEASE_S
from pacman_env.ros.supervisor.game_nodes import GAME, REFEREE, SELECTOR, SIMULATOR
from pacman_env.world.maps.occupancy import OccupancyMap, load_map

GAMES_PER_SYSTEM = 10  # consecutive seeds are played by the same nodes, on the same arena
STATES = ("menu", "returning_home", "starting", "running", "dying")
POLICIES = ("clyde_aware", "lookahead", "ppo", "nearest", "random")
#: Maps, and how much of them around home is played on, m; small ones, so that a game ends soon.
ARENAS = (
    *(("house", 3.0), ("house", 4.0), ("loop", 3.0), ("loop", 3.5), ("maze", 3.0), ("maze", 4.0)),
    *(("open_plan", 2.5), ("open_plan", 3.0), ("house", math.inf)),
)
#: A robot that is not where it believes to be waits for a person, and a silent base cannot be observed by its odometry.
DRAWN_FAULTS = [name for name in FAULTS if name not in ("kidnap", "wheels_slip", "base_silent")]
RESETS = ("reset", "start", "start and leave")
#: Messages that no node may accept, by name; ``interference`` makes them.
NONSENSE = (
    *("pose not finite", "pose in another frame", "transform not finite", "clyde not finite", "click not finite"),
    *("unknown words", "endless words", "unknown statuses", "foreign pellet", "statuses out of place"),
    *("no markers", "10000 markers", "10001 markers", "markers not finite", "speeds out of range"),
    *("velocity not finite", "obstacle of no points", "goal not finite", "initial pose not finite", "unknown fault"),
    *("cancel of an unknown goal", "cancel all and leave", "goal and leave"),
)
INTERFERENCES = (*RESETS, *NONSENSE)
FREEZE, KILL, LOSS = OUTAGES = ("freeze", "kill", "network loss")
EVERY_NODE = "all"  # of a network on which no message arrives
NODES = (SIMULATOR, *GAME, SELECTOR)
LEASE_S = DEFAULT_LEASE_S  # of silence, after which the middleware removes a node

#: How long after its beginning something happens in a state at most, s; later than most games stay in it, never.
_LATEST_S = {"menu": 3.0, "returning_home": 10.0, "starting": 8.0, "running": 40.0, "dying": 5.0}
_SHARES = (0.15, 0.2, 0.15, 0.4, 0.1)  # of the states, in what is drawn
_LASTS_S = (2.0, 5.0, 15.0, 40.0, 90.0)
_TOGETHER = 0.3  # share of faults that begin with the one before
_RESET = 0.15  # share of games that are broken off
_CALM = 0.1  # share of games in which nothing happens
_OUTAGES = (0.15, 0.45, 0.3, 0.1)  # shares of games with none, one, two and three
_KINDS = (0.35, 0.3, 0.35)  # of outages
_WEIGHTS = {REFEREE: 2.0, SELECTOR: 2.0}  # of nodes; of all others 1
_SHORTEST_S, _LONGEST_S = 1.0, 60.0  # of an outage; half of them are longer than the lease
_PERCENT = (30, 60, 100)  # of packets that are lost
_EVERY = 0.2  # share of losses that concern every node


@dataclass(frozen=True)
class Step:
    """One thing that happens, as soon as the game has been in a state for so long."""

    state: str
    after_s: float  # simulated
    kind: str  # a fault's name, or one of ``INTERFERENCES`` or ``OUTAGES``
    words: str = ""  # of a fault, as ``sim/fault`` takes them; empty: no fault
    lasts_s: float = 0.0  # of a fault, the robot's time; of an outage, the simulated wall clock's
    node: str = ""  # of an outage
    percent: int = 100  # of packets, of a network loss


@dataclass(frozen=True)
class Schedule:
    seed: int
    policy: str
    clyde_speed_mps: float  # in round 1
    menu_s: float  # simulated, before ``game/start`` is called
    steps: tuple[Step, ...]

    @property
    def kinds(self) -> frozenset[str]:
        return frozenset(step.kind for step in self.steps)


def arena_of(seed: int) -> tuple[str, float]:
    """The map and its part of the system that plays this seed."""
    rng = np.random.default_rng([seed // GAMES_PER_SYSTEM, 1])
    return ARENAS[int(rng.integers(len(ARENAS)))]


def part_of_map(name: str, within_m: float) -> OccupancyMap:
    """A shipped map, with walls everywhere but in a square of ``2 within_m`` around the map's origin, home."""
    whole = load_map(name)
    height, width = whole.grey.shape
    x = whole.origin[0] + (np.arange(width) + 0.5) * whole.resolution
    y = whole.origin[1] + (height - np.arange(height) - 0.5) * whole.resolution
    grey = whole.grey.copy()
    grey[(np.abs(y) > within_m)[:, None] | (np.abs(x) > within_m)[None, :]] = 0
    return OccupancyMap.from_pixels(name, grey, whole.resolution, whole.origin)


def schedule(seed: int) -> Schedule:
    rng = np.random.default_rng([seed, 0])
    calm = rng.random() < _CALM
    faults = _faults(rng, 0 if calm else int(rng.integers(1, 5)))
    others = [_step(rng, str(rng.choice(NONSENSE + RESETS[1:]))) for _ in range(0 if calm else int(rng.integers(0, 5)))]
    resets = [_step(rng, "reset")] if not calm and rng.random() < _RESET else []
    return Schedule(
        seed=seed,
        policy=str(rng.choice(POLICIES)),
        clyde_speed_mps=max(0.001, round(float(rng.uniform(0.0, 0.4)), 3)),
        menu_s=round(float(rng.uniform(0.0, 4.0)), 1),
        steps=tuple(faults + others + resets + ([] if calm else _outages(np.random.default_rng([seed, 2])))),
    )


def _step(rng: np.random.Generator, kind: str) -> Step:
    state = str(rng.choice(STATES, p=_SHARES))
    if kind.startswith("start") and state in ("menu", "returning_home"):
        state = "running"  # in the menu it would be allowed, and so where the menu may come at any moment
    return Step(state, round(float(rng.uniform(0.0, _LATEST_S[state])), 1), kind)


def _faults(rng: np.random.Generator, count: int) -> list[Step]:
    """Each of another kind: a second one of a kind would only change the first."""
    steps: list[Step] = []
    for kind in rng.permutation(DRAWN_FAULTS)[:count].tolist():
        step = _step(rng, kind)
        if steps and rng.random() < _TOGETHER:
            step = replace(steps[-1], kind=kind)
        numbers = "".join(f" {number:.1f}" for number in _numbers(rng, kind))
        steps.append(replace(step, words=kind + numbers, lasts_s=float(rng.choice(_LASTS_S))))
    return steps


def _numbers(rng: np.random.Generator, kind: str) -> list[float]:
    if kind == "clock_jump":  # not back to before the start, where the clock would stand; and far enough to be seen
        return [float(rng.choice([10.0, 30.0, 1000.0, -10.0, -20.0]))]
    if kind == "pose_jump":
        return [*rng.uniform(-1.5, 1.5, 2).tolist(), float(rng.uniform(-3.1, 3.1))]
    return rng.uniform(0.0, 6.0, len(FAULTS[kind])).tolist()


def _outages(rng: np.random.Generator) -> list[Step]:
    """They have a random stream of their own: a game without one kind has the others unchanged."""
    weights = np.array([_WEIGHTS.get(node, 1.0) for node in NODES])
    steps = []
    for _ in range(int(rng.choice(len(_OUTAGES), p=_OUTAGES))):
        kind, node = str(rng.choice(OUTAGES, p=_KINDS)), str(rng.choice(NODES, p=weights / weights.sum()))
        bounds = (_SHORTEST_S, LEASE_S) if rng.random() < 0.5 else (LEASE_S, _LONGEST_S)
        lasts_s, percent, every = (
            round(float(rng.uniform(*bounds)), 1),
            int(rng.choice(_PERCENT)),
            rng.random() < _EVERY,
        )
        step = replace(_step(rng, kind), node=node)
        if kind != KILL:
            step = replace(step, lasts_s=lasts_s)
        if kind == LOSS:
            step = replace(step, percent=percent, node=EVERY_NODE if every else node)
        steps.append(step)
    return steps
