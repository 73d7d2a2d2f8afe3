"""Start games from a situation; what a situation does not contain is drawn from seeds.

Drawn are the true pose within the localization's error, the behaviour of each ghost from the belief about it, the
target of each wandering ghost, the parameters that the configuration randomizes, and all later noise.

A situation does not contain the following, so it is assumed. The robot's plan starts now, and no goal waits for Nav2
or is about to be aborted. A forbidden refuge waits for one back-off time, and a forbidden pellet cannot be collected.
It is the first round of an endless game. A caught ghost returns to a random spawn place.
"""

import math

import numpy as np
from numpy.typing import NDArray

from ..config import Config
from ..engine.jit import kernel
from ..engine.native import address_of
from ..game.behaviour_belief import ARCADE, CHASES, WANDERS
from ..game.execution import NO_CHOICE, goal_of
from ..game.ghosts import choose_target, ghost_stream, spawn
from ..game.power import AWAY_UNTIL, HARMLESS_UNTIL
from ..levels.ghost_cells import find_path, step_of
from ..levels.level import Level, LevelFacts, level_arrays
from ..levels.level_source import FixedMap
from ..rng import POLICY, below, stream
from ..sim.batch import GameBatch
from ..sim.ghost_state import ghost_arrays
from ..sim.kernels import believed, nearest, reset_robot, see_ghosts
from ..sim.parameters import draw_episodes
from ..sim.ticks import tick_arrays
from ..world.navigation import navigator
from ..world.navigation.controller import refresh_heading
from ..world.navigation.localization import wrap
from ..world.navigation.physics import place
from .situation import AWAY_S, FRIGHTENED_S, PELLET, REFUGE, Situation, maps_of, situation_arrays

_TRIES = 24  # targets drawn for a wandering ghost until one agrees with its present step


class KnownLevel(FixedMap):
    """The level of a situation as the only level of a batch; ``sizes`` are upper bounds for all its levels."""

    def __init__(self, level: Level, sizes: LevelFacts, config: Config) -> None:
        super().__init__(level.assets, config)
        self._sizes, self._known = sizes, level

    def most(self, config: Config) -> LevelFacts:
        return self._sizes

    def prepare(self, level: int) -> Level:
        return self._known


def games_for(situation: Situation, config: Config, n: int) -> GameBatch:
    """Create ``n`` games for :func:`games_from` with the candidates of ``situation``; ``config`` is the game's."""
    maps = maps_of(situation)
    level = maps.level(int(situation.level[0]))
    pellets, refuges = (int((situation.kind[0] == kind).sum()) for kind in (PELLET, REFUGE))
    ghosts = situation.ghosts.shape[1]
    config = config.with_fields(
        **{"clyde.ghosts": ("wander",) * ghosts, "max_pellets": None, "endless": False, "action": "goal"}
    )
    sizes = maps.sizes._replace(pellets=pellets, refuges=refuges)
    batch = GameBatch(KnownLevel(level, sizes, config), config, n)
    batch.compile_behaviours((ARCADE, CHASES))
    return batch


@kernel
def _place_robot(a, i, s, j):  # type: ignore[no-untyped-def]
    """Place the robot of game i where situation j believes it, minus a drawn error of the localization."""
    g, p = a.rules.games[i], a.rules.parameters[0]
    v, omega = s.robot_velocity[j]
    reset_robot(g, s.robot[j])
    ahead = 0.0 if p.use_tf else min(v * s.pose_age_s[j], g.update_distance)  # driven since the pose was published
    cos, sin = math.cos(s.robot[j, 2]), math.sin(s.robot[j, 2])
    g.odom_x, g.odom_y = s.robot[j, 0] - g.error_x, s.robot[j, 1] - g.error_y
    g.heading = g.odom_heading = wrap(s.robot[j, 2] - g.error_heading)
    g.amcl_x, g.amcl_y, g.amcl_heading = s.robot[j]
    g.x, g.y = g.odom_x + ahead * cos, g.odom_y + ahead * sin
    place(g, g.x, g.y)
    g.left, g.right, g.omega = v - omega * p.half_base, v + omega * p.half_base, omega
    g.vx, g.vy = v * cos, v * sin
    g.body_vx, g.body_vy = g.vx, g.vy
    refresh_heading(g)
    g.tick, g.step = s.tick[j], s.tick[j] * p.substeps
    g.amcl_step = g.step - round(s.pose_age_s[j] / p.dt)
    g.nav_wait_step = g.nav_progress_step = g.step


