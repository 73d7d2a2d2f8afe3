"""Moves are between squares that touch and lead back; targets are those of the ghost's own function."""

import math

import numpy as np
import pytest

from pacman_env.evaluation.bound.graph import DIAGONAL, STRAIGHT, build_graph, targets_of
from pacman_env.game.ghosts import Behaviour, find_behaviour
from tests.evaluation.bound.maps import MAPS, assets_of, config_of, graph_of, targets


@pytest.mark.parametrize("name", MAPS)
def test_graph_moves_are_reversible_and_short(name: str) -> None:
    graph = graph_of(name)
    here = np.repeat(np.arange(len(graph.robot_xy)), np.diff(graph.first_move))
    moves = set(zip(here.tolist(), graph.move_to.tolist(), graph.move_kind.tolist(), strict=True))
    assert {(b, a, kind) for a, b, kind in moves} == moves
    assert set(graph.move_kind.tolist()) == {STRAIGHT, DIAGONAL}
    apart = np.hypot(*(graph.robot_xy[here] - graph.robot_xy[graph.move_to]).T)
    assert apart.max() < 3.0 * graph.edge_m


def test_graph_coarsens_until_pairs_fit_limit() -> None:
    coarse = build_graph(assets_of("ring"), most_pairs=4000)
    assert len(coarse.robot_xy) * len(coarse.ghost_xy) <= 4000
    assert coarse.edge_m > graph_of("ring").edge_m


def test_chasing_ghost_targets_block_nearest_to_robot() -> None:
    graph = graph_of("ring")
    found = targets("ring")
    np.testing.assert_array_equal(found[:, :, 0], np.broadcast_to(graph.snap[:, None], found.shape[:2]))


def test_arcade_ghost_targets_its_corner_near_robot() -> None:
    graph = graph_of("ring")
    found = targets("ring", "arcade")
    apart = np.hypot(*(graph.robot_xy[:, None] - graph.ghost_xy[None]).transpose(2, 0, 1))
    far, near = apart > 2.3, apart < 1.7
    np.testing.assert_array_equal(found[:, :, 0][far], np.broadcast_to(graph.snap[:, None], found.shape[:2])[far])
    assert len(np.unique(found[:, :, 0][near])) == 1
    both = (found[:, :, 1] >= 0) & (np.abs(apart - 2.0) < 0.3)
    assert both.any()  # at the distance where it turns away, either


@pytest.mark.parametrize(
    "behaviour",
    [
        find_behaviour("wander"),
        Behaviour("ahead", lambda view, parameters: (view.robot_x + math.cos(view.robot_heading), view.robot_y)),
    ],
)
def test_behaviour_that_needs_more_than_positions_is_refused(behaviour: Behaviour) -> None:
    with pytest.raises(ValueError, match=f"ghosts {behaviour.name}"):
        targets_of(graph_of("corridor"), assets_of("corridor"), behaviour, config_of())


def test_custom_behaviour_determines_targets() -> None:
    home = Behaviour("home", lambda view, parameters: (view.corner_x, view.corner_y))
    found = targets_of(graph_of("corridor"), assets_of("corridor"), home, config_of())
    assert len(np.unique(found[:, :, 0])) == 1
    assert (found[:, :, 1:] == -1).all()
