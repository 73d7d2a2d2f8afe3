"""Ways in strides against the ways cell by cell that they stand for."""

from __future__ import annotations

import numpy as np
import pytest

from pacman_env.config import make_config
from pacman_env.sim.assets import MapAssets, map_assets
from pacman_env.sim.generated import prepare_level
from pacman_env.world.paths import AT_GOAL, NO_STEP, UNREACHABLE_CM
from pacman_env.world.waypoints import STRIDE_M

CONFIG = make_config()


def assets_of(source: str) -> MapAssets:
    return prepare_level(3, CONFIG) if source == "generated" else map_assets(source, CONFIG)


@pytest.mark.parametrize("source", ["house", "maze", "loop", "generated"])
def test_every_way_ends_at_its_goal_and_is_hardly_longer_than_cell_by_cell(source: str) -> None:
    assets = assets_of(source)
    _, xy, onward = assets.waypoints
    for goal, cell in enumerate(assets.goal_cell):
        if cell < 0:
            assert (onward[goal] == NO_STEP).all()
            continue
        for start in range(0, len(xy), 17):
            at, way = start, [xy[start]]
            while onward[goal, at] != AT_GOAL:
                at += onward[goal, at]
                way.append(xy[at])
                assert len(way) <= len(xy), "the way runs in a circle"
            way.append(assets.cell_xy[cell])
            length = np.hypot(*np.diff(np.array(way), axis=0).T).sum()
            nearest = np.hypot(*(assets.cell_xy - xy[start]).T).argmin()
            shortest = assets.length_cm[nearest, goal] / 100
            assert 0.7 * shortest - 0.1 <= length <= 1.15 * shortest + 2 * STRIDE_M


@pytest.mark.parametrize("source", ["house", "generated"])
def test_the_waypoint_of_a_cell_is_near_it(source: str) -> None:
    assets = assets_of(source)
    off = np.hypot(*(assets.waypoints.xy[assets.waypoints.of_cell] - assets.cell_xy).T)
    assert off.max() <= STRIDE_M * np.sqrt(2)
    assert len(assets.waypoints.xy) < len(assets.cell_xy) / 8


@pytest.mark.parametrize("source", ["house", "generated"])
def test_a_stride_leads_to_where_the_way_is_after_it(source: str) -> None:
    assets = assets_of(source)
    _, xy, onward = assets.waypoints
    strides = np.array([xy[w + o] - xy[w] for row in onward for w, o in enumerate(row) if o not in (AT_GOAL, NO_STEP)])
    length = np.hypot(*strides.T)
    assert 0.2 < np.median(length) < 0.4
    assert length.max() < 1.0
    reachable = assets.length_cm.max(axis=0) < UNREACHABLE_CM
    assert (onward[reachable] != NO_STEP).all()