@kernel
def _set_goals(a, i, s, j):  # type: ignore[no-untyped-def]
    """Set which pellets are left, and which refuges wait after an abort."""
    rules, g, p = a.rules, a.rules.games[i], a.rules.parameters[0]
    g.spawned = s.pellets_left[j]
    rules.aborts[i] = 0
    for c in range(s.mask.shape[1]):
        if c < p.pellet_slots:
            rules.alive[i, c] = s.mask[j, c]
        waits = s.kind[j, c] == REFUGE and s.goal[j, c] >= 0 and not s.mask[j, c]
        rules.waits[i, c] = g.step + p.back_off if waits else 0


@kernel
def _continue_goal(a, i, current, level):  # type: ignore[no-untyped-def]
    """Let the robot of game i drive to its present goal, on a plan of this moment."""
    g, p = a.rules.games[i], a.rules.parameters[0]
    if current == NO_CHOICE or not a.rules.waits[i, current] <= g.step:
        return
    if current < p.pellet_slots and not a.rules.alive[i, current]:
        return
    g.pursued = current
    g.sent = g.step - p.min_dwell
    navigator.send_goal(g, goal_of(g, current, p), g.step)
    g.nav_next_aborts = 0
    g.nav_next_step = g.nav_plan_step = g.step
    navigator.plan(g, i, a.paths, a.rules.obstacles[i], p, level, a.search)
    g.nav_stream, early = below(g.nav_stream, p.plan_steps)  # the phase of the planner's timer is unknown
    g.nav_plan_step -= early


@kernel
def _draw_behaviour(belief, k, i, count, state):  # type: ignore[no-untyped-def]
    """Return the behaviour of ghost k in future i of ``count``, in ``BELIEVED``; ``other`` becomes wandering."""
    at = (state >> np.uint64(11)) * (1.0 / 9007199254740992.0) + i * (2 * k + 1) / count
    at -= math.floor(at)
    for which in (ARCADE, CHASES):
        at -= belief[which]
        if at < 0.0:
            return which
    return WANDERS


@kernel
def _draw_target(ghost, path, level, search):  # type: ignore[no-untyped-def]
    """Draw the target of a wandering ghost again, so that the way to it begins with the ghost's present step.

    If no target does after ``_TRIES``, the ghost draws one at its next cell.
    """
    first, following, length = path[0], path[1], ghost.path_length
    node, queue = search
    for _ in range(_TRIES):
        target = choose_target(ghost, first, level.ghost_part, level.ghost_part_start, level.ghost_part_cells)
        count = find_path(np.int64(first), np.int64(target), level.ghost_graph, node, queue, path)
        if count > 0 and (length == 1 or (count > 1 and path[1] == following)):
            ghost.path_length = count
            return
    path[0], path[1] = first, following


