"""A beam search over segments: drive to a goal for some seconds, then choose again, while the ghosts react.

Nodes are kept in layers by their time. Of each layer the best are continued, of those that are at the same place with
the same goal and pellets only the best one. The value of a node is what was collected, earlier is better, less for a
ghost that came near, and at the end of the horizon for how far the ghosts' paths to the robot are.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...engine.jit import kernel
from ...sim.coarse.model import GHOST, NOWHERE, ROBOT, choose, lead_m, step

NODE = np.dtype([*ROBOT, ("first", np.int32), ("value", np.float64)])
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
        ("lead_worth", np.float64),  # of a ghost that is far, at the end of the horizon
        ("lead_m", np.float64),  # far, by its path
        ("metre_worth", np.float64),  # of the path to the nearest pellet left, at the end of the horizon
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
    goals: Any  # (K,) of one node
    kept: Any  # (K,) of a layer


def new_room(width: int, ghosts: int, goals: int, settings: NDArray[Any]) -> Room:
    layers = int(np.ceil(settings["segment_s"][0] / settings["layer_s"][0])) + 2
    choices = int(settings["pellets"][0] + settings["refuges"][0]) + 2
    most = max(layers * width * choices, goals + 1)
    return Room(
        np.zeros((layers, most), NODE),
        np.zeros((layers, most, ghosts), GHOST),
        np.zeros(layers, np.int64),
        np.zeros(max(choices, goals + 1), np.int64),
        np.zeros(width, np.int64),
    )


@kernel
def _insert_nearest(goals, first, room, goal, length):  # type: ignore[no-untyped-def]
    """Insert a goal into the sorted ``goals[first : first + room]``, of which -1 are free; ``length`` is by goal."""
    place = room
    while place > 0:
        other = goals[first + place - 1]
        if other >= 0 and length[other] <= length[goal]:
            break
        place -= 1
    for k in range(room - 1, place, -1):
        goals[first + k] = goals[first + k - 1]
    if place < room:
        goals[first + place] = goal


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
                _insert_nearest(goals, 0, s.pellets, goal, length)
        elif goal >= refuges and length[goal] > model.rules[0].goal_m:
            _insert_nearest(goals, s.pellets, s.refuges, goal, length)
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
def _value(node, ghosts, model, s, at_end):  # type: ignore[no-untyped-def]
    value = s.pellet_worth * node.collected - s.second_worth * node.collected_s
    if node.closest_m < s.near_m:
        value -= s.near_worth * (1.0 - node.closest_m / s.near_m)
    if node.pellets == 0:
        return value + s.completion_worth
    if at_end:
        far = min(lead_m(node, ghosts, model.map) / s.lead_m, 1.0)
        value -= s.lead_worth * (1.0 - far) ** 2
        length = model.map.robot_length[node.block]
        nearest = np.inf
        for goal in range(len(model.bit)):
            bit = model.bit[goal]
            if bit >= 0 and (node.pellets >> np.uint64(bit)) & np.uint64(1):
                nearest = min(nearest, length[goal])
        if nearest < np.inf:
            value -= s.metre_worth * nearest
    return value


@kernel
def _same(a, b):  # type: ignore[no-untyped-def]
    return (a.block == b.block) & (a.pellets == b.pellets) & (a.goal == b.goal) & (a.then == b.then)


@kernel
def _keep_best(nodes, count, width, kept):  # type: ignore[no-untyped-def]
    """Number the best nodes of a layer, one of those that are alike; returns how many."""
    order = np.argsort(-nodes[:count].value, kind="mergesort")
    found = 0
    for k in range(count):
        node = nodes[order[k]]
        alike = False
        for j in range(found):
            alike |= _same(node, nodes[kept[j]])
        if not alike:
            kept[found] = order[k]
            found += 1
            if found == width:
                break
    return found


@kernel
def _copy(ghosts, other):  # type: ignore[no-untyped-def]
    for k in range(len(ghosts)):
        other[k] = ghosts[k]


@kernel
def search(root, ghosts, choices, model, settings, refuges, room, best):  # type: ignore[no-untyped-def]
    """Fill in the value of the best line that begins with each of the ``choices`` (R,), goals of the map.

    ``root`` (1,) and ``ghosts`` (G,) are where it begins, ``refuges`` the number of the first goal that is none of the
    pellets. Returns how many segments were played.
    """
    s = settings[0]
    start_s, layers = root[0].time_s, len(room.counts)
    room.counts[:] = 0
    best[:] = DEAD
    played = 0
    for layer in range(-1, s.layers):
        here = (layer + layers) % layers
        nodes, many = room.nodes[here], room.ghosts[here]
        if layer < 0:
            nodes[0] = root[0]
            _copy(ghosts, many[0])
            room.kept[0] = 0
            kept = 1
        else:
            kept = _keep_best(nodes, room.counts[here], s.width, room.kept)
            for k in range(room.counts[here]):
                best[nodes[k].first] = max(best[nodes[k].first], nodes[k].value + PRUNED)
        for k in range(kept):
            node = nodes[room.kept[k]]
            if layer < 0:
                count = len(choices)
                room.goals[:count] = choices
            else:
                count = _list_goals(node, model, s, refuges, room.goals)
            for j in range(count):
                played += 1
                after, until_s = -1, node.time_s + s.segment_s
                # The child is played where it will lie, in a layer that is known only then: last in the next one.
                there = (layer + 1) % layers
                at = room.counts[there]
                child, its = room.nodes[there, at], room.ghosts[there, at]
                room.nodes[there, at] = node
                _copy(many[room.kept[k]], its)
                if layer < 0:
                    child.first = j
                choose(child, room.goals[j], model)
                while child.time_s < until_s:
                    step(child, its, model)
                    if child.dead or child.reached or child.pellets == 0 or child.time_s >= model.rules[0].limit_s:
                        break
                if child.dead:
                    best[child.first] = max(best[child.first], DEAD + child.time_s - start_s)
                    continue
                after = int((child.time_s - start_s) / s.layer_s)
                over = child.pellets == 0 or child.time_s >= model.rules[0].limit_s
                child.value = _value(child, its, model, s, not over)
                if over or after >= s.layers:
                    best[child.first] = max(best[child.first], child.value)
                    continue
                after = max(after, layer + 1)
                if after > layer + 1:
                    goes = after % layers
                    room.nodes[goes, room.counts[goes]] = child
                    _copy(its, room.ghosts[goes, room.counts[goes]])
                    there = goes
                room.counts[there] += 1
        if layer >= 0:
            room.counts[here] = 0
    return played
