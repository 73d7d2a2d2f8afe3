"""The game on a :mod:`coarse map <.coarse_map>`: a robot that drives to goals with lags, and ghosts that react to it.

At every step each ghost decides with the function of its behaviour (``game/ghosts.py``). A wandering ghost draws its
targets from its own random stream. In all kernels ``robot`` is a record of ``ROBOT``, ``ghost`` a record of ``GHOST``,
``model`` is a ``Model``, ``m`` are ``CoarseArrays``, and ``p`` is a record of ``RULES``.
"""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numba.np.unsafe.ndarray import to_fixed_tuple
from numpy.typing import NDArray

from ..config import Config
from ..engine.arrays import Array, Table, address, arrays_by_address, reals_at
from ..engine.arrays import zeros as zero_arrays  # the key of a kernel would mistake ``zeros`` for NumPy's ``zeros``
from ..engine.jit import kernel
from ..engine.native import address_of_kernel, call_range
from ..game.ghosts import WANDER, Behaviour, view_of
from ..levels.coarse_map import NO_BLOCK, CoarseArrays, next_block, units_between
from ..rng import below
from ..world.navigation.controller import START_FIELDS, start_s, start_values
from ..world.navigation.grid import cell_of
from .behaviour_kernels import CONSTANTS, behaviour_kernel, target_of

_BESIDE_M = 0.6  # blocks with a longer path between them are not adjacent
NOWHERE, UNCHANGED = -1, -2  # instead of goals: no goal; keep the current goal
MOST_PELLETS = 64  # one bit each in a state
#: Constants of the rules and of the robot's motion.
RULES = np.dtype(
    [
        ("speed", np.float64),  # m/s along a path
        *START_FIELDS,  # start of a robot that turns to its path
        ("start_s", np.float64),  # delay from a choice to driving, if at rest
        ("switch_s", np.float64),  # delay from a choice to a change of direction, if driving
        ("step_s", np.float64),  # one step: ghosts decide, pick-up and death are tested
        ("pickup_m", np.float64),
        ("goal_m", np.float64),  # Nav2's tolerance
        ("death_m", np.float64),  # with a margin for what the model omits
        ("limit_s", np.float64),  # length of a round
    ]
)
#: State of the robot and its pellets.
ROBOT = [
    ("block", np.int32),
    ("goal", np.int32),  # current goal, or NOWHERE
    ("then", np.int32),  # the goal that replaces it after ``then_s``, or UNCHANGED
    ("reached", np.bool_),  # reached a goal in this step
    ("then_s", np.float64),
    ("wait_s", np.float64),  # time left for turning
    ("left_m", np.float64),  # path length to the goal
    ("heading", np.float64),  # rad
    ("x", np.float64),  # m
    ("y", np.float64),
    ("time_s", np.float64),  # since the start of the round
    ("pellets", np.uint64),  # bits of the remaining pellets
    ("collected", np.int64),
    ("collected_s", np.float64),  # sum of the times of collection
    ("closest_m", np.float64),  # smallest straight distance of any ghost so far
    ("dead", np.bool_),
]
GHOST = np.dtype(
    [
        ("block", np.int32),  # the last block that it passed
        ("towards", np.int32),  # the next block
        ("target", np.int32),
        ("wanders", np.bool_),  # draws its own targets
        ("offset_m", np.float64),  # walked since ``block``
        ("speed", np.float64),  # m/s
        ("x", np.float64),  # m
        ("y", np.float64),
        ("vx", np.float64),  # m/s
        ("vy", np.float64),
        ("stream", np.uint64),
        ("number", np.int32),  # index in the game, which decides behaviour and corner
    ]
)


class Lags(NamedTuple):
    """Constants of the robot's motion and the length of a step; ``python -m benchmarks.coarse_model`` checks them."""

    speed_share: float = 0.995  # share of the commanded speed, along a path
    start_s: float = 0.3
    switch_s: float = 0.6  # in periods of Nav2's planner
    step_s: float = 1.0  # reaching a goal ends the step, which models the wait for the next choice
    death_margin_m: float = 0.15