@kernel
def _place_ghost(ghosts, i, k, s, j, count, step, level):  # type: ignore[no-untyped-def]
    """Place ghost k of game i on its way from cell ``step[0]`` to ``step[1]``, and draw behaviour and target.

    The behaviours in the ``count`` games are drawn by systematic sampling, which keeps their shares.
    """
    g, p = ghosts.games[i], ghosts.parameters[0]
    ghost, path, now = ghosts.ghosts[i, k], ghosts.paths[i, k], ghosts.obstacles[i, k]
    start = below(ghost_stream(g.seed, k), len(level.spawn_cells))
    ghost.stream = start[0]
    away, frightened = s.fright[j, k, AWAY_S], s.fright[j, k, FRIGHTENED_S]
    spawn(ghost, np.int64(step[0]) if away > 0.0 else np.int64(level.spawn_cells[start[1]]), path, level.ghost_xy)
    ghost.x, ghost.y, ghost.vx, ghost.vy, ghost.speed = s.ghosts[j, k]
    ghost.belief[:] = s.belief[j, k]
    ghost.gone, ghost.fled = away > 0.0, frightened > 0.0
    now[AWAY_UNTIL] = g.step + away / p.dt if away > 0.0 else 0.0
    now[HARMLESS_UNTIL] = g.step + max(away, frightened) / p.dt if max(away, frightened) > 0.0 else 0.0
    which = _draw_behaviour(s.belief[j, k], k, i, count, stream(ghosts.games[0].seed, POLICY + 16 * k))
    ghost.behaviour = 1 + which
    ghost.wanders = which == WANDERS and not ghost.fled
    path[0], path[1] = step[0], step[1]
    ghost.path_length = 1 if step[0] == step[1] else 2
    ghost.path_index = 0
    dx, dy = ghost.x - level.ghost_xy[path[0], 0], ghost.y - level.ghost_xy[path[0], 1]
    ghost.path_offset = math.sqrt(dx * dx + dy * dy) if ghost.path_length == 2 else 0.0
    if ghost.wanders and not ghost.gone:
        _draw_target(ghost, path, level, ghosts.search)


@kernel
def _start(table, situation, j, count):  # type: ignore[no-untyped-def]
    """Start the first ``count`` games of a batch in situation j.

    ``table`` and ``situation`` are the addresses of ``TickArrays`` and ``SituationArrays``.
    """
    a, s = tick_arrays(table), situation_arrays(situation)
    ghosts = ghost_arrays(address_of(a.ghosts))
    level = level_arrays(a.rules.levels[0])
    steps = np.empty((ghosts.ghosts.shape[1], 2), np.int32)  # the cells between which each ghost is
    for k in range(len(steps)):
        steps[k] = step_of(s.ghosts[j, k], level.ghost_xy, level.ghost_graph)
    for i in range(count):
        _place_robot(a, i, s, j)
        _set_goals(a, i, s, j)
        for k in range(len(steps)):
            _place_ghost(ghosts, i, k, s, j, count, steps[k], level)
        g = a.rules.games[i]
        see_ghosts(g, ghosts.ghosts[i], ghosts.obstacles[i])
        bx, by, _ = believed(g, a.rules.parameters[0].use_tf)
        _, g.distance = nearest(bx, by, ghosts.obstacles[i], g.step)
        g.closing = s.closing_speed[j]
        _continue_goal(a, i, s.current[j], level)


def games_from(situation: Situation, i: int, batch: GameBatch, seeds: NDArray[np.uint64]) -> None:
    """Start a game from situation ``i`` in the first games of ``batch``, one for each of ``seeds`` (M,).

    ``batch`` is made by :func:`games_for`. Equal ``seeds`` give equal games; the shares of the ghosts' behaviours are
    kept over all M games, so the behaviours in a game also depend on the first seed and on M.
    """
    level = maps_of(situation).level(int(situation.level[i]))
    if batch.levels.level(0) is not level:
        batch.levels.put(0, 0, level)
    fresh = draw_episodes(seeds, batch.config)
    fresh["seed"] = seeds
    fresh["pellets"] = min(level.facts.pellets, batch.pellet_slots)
    fresh["refuges"] = min(level.facts.refuges, batch.refuge_slots)
    batch.games[: len(seeds)] = fresh
    _, (table, *_) = batch.tick_stage()
    _start(table.address, situation.table.address, i, len(seeds))
