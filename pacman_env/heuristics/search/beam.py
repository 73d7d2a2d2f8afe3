"""A beam search over segments: drive to a goal for some seconds, then choose again, while the ghosts react.

Nodes are kept in layers by their time. Of each layer the best are continued, of those that are at the same place with
the same goal and pellets only the best one. The value of a node is what was collected, earlier is better, less for a
ghost that came near; its safety is less for a short lead, too, and is what counts at the end of the horizon.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...engine.jit import kernel
from ...sim.coarse.model import GHOST, NOWHERE, ROBOT, copy_ghosts, lead_m, play
from ...sim.observation.situation import insert_nearest

NODE = np.dtype(
    [
        *ROBOT,
        ("first", np.int32),  # of the choices
        ("value", np.float64),
        ("safety", np.float64),  # the same with all that a lead is worth
    ]
)
#: Numbers of the search.
SETTINGS = np.dtype(
    [
        ("width", np.int64),  # nodes of a layer that are continued
        ("layers", np.int64),
        ("layer_s", np.float64),
        ("segment_s", np.float64),  # a choice holds so long, or until its goal is reached
        ("pellets", np.int64),  # the nearest so many are goals ...
        ("refuges", np.int64),  # ... and so many refuges
        ("pellet_worth", np.float64),
        ("second_worth", np.float64),  # of a pellet that is collected a second earlier
        ("completion_worth", np.float64),
        ("lead_worth", np.float64),  # of ghosts that are far, in a node's safety ...
        ("lead_share", np.float64),  # ... and this share of it in its value
        ("lead_m", np.float64),  # far, by their paths
        ("metre_worth", np.float64),  # of the path to the nearest pellet left
        ("near_worth", np.float64),  # of a ghost that never came near
        ("near_m", np.float64),
    ]
)
DEAD = -1000.0  # the value of a first choice after which every line ends in death, and the s until then
PRUNED = -500.0  # added where no line was followed to the end


class Room(NamedTuple):
    """Scratch memory; L layers wait at a time, each with room for K nodes of G ghosts."""

    nodes: Any  # (L, K) NODE
    ghosts: Any  # (L, K, G) GHOST
    counts: Any  # (L,)
    goals: Any  # of one node
    kept: Any  # of a layer


def new_room(width: int, ghosts: int, settings: NDArray[Any]) -> Room:
    layers = int(np.ceil(settings["segment_s"][0] / settings["layer_s"][0])) + 2
    choices = int(settings["pellets"][0] + settings["refuges"][0]) + 2
    most = layers * width * choices
    return Room(
        np.zeros((layers, most), NODE),
        np.zeros((layers, most, ghosts), GHOST),
        np.zeros(layers, np.int64),
        np.zeros(choices, np.int64),
        np.zeros(width, np.int64),
    )


@kernel
def _list_goals(node, model, s, refuges, goals):  # type: ignore[no-untyped-def]
    """Fill in the goals that a node may be continued with; returns their number."""
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
    """Fill in a node's value and safety; ``over``: its line ends there."""
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
    return (a.block == b.block) & (a.pellets == b.pellets) & (a.goal == b.goal) & (a.then == b.then)


@kernel
def _keep_best(nodes, order, found, width, kept):  # type: ignore[no-untyped-def]
    """Add to the ``found`` nodes of a layer the first of an order, up to ``width``, one of those that are alike."""
    for k in range(len(order)):
        if found >= width:
            break
        node = nodes[order[k]]
        alike = False
        for j in range(found):
            alike |= _same(node, nodes[kept[j]])
        if not alike:
            kept[found] = order[k]
            found += 1
    return found


@kernel
def _keep(nodes, width, kept):  # type: ignore[no-untyped-def]
    """Number the nodes of a layer that are continued: half of them for their value, half for their safety.

    For their value alone, lines that collect and then die crowd out those that live.
    """
    found = _keep_best(nodes, np.argsort(-nodes.value, kind="mergesort"), 0, (width + 1) // 2, kept)
    return _keep_best(nodes, np.argsort(-nodes.safety, kind="mergesort"), found, width, kept)


@kernel
def search(begin, choices, settings, room, best):  # type: ignore[no-untyped-def]
    """Fill in the value of the best line that begins with each of the goals ``choices`` (R,).

    ``begin`` is a ``Start`` whose robot is a ``NODE``. Returns how many segments were played.
    """
    s, model, start_s = settings[0], begin.model, begin.robot[0].time_s
    layers = len(room.counts)
    room.counts[:] = 0
    best[:] = DEAD
    played = 0
    for layer in range(-1, s.layers):
        here, following = (layer + layers) % layers, (layer + 1) % layers
        nodes, ghosts = room.nodes[here], room.ghosts[here]
        kept = 1
        if layer < 0:
            nodes[0] = begin.robot[0]
            copy_ghosts(begin.ghosts, ghosts[0])
            room.kept[0] = 0
        else:
            kept = _keep(nodes[: room.counts[here]], s.width, room.kept)
            for k in range(room.counts[here]):
                best[nodes[k].first] = max(best[nodes[k].first], nodes[k].value + PRUNED)
        for k in range(kept):
            node = room.kept[k]
            count = len(choices)
            if layer >= 0:
                count = _list_goals(nodes[node], model, s, begin.pellets, room.goals)
            for j in range(count):
                goal = choices[j] if layer < 0 else room.goals[j]
                # A child is played where it lies if it is of the next layer, behind those that are there.
                at = room.counts[following]
                room.nodes[following, at] = nodes[node]
                child, its = room.nodes[following, at], room.ghosts[following, at]
                copy_ghosts(ghosts[node], its)
                if layer < 0:
                    child.first = j
                play(child, its, goal, child.time_s + s.segment_s, model)
                played += 1
                if child.dead:
                    best[child.first] = max(best[child.first], DEAD + child.time_s - start_s)
                    continue
                over = child.pellets == 0 or child.time_s >= model.rules[0].limit_s
                after = max(int((child.time_s - start_s) / s.layer_s), layer + 1)
                _rate(child, its, model, s, start_s, over)
                if over or after >= s.layers:
                    best[child.first] = max(best[child.first], child.safety)
                elif after == layer + 1:
                    room.counts[following] += 1
                else:
                    there = after % layers
                    room.nodes[there, room.counts[there]] = child
                    copy_ghosts(its, room.ghosts[there, room.counts[there]])
                    room.counts[there] += 1
        if layer >= 0:
            room.counts[here] = 0
    return played