def rules(config: Config, lags: Lags) -> NDArray[Any]:
    """Return the constants of the model, a record (1,) of type RULES."""
    record = np.zeros(1, dtype=RULES)
    record["speed"] = lags.speed_share * config.robot.speed_mps
    for (name, _), value in zip(START_FIELDS, start_values(config), strict=True):
        record[name] = value
    record["start_s"] = lags.start_s
    record["switch_s"] = lags.switch_s * config.nav2.planner_period_s
    record["step_s"] = lags.step_s
    record["pickup_m"], record["goal_m"] = config.execution.pickup_radius_m, config.nav2.goal_tolerance_m
    record["death_m"] = config.execution.death_radius_m + lags.death_margin_m
    record["limit_s"] = config.time_limit_s
    return record


class BehaviourArrays(NamedTuple):
    """Inputs and results of the behaviour kernels, which are called by address, for G ghosts."""

    behaviours: Any = Array(np.int64, "G 2")  # addresses of the kernel and its constants; 0: wanders
    ghosts: Any = Array(GHOST, "G")
    robots: Any = Array(np.float64, "G 3")  # pose of the robot as each ghost sees it: m, m, rad
    corners: Any = Array(np.float64, "G 2")  # m
    targets: Any = Array(np.float64, "G 2")  # m


behaviour_arrays = arrays_by_address(BehaviourArrays)


def new_behaviour_arrays(ghosts: int) -> BehaviourArrays:
    """Return arrays of zeros, with which all ghosts wander."""
    return BehaviourArrays(**zero_arrays(BehaviourArrays, BehaviourArrays._fields, G=ghosts))


def _decide_behaviour(table, k, unused):  # type: ignore[no-untyped-def]
    """Write the target of ghost k to the ``BehaviourArrays`` at ``table``, computed from its view; return 0."""
    a = behaviour_arrays(table)
    constants = reals_at(a.behaviours[k, 1], CONSTANTS)
    view = view_of(k, a.ghosts[k], a.robots[k], a.corners[k])
    a.targets[k, 0], a.targets[k, 1] = target_of(view, to_fixed_tuple(constants, CONSTANTS))
    return 0


class Behaviours:
    """Compiled behaviours of the ghosts; kernels call them through ``table``."""

    def __init__(self, behaviours: Sequence[Behaviour], config: Config) -> None:
        """Compile the behaviours; ghosts that a policy controls are modelled as wandering."""
        self._constants = [np.array(one.constants(config), dtype=np.float64) for one in behaviours]
        arrays = new_behaviour_arrays(len(behaviours))
        for k, one in enumerate(behaviours):
            if one.target is not None and one.name != WANDER:
                function = address_of_kernel(behaviour_kernel(_decide_behaviour, one))
                arrays.behaviours[k] = function, address(self._constants[k])
        self.table = Table(BehaviourArrays, **arrays._asdict())


class Model(NamedTuple):
    """Everything that stays constant while a coarse game is played."""

    map: CoarseArrays
    rules: Any  # of type RULES, (1,)
    behaviours: int  # address of the table of BehaviourArrays
    bit: Any  # (G,) int8, the bit of each goal that is a pellet, else -1


@kernel
def put_robot(robot, model, x, y, heading):  # type: ignore[no-untyped-def]
    """Place the robot at rest and without a goal at (x, y), m, with a heading in rad."""
    m = model.map
    column, row = cell_of(m.affine, m.snap.shape[0], m.snap.shape[1], x, y)
    robot.block = m.robot_block[m.snap[row, column]]
    robot.goal, robot.then, robot.reached = NOWHERE, UNCHANGED, False
    robot.then_s, robot.wait_s, robot.left_m = 0.0, 0.0, 0.0
    robot.heading, robot.x, robot.y = heading, x, y
    robot.collected, robot.collected_s, robot.closest_m, robot.dead = 0, 0.0, np.inf, False


