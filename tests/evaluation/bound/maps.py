"""Tiny maps of which the answer is known."""

import functools
from typing import Any

from pacman_env.config import Config, make_config
from pacman_env.evaluation.bound.graph import Graph, build_graph, targets_of
from pacman_env.evaluation.bound.pursuit import pace, survival
from pacman_env.game.ghosts import find_behaviour
from pacman_env.sim.maps.assets import MapAssets, map_assets
from tests.drawn import box, drawn

SQUARE_M = 0.7  # wide enough for a ghost
SIDE = 4
MAPS = {
    "ring": [
        *["#" * (SIDE + 4), "#" + "." * (SIDE + 2) + "#"],
        *["#." + "#" * SIDE + ".#"] * SIDE,
        *["#" + "." * (SIDE + 2) + "#", "#" * (SIDE + 4)],
    ],
    "corridor": box(10, 1),
    "room": box(3, 3),
}
ROBOT_MPS = 0.306
RADIUS_M = 0.25


def config_of(ghosts: str = "chase", **changes: Any) -> Config:
    return make_config("ideal", **{"clyde.ghosts": (ghosts,), "pellets.spacing_m": 1.0, **changes})


@functools.cache
def assets_of(name: str) -> MapAssets:
    return map_assets(drawn(MAPS[name], square_m=SQUARE_M), config_of())


@functools.cache
def graph_of(name: str) -> Graph:
    return build_graph(assets_of(name))


@functools.cache
def targets(name: str, ghosts: str = "chase") -> Any:
    return targets_of(graph_of(name), assets_of(name), find_behaviour(ghosts), config_of(ghosts))


@functools.cache
def left(name: str, speed: float, ghosts: str = "chase") -> Any:
    """(B, A) until the ghost, which stands in its block, has caught the robot."""
    graph = graph_of(name)
    return survival(graph, targets(name, ghosts), pace(graph, ROBOT_MPS, speed), RADIUS_M)[:, :, 0]
