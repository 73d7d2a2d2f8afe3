"""Who is safe on maps where that is known: on a ring from a slow chaser, nowhere in a corridor from a fast one."""

import itertools

import numpy as np
import pytest

from pacman_env.evaluation.bound.pursuit import FOR_EVER, UNIT_S, from_start, pace
from tests.evaluation.bound.maps import MAPS, ROBOT_MPS, graph_of, left

SPEEDS = (0.2, 0.3, 0.45, 0.9)


def beyond(name: str, least_m: float) -> np.ndarray:
    """(B, A) whether the ghost's way to the robot is longer than this."""
    graph = graph_of(name)
    return np.asarray(least_m < graph.ghost_length[:, graph.snap].T)


@pytest.mark.parametrize("speed", [0.2, 0.3, ROBOT_MPS])
def test_robot_on_ring_escapes_slower_or_equal_chaser(speed: float) -> None:
    assert (left("ring", speed)[beyond("ring", 1.0)] == FOR_EVER).all()


@pytest.mark.parametrize(("name", "speed"), [("corridor", 0.45), ("room", 0.9), ("ring", 0.9)])
def test_faster_chaser_catches_robot_everywhere(name: str, speed: float) -> None:
    assert (left(name, speed) != FOR_EVER).all()


def test_robot_at_corridor_end_is_caught_on_arrival() -> None:
    graph = graph_of("corridor")
    end = int(graph.robot_xy[:, 0].argmax())
    ghost = int(graph.ghost_xy[:, 0].argmin())
    way = float(graph.ghost_length[graph.snap[end], ghost])
    seconds = float(left("corridor", 0.9)[end, ghost]) * UNIT_S
    assert (way - 0.5) / 0.9 <= seconds <= 2.0 * way / 0.9


@pytest.mark.parametrize("name", MAPS)
def test_faster_ghost_never_enlarges_safe_set(name: str) -> None:
    safe = [left(name, speed) == FOR_EVER for speed in SPEEDS]
    for slow, fast in itertools.pairwise(safe):
        assert not (fast & ~slow).any()


def test_robot_can_stay_in_safe_set() -> None:
    """From a safe pair the robot can reach, or keep, a block that is safe from some block of the ghost's."""
    graph, found = graph_of("ring"), left("ring", 0.3)
    safe = (found == FOR_EVER).any(axis=1)
    for r in np.flatnonzero(safe):
        beside = graph.move_to[graph.first_move[r] : graph.first_move[r + 1]]
        assert safe[r] or safe[beside].any()


def test_pace_is_rounded_in_favour_of_robot() -> None:
    graph = graph_of("ring")
    for speed in SPEEDS:
        step = pace(graph, ROBOT_MPS, speed)
        per_straight = 4 * speed / (1.0824 * ROBOT_MPS)
        assert step.walked[0] <= per_straight
        assert step.walked[1] <= per_straight * np.sqrt(2.0)
        assert step.lasts[0] * UNIT_S >= graph.edge_m / (1.0824 * ROBOT_MPS)


def test_survival_from_start_is_at_least_table_value() -> None:
    graph = graph_of("corridor")
    table = left("corridor", 0.45)[:, :, None]
    step = pace(graph, ROBOT_MPS, 0.45)
    robot = 10
    ghosts = np.arange(len(graph.ghost_xy), dtype=np.int32)
    found = from_start(graph, table, step, robot, ghosts)
    assert (found >= UNIT_S * table[robot, :, 0]).all()
    assert np.isfinite(found).all()