@kernel
def _ghost_block(m, x, y):  # type: ignore[no-untyped-def]
    """Return the ghost block nearest to (x, y), m."""
    column, row = cell_of(m.affine, m.snap.shape[0], m.snap.shape[1], x, y)
    return m.ghost_block[m.ghost_snap[row, column]]


@kernel
def put_ghost(ghost, number, model, seen):  # type: ignore[no-untyped-def]
    """Place ghost ``number`` on the nearest segment between two adjacent blocks.

    ``seen`` (5,) is its row of ``Situation.ghosts``: position, m, velocity and speed, m/s.
    """
    m = model.map
    x, y, ghost.vx, ghost.vy, ghost.speed = seen
    block = _ghost_block(m, x, y)
    ghost.block, ghost.towards, ghost.target, ghost.number = block, block, -1, number
    ghost.offset_m, ghost.x, ghost.y = 0.0, x, y
    ax, ay = m.ghost_xy[block, 0], m.ghost_xy[block, 1]
    least = (x - ax) ** 2 + (y - ay) ** 2
    for n in range(1, m.ghost_joined.shape[1]):
        b = m.ghost_joined[block, n]
        length = units_between(m, block, b) * m.unit_m[0]
        if b == block or length > _BESIDE_M or next_block(m, b, block) != b:
            continue
        dx, dy = m.ghost_xy[b, 0] - ax, m.ghost_xy[b, 1] - ay
        share = min(max(((x - ax) * dx + (y - ay) * dy) / (dx * dx + dy * dy), 0.0), 1.0)
        off = (x - ax - share * dx) ** 2 + (y - ay - share * dy) ** 2
        if off < least:
            least = off
            ghost.towards, ghost.offset_m = b, share * length


@kernel
def _turn_s(robot, heading, p):  # type: ignore[no-untyped-def]
    """Return the time, s, that a standing robot loses by turning to ``heading``, rad, and speeding up."""
    off = abs(heading - robot.heading) % (2.0 * math.pi)
    return start_s(min(off, 2.0 * math.pi - off), 0.0, p)


@kernel
def begin(robot, goal, left_m, model):  # type: ignore[no-untyped-def]
    """Start driving to a goal; ``left_m`` is the path length to it, m."""
    m, p = model.map, model.rules[0]
    robot.then = UNCHANGED
    robot.goal = goal
    if goal >= 0:
        robot.left_m = left_m
        robot.wait_s = _turn_s(robot, m.robot_heading[robot.block, goal], p)
        if left_m == np.inf:
            robot.goal = NOWHERE


@kernel
def choose(robot, goal, model):  # type: ignore[no-untyped-def]
    """Apply the choice of a goal (NOWHERE: stop); a driving robot follows its old path for ``switch_s`` first."""
    p = model.rules[0]
    if goal == robot.goal and robot.then == UNCHANGED:
        return
    if goal == NOWHERE:
        robot.goal, robot.then = NOWHERE, UNCHANGED
        return
    if robot.then != goal:
        robot.then_s = p.switch_s if robot.goal >= 0 else p.start_s
        robot.then = goal


