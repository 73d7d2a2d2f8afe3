"""Beam search over segments: drive to a goal for some seconds, then choose again, while the ghosts react.

Nodes are stored in layers by time. The best nodes of each layer are continued; of nodes with the same place, goal and
pellets only the best one. The value of a node is the worth of its collected pellets (more for earlier ones), reduced if
a ghost came near, for a long way to the next pellet, and a little for a short lead. Its safety is the same number with
the full reduction for a short lead; it counts at the end of the horizon. In all kernels ``s`` is a record of
``SETTINGS`` (``search.py``) and ``model`` a ``Model``.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...engine.jit import kernel
from ...observations.learner_layout import insert_nearest
from ...sim.coarse_model import GHOST, NOWHERE, ROBOT, copy_ghosts, lead_m, play

NODE = np.dtype(
    [
        *ROBOT,
        ("first", np.int32),  # index of the first choice
        ("value", np.float64),
        ("safety", np.float64),  # value with the full reduction for a short lead
    ]
)
DEAD = -1000.0  # value of a first choice that always leads to death; the seconds until death are added
PRUNED = -500.0  # added to the value of a first choice if no line after it was followed to the end


class BeamMemory(NamedTuple):
    """Scratch memory for L waiting layers with room for K nodes of G ghosts."""

    nodes: Any  # (L, K) NODE
    ghosts: Any  # (L, K, G) GHOST
    counts: Any  # (L,)
    goals: Any  # goals of one node
    kept: Any  # continued nodes of a layer


def new_memory(width: int, ghosts: int, settings: NDArray[Any]) -> BeamMemory:
    layers = int(np.ceil(settings["segment_s"][0] / settings["layer_s"][0])) + 2
    choices = int(settings["pellets"][0] + settings["refuges"][0]) + 2
    most = layers * width * choices
    return BeamMemory(
        np.zeros((layers, most), NODE),
        np.zeros((layers, most, ghosts), GHOST),
        np.zeros(layers, np.int64),
        np.zeros(choices, np.int64),
        np.zeros(width, np.int64),
    )


@kernel
def _list_goals(node, model, s, refuges, goals):  # type: ignore[no-untyped-def]
    """Write the goals with which a node may be continued to ``goals`` (int64), and return their number.

    Goals from ``refuges`` on are refuges.
    """
    length = model.map.robot_length[node.block]
    most = s.pellets + s.refuges
    goals[:most] = -1
    for goal in range(len(model.bit)):
        bit = model.bit[goal]
        if length[goal] == np.inf or goal == node.goal:
            continue
        if bit >= 0:
            if (node.pellets >> np.uint64(bit)) & np.uint64(1):
                insert_nearest(goals, 0, s.pellets, goal, length)
        elif goal >= refuges and length[goal] > model.rules[0].goal_m:
            insert_nearest(goals, s.pellets, s.refuges, goal, length)
    count = 0
    for k in range(most):
        if goals[k] >= 0:
            goals[count] = goals[k]
            count += 1
    goals[count] = NOWHERE
    count += 1
    if node.goal >= 0:
        goals[count] = node.goal
        count += 1
    return count


@kernel
def _rate(node, ghosts, model, s, start_s, over):  # type: ignore[no-untyped-def]
    """Set a node's value and safety, given its ghosts (G,).

    ``start_s`` is the time at the start of the search; ``over`` is True if the round ends at the node.
    """
    value = s.pellet_worth * node.collected - s.second_worth * (node.collected_s - start_s * node.collected)
    if node.closest_m < s.near_m:
        value -= s.near_worth * (1.0 - node.closest_m / s.near_m)
    lost = 0.0
    if node.pellets == 0:
        value += s.completion_worth
    elif not over:
        far = min(lead_m(node, ghosts, model.map) / s.lead_m, 1.0)
        lost = s.lead_worth * (1.0 - far) ** 2
        length = model.map.robot_length[node.block]
        nearest = np.inf
        for goal in range(len(model.bit)):
            bit = model.bit[goal]
            if bit >= 0 and (node.pellets >> np.uint64(bit)) & np.uint64(1):
                nearest = min(nearest, length[goal])
        if nearest < np.inf:
            value -= s.metre_worth * nearest
    node.value, node.safety = value - s.lead_share * lost, value - lost


@kernel
def _same(a, b):  # type: ignore[no-untyped-def]
    """Return True if two nodes have the same place, goals and pellets."""
    return (a.block == b.block) & (a.pellets == b.pellets) & (a.goal == b.goal) & (a.then == b.then)


@kernel
def _keep_best(nodes, order, count, width, kept):  # type: ignore[no-untyped-def]
    """Append the indices ``order`` of a layer's nodes to ``kept``; skip nodes equivalent to a node in ``kept``.

    ``kept`` contains ``count`` indices before. Return the new count, at most ``width``.
    """
    for k in range(len(order)):
        if count >= width:
            break
        node = nodes[order[k]]
        alike = False
        for j in range(count):
            alike |= _same(node, nodes[kept[j]])
        if not alike:
            kept[count] = order[k]
            count += 1
    return count


@kernel
def _keep(nodes, width, kept):  # type: ignore[no-untyped-def]
    """Write the indices of the nodes to continue to ``kept`` (half by value, half by safety); return their number.

    By value alone, lines that collect pellets and then die would crowd out lines that survive.
    """
    count = _keep_best(nodes, np.argsort(-nodes.value, kind="mergesort"), 0, (width + 1) // 2, kept)
    return _keep_best(nodes, np.argsort(-nodes.safety, kind="mergesort"), count, width, kept)


@kernel
def search(begin, choices, settings, room, best):  # type: ignore[no-untyped-def]
    """Write to ``best`` (R,) the value of the best line that starts with each of the goals ``choices`` (R,).

    ``begin`` is a ``CoarseStart`` whose robot is a ``NODE``, ``settings`` (1,) are SETTINGS, and ``room`` is a
    ``BeamMemory``. Returns the number of played segments.
    """
    s, model, start_s = settings[0], begin.model, begin.robot[0].time_s
    layers = len(room.counts)
    room.counts[:] = 0
    best[:] = DEAD
    played = 0
    for layer in range(-1, s.layers):
        current, following = (layer + layers) % layers, (layer + 1) % layers
        nodes, ghosts = room.nodes[current], room.ghosts[current]
        continued = 1
        if layer < 0:
            nodes[0] = begin.robot[0]
            copy_ghosts(begin.ghosts, ghosts[0])
            room.kept[0] = 0
        else:
            continued = _keep(nodes[: room.counts[current]], s.width, room.kept)
            for k in range(room.counts[current]):
                best[nodes[k].first] = max(best[nodes[k].first], nodes[k].value + PRUNED)
        for k in range(continued):
            node = room.kept[k]
            count = len(choices)
            if layer >= 0:
                count = _list_goals(nodes[node], model, s, begin.pellets, room.goals)
            for j in range(count):
                goal = choices[j] if layer < 0 else room.goals[j]
                # A child is created behind the nodes of the next layer, where it stays if it belongs to that layer.
                at = room.counts[following]
                room.nodes[following, at] = nodes[node]
                child, child_ghosts = room.nodes[following, at], room.ghosts[following, at]
                copy_ghosts(ghosts[node], child_ghosts)
                if layer < 0:
                    child.first = j
                play(child, child_ghosts, goal, child.time_s + s.segment_s, model)
                played += 1
                if child.dead:
                    best[child.first] = max(best[child.first], DEAD + child.time_s - start_s)
                    continue
                over = child.pellets == 0 or child.time_s >= model.rules[0].limit_s
                target = max(int((child.time_s - start_s) / s.layer_s), layer + 1)
                _rate(child, child_ghosts, model, s, start_s, over)
                if over or target >= s.layers:
                    best[child.first] = max(best[child.first], child.safety)
                elif target == layer + 1:
                    room.counts[following] += 1
                else:
                    slot = target % layers
                    room.nodes[slot, room.counts[slot]] = child
                    copy_ghosts(child_ghosts, room.ghosts[slot, room.counts[slot]])
                    room.counts[slot] += 1
        if layer >= 0:
            room.counts[current] = 0
    return played
