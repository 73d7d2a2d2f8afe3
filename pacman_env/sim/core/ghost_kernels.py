"""The ghosts' part of a step, compiled, looped over the games of a batch; their rules live in ``game/ghosts.py``."""

from __future__ import annotations

from ...game import ghosts as rule
from ...jit import kernel
from ...world.navigation.grid import cell_of
from .kernels import believed, see_ghosts
from pacman_env.game.execution import RUNNING


@kernel
def decide_ghosts(  # type: ignore[no-untyped-def]
    games, ghosts, ghost_paths, choices, remembered, behaviours, parameters, places, arrays, node, queue
):
    """Where the ghosts that do not just wander go now; ``choices`` (N, G) are those of ``policy`` ghosts.

    A choice is one of the robot's candidates, whose place he then goes to, or the last one: wander on. ``places`` is
    (affine, snap to his cells, cell of each goal, corners), ``arrays`` his cells, all stacked; ``remembered``
    (N, T, G) keeps the choices by the tick.
    """
    affine, snap, place, corner = places
    graph, part, part_start, part_cells = arrays
    p = parameters[0]
    on = p.pellet_slots + p.refuge_slots
    for i in range(len(games)):
        g = games[i]
        if g.end != RUNNING:
            continue
        m = g.level
        for k in range(ghosts.shape[1]):
            ghost, path = ghosts[i, k], ghost_paths[i, k]
            target = -1
            if behaviours[k] == rule.WANDER:
                continue
            if behaviours[k] == rule.POLICY:
                chosen = choices[i, k]
                remembered[i, g.tick, k] = chosen
                goal = chosen if chosen < p.pellet_slots else g.pellets + chosen - p.pellet_slots
                if chosen < on and goal < g.pellets + g.refuges and (chosen >= p.pellet_slots or chosen < g.pellets):
                    target = place[m, goal]
            else:
                bx, by, _ = believed(g, p.use_tf)
                column, row = cell_of(affine[m], snap.shape[1], snap.shape[2], bx, by)
                target = snap[m, row, column]
                if behaviours[k] == rule.ARCADE and not rule.arcade_chases(
                    bx - ghost.x, by - ghost.y, p.arcade_distance
                ):
                    target = corner[m, k]
            here = path[ghost.at]
            ghost.wanders = target < 0 or part[m, here] != part[m, target]
            if behaviours[k] == rule.POLICY:
                ghost.place = -1 if ghost.wanders else chosen
            if not ghost.wanders:
                ways = (graph[m], part[m], part_start[m], part_cells[m])
                rule.head_for(ghost, path, target, ways, node, queue)


@kernel
def move_ghosts(games, ghosts, ghost_paths, obstacles, parameters, ghost_xy):  # type: ignore[no-untyped-def]
    """The ghosts' update in the games where it is due; returns how many now need a target."""
    p = parameters[0]
    waiting = 0
    for i in range(len(games)):
        g = games[i]
        if g.end == RUNNING and g.step % p.clyde_steps == 0:
            for k in range(ghosts.shape[1]):
                ghost = ghosts[i, k]
                rule.walk(ghost, ghost_paths[i, k], ghost_xy[g.level], p.clyde_period)
                waiting += ghost.wanders & rule.at_target(ghost)
            see_ghosts(g, ghosts[i], obstacles[i])
    return waiting


@kernel
def retarget_ghosts(games, ghosts, ghost_paths, parameters, arrays, node, queue):  # type: ignore[no-untyped-def]
    """A new target and way for every wandering ghost that is due and stands at the end of his."""
    graph, part, part_start, part_cells = arrays
    p = parameters[0]
    for i in range(len(games)):
        g = games[i]
        # Not due, but at the end: his last target was the cell he stands on, and his next update comes first.
        if g.end == RUNNING and g.step % p.clyde_steps == 0:
            m = g.level
            for k in range(ghosts.shape[1]):
                ghost = ghosts[i, k]
                if ghost.wanders & rule.at_target(ghost):
                    ways = (graph[m], part[m], part_start[m], part_cells[m])
                    rule.wander(ghost, ghost_paths[i, k], ways, node, queue)