@kernel
def _advance(robot, span, model):  # type: ignore[no-untyped-def]
    """Turn and drive for ``span`` s on the path to the goal; a reached goal ends, and its pellet is collected."""
    m, p = model.map, model.rules[0]
    goal = robot.goal
    turning = min(robot.wait_s, span)
    robot.wait_s -= turning
    robot.left_m -= (span - turning) * p.speed
    if span <= turning:
        return
    following = m.robot_next[robot.block, goal]
    while following != NO_BLOCK and robot.left_m <= m.robot_length[following, goal]:
        robot.block = following
        following = m.robot_next[following, goal]
    b = robot.block
    robot.heading = m.robot_heading[b, goal]
    # Interpolate between the places of two blocks by the remaining path length.
    own = m.robot_length[b, goal]
    if following != NO_BLOCK:
        x, y, other = m.robot_xy[following, 0], m.robot_xy[following, 1], m.robot_length[following, goal]
    else:
        x, y, other = m.goal_xy[goal, 0], m.goal_xy[goal, 1], 0.0
    share = min(max((own - robot.left_m) / max(own - other, 1e-6), -1.0), 1.0)
    robot.x = m.robot_xy[b, 0] + share * (x - m.robot_xy[b, 0])
    robot.y = m.robot_xy[b, 1] + share * (y - m.robot_xy[b, 1])
    dx, dy = m.goal_xy[goal, 0] - robot.x, m.goal_xy[goal, 1] - robot.y
    if robot.left_m <= 0.0 or dx * dx + dy * dy <= p.goal_m * p.goal_m:
        bit = model.bit[goal]
        if bit >= 0:
            _collect(robot, bit)
        robot.goal, robot.reached = NOWHERE, True


@kernel
def _collect(robot, bit):  # type: ignore[no-untyped-def]
    """Collect the pellet of the bit number ``bit``, if it is left."""
    one = np.uint64(1) << np.uint64(bit)
    if robot.pellets & one:
        robot.pellets ^= one
        robot.collected += 1
        robot.collected_s += robot.time_s


@kernel
def _drive(robot, model):  # type: ignore[no-untyped-def]
    """Move the robot for one step; a chosen goal replaces the present goal after its delay."""
    m, p = model.map, model.rules[0]
    spare = p.step_s
    robot.reached = False
    while spare > 0.0:
        span = spare
        if robot.then != UNCHANGED:
            if robot.then_s <= 0.0:
                goal = np.int64(robot.then)
                begin(robot, goal, np.float64(m.robot_length[robot.block, goal]), model)
                continue
            span = min(spare, robot.then_s)
            robot.then_s -= span
        if robot.goal >= 0:
            _advance(robot, span, model)
        spare -= span


@kernel
def ask(table, ghost, robot, corner):  # type: ignore[no-untyped-def]
    """Return the target (x, y), m, of a ghost that sees the pose ``robot`` (3,) and has its own ``corner`` (x, y), m.

    The result is (NaN, NaN) if the ghost wanders or its behaviour raises an error. ``table`` is the address of
    ``BehaviourArrays``.
    """
    a, k = behaviour_arrays(table), ghost.number
    if a.behaviours[k, 0] == 0:
        return math.nan, math.nan
    a.ghosts[k] = ghost
    a.robots[k, 0], a.robots[k, 1], a.robots[k, 2] = robot
    a.corners[k, 0], a.corners[k, 1] = corner[0], corner[1]
    if call_range(a.behaviours[k, 0], table, k, 0) < 0:
        return math.nan, math.nan
    return a.targets[k, 0], a.targets[k, 1]


@kernel
def _decide(ghost, robot, model):  # type: ignore[no-untyped-def]
    """Return the target block of a ghost, or -1 if it wanders."""
    m = model.map
    corner = m.ghost_xy[m.ghost_corner[ghost.number]]
    x, y = ask(model.behaviours, ghost, (robot.x, robot.y, robot.heading), corner)
    if not (math.isfinite(x) and math.isfinite(y)):
        return -1
    return np.int64(_ghost_block(m, x, y))


