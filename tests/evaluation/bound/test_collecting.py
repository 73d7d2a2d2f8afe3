"""The least time is one that no tour undercuts."""

import itertools

import numpy as np

from pacman_env.evaluation.bound.collecting import least_collection_s, ways_from
from tests.evaluation.bound.maps import config_of, graph_of


def test_path_lengths_are_symmetric_and_at_least_straight() -> None:
    graph = graph_of("ring")
    ways = np.stack([ways_from(graph, k) for k in range(0, len(graph.robot_xy), 20)])
    places = np.arange(0, len(graph.robot_xy), 20)
    np.testing.assert_allclose(ways[:, places], ways[:, places].T)
    straight = np.hypot(*(graph.robot_xy[places][:, None] - graph.robot_xy[None]).transpose(2, 0, 1))
    assert (ways >= straight - 1.5 * graph.edge_m).all()


def test_least_collection_time_never_exceeds_any_pellet_order() -> None:
    graph, config = graph_of("ring"), config_of()
    rng = np.random.default_rng(0)
    for _ in range(5):
        home, *pellets = rng.choice(len(graph.robot_xy), size=5, replace=False).tolist()
        least = least_collection_s(graph, home, np.array(pellets, dtype=np.int32), config)
        ways = {k: ways_from(graph, k) for k in (home, *pellets)}
        shortest = min(
            sum(ways[a][b] for a, b in itertools.pairwise((home, *order))) for order in itertools.permutations(pellets)
        )
        assert 0.0 <= least <= shortest / config.robot.speed_mps


def test_least_collection_time_is_zero_without_pellets() -> None:
    assert least_collection_s(graph_of("ring"), 0, np.array([], dtype=np.int32), config_of()) == 0.0