@kernel
def _walk(ghost, m, seconds):  # type: ignore[no-untyped-def]
    """Move a ghost for ``seconds`` along the shortest path to its target block."""
    x, y, target, unit = ghost.x, ghost.y, ghost.target, m.unit_m[0]
    if ghost.towards != ghost.block:
        length = units_between(m, ghost.block, ghost.towards) * unit
        back, forward = units_between(m, target, ghost.block) * unit, units_between(m, target, ghost.towards) * unit
        if back + ghost.offset_m < forward + length - ghost.offset_m:  # turning round is shorter
            ghost.block, ghost.towards, ghost.offset_m = ghost.towards, ghost.block, length - ghost.offset_m
    move = ghost.speed * seconds
    share = 0.0
    while True:
        if ghost.towards == ghost.block:
            if ghost.block == target:
                if ghost.wanders:
                    ghost.target = -1  # arrived: the next step draws another target
                break
            ghost.towards = next_block(m, target, ghost.block)
            ghost.offset_m = 0.0
        length = units_between(m, ghost.block, ghost.towards) * unit
        if ghost.offset_m + move < length:
            ghost.offset_m += move
            share = ghost.offset_m / length
            break
        move -= length - ghost.offset_m
        ghost.block, ghost.offset_m = ghost.towards, 0.0
    a, b = m.ghost_xy[ghost.block], m.ghost_xy[ghost.towards]
    ghost.x, ghost.y = a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1])
    ghost.vx, ghost.vy = (ghost.x - x) / seconds, (ghost.y - y) / seconds


@kernel
def _pick_up(robot, model):  # type: ignore[no-untyped-def]
    """Collect the pellets in reach."""
    m, p = model.map, model.rules[0]
    for goal in range(len(model.bit)):
        bit = model.bit[goal]
        if bit >= 0 and (robot.pellets >> np.uint64(bit)) & np.uint64(1):
            dx, dy = m.goal_xy[goal, 0] - robot.x, m.goal_xy[goal, 1] - robot.y
            if dx * dx + dy * dy <= p.pickup_m * p.pickup_m:
                _collect(robot, bit)
                if goal == robot.goal:
                    robot.goal, robot.reached = NOWHERE, True


@kernel
def step(robot, ghosts, model):  # type: ignore[no-untyped-def]
    """Play one step of a game: the ghosts (G,) decide, everything moves, pick-up and death are tested."""
    m, p = model.map, model.rules[0]
    for k in range(len(ghosts)):
        ghost = ghosts[k]
        target = _decide(ghost, robot, model)
        ghost.wanders = target < 0
        if target >= 0:
            ghost.target = target
        elif ghost.target < 0:
            ghost.stream, pick = below(ghost.stream, len(m.ghost_xy))
            ghost.target = pick
        _walk(ghost, m, p.step_s)
    robot.time_s += p.step_s
    _drive(robot, model)
    _pick_up(robot, model)
    for k in range(len(ghosts)):
        dx, dy = ghosts[k].x - robot.x, ghosts[k].y - robot.y
        robot.closest_m = min(robot.closest_m, math.sqrt(dx * dx + dy * dy))
    robot.dead = robot.closest_m <= p.death_m and robot.pellets != 0


@kernel
def play(robot, ghosts, goal, until_s, model):  # type: ignore[no-untyped-def]
    """Choose a goal and step until the time ``until_s``, until a goal is reached or until the round ends."""
    choose(robot, goal, model)
    while robot.time_s < until_s:
        step(robot, ghosts, model)
        if robot.dead or robot.reached or robot.pellets == 0 or robot.time_s >= model.rules[0].limit_s:
            break


@kernel
def copy_ghosts(ghosts, other):  # type: ignore[no-untyped-def]
    """Copy the records ``ghosts`` (G,) to ``other`` (G,)."""
    for k in range(len(ghosts)):
        other[k] = ghosts[k]


@kernel
def lead_m(robot, ghosts, m):  # type: ignore[no-untyped-def]
    """Return the shortest path length, m, from any ghost (G,) to the robot, on either side of a wall next to it."""
    least, unit = np.inf, m.unit_m[0]
    for j in range(2):
        block = m.ghost_beside[robot.block, j]
        rest = math.hypot(m.ghost_xy[block, 0] - robot.x, m.ghost_xy[block, 1] - robot.y)
        for k in range(len(ghosts)):
            ghost = ghosts[k]
            on = units_between(m, ghost.block, ghost.towards) * unit - ghost.offset_m
            forward, back = units_between(m, block, ghost.towards) * unit, units_between(m, block, ghost.block) * unit
            ahead = min(forward + on, back + ghost.offset_m)
            least = min(least, ahead + rest)
    return least
