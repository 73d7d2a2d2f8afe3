import numpy as np
import pytest

from pacman_env.config import make_config
from pacman_env.levels.assets import MapAssets, map_assets
from pacman_env.world.navigation.paths import UNREACHABLE_CM
from tests.drawn import box, drawn
from tests.shared import shared_path

SHIPPED = ["house", "loop", "maze", "open_plan"]
#: A hall, and a corridor 0.5 m wide to its right with a bend: the robot fits in, Clyde does not.
NOOK = [
    "#####################",
    *["#............########"] * 4,
    *["#................####"] * 2,
    *["#............##..####"] * 4,
    "#####################",
]


def assets_of(source: str, **changes: object) -> MapAssets:
    path = source if source in SHIPPED else shared_path(f"maps/{source}")
    return map_assets(path, make_config("robot", **changes))


def nook_map(**changes: object) -> MapAssets:
    config = make_config("robot", **{"pellets.spacing_m": 0.5, "clyde.spawn_distance_m": 0.5, **changes})
    return map_assets(drawn(NOOK, square_m=0.25, origin=(-1.0, -1.5, 0.0)), config)


def places(assets: MapAssets) -> np.ndarray:
    return assets.goal_xy[assets.pellets :]


def from_clyde(assets: MapAssets, xy: np.ndarray) -> np.ndarray:
    """Distance of each place from the nearest point that Clyde's centre can come to, m."""
    cells = assets.clyde.part_cells
    start = assets.clyde.part_start
    inside = cells[start[assets.clyde_part] : start[assets.clyde_part + 1]]
    return np.hypot(*np.moveaxis(xy[:, None] - assets.clyde.position[inside][None], 2, 0)).min(axis=1)


@pytest.mark.parametrize("source", [*SHIPPED, "pacmanbot_house"])
def test_refuges_are_home_and_reachable_places(source: str) -> None:
    assets = assets_of(source)
    np.testing.assert_array_equal(places(assets)[0], assets.grid.home[:2])
    assert 8 <= assets.refuges <= 12
    goals = np.arange(assets.pellets, len(assets.goal_xy))
    assert (assets.goal_cell[goals] >= 0).all()
    assert (assets.length_cm[:, goals] < UNREACHABLE_CM).all()
    assert (assets.grid.cells_under(places(assets)) >= 0).all()
    xy = places(assets)
    apart = np.hypot(*np.moveaxis(xy[:, None] - xy[None], 2, 0)) + 9.0 * np.eye(len(xy))
    assert apart.min() > 0.3


def test_nook_out_of_a_ghosts_reach_is_found() -> None:
    assets = nook_map()
    distance = from_clyde(assets, places(assets))
    nooks = places(assets)[distance >= 0.42]
    assert len(nooks) >= 1
    assert (nooks[:, 0] > 2.2).all()  # in the corridor
    column, row = assets.grid.to_cell(*nooks[0])
    assert assets.grid.cell_id[row, column] >= 0


def test_refuges_of_an_open_floor_are_corners() -> None:
    config = make_config("robot", **{"clyde.spawn_distance_m": 0.5, "pellets.spacing_m": 1.0, "refuges.spread": 4})
    assets = map_assets(drawn(box(12, 12), origin=(-3.5, -3.5, 0.0)), config)
    assert (from_clyde(assets, places(assets)) < 0.42).all()
    assert assets.refuges == 5
    assert (np.abs(places(assets)[1:]) > 2.5).all()


def test_spread_refuges_are_far_apart() -> None:
    assets = assets_of("house", **{"refuges.nooks": 0})
    goals = np.arange(assets.pellets, len(assets.goal_xy))
    length = assets.length_cm[assets.goal_cell[goals]][:, goals].astype(np.int64)
    apart = length + 10**6 * np.eye(len(goals), dtype=np.int64)
    nearest_before = [apart[k, :k].min() for k in range(1, len(goals))]
    assert nearest_before == sorted(nearest_before, reverse=True)  # the farthest place first, and so on
    assert min(nearest_before) > 200
    cells = assets.grid.cell[assets.goal_cell[goals[1:]]]
    assert (assets.grid.clearance[cells[:, 1], cells[:, 0]] >= 0.30 - 1e-6).all()


@pytest.mark.parametrize(("spread", "nooks"), [(0, 0), (5, 1)])
def test_number_of_refuges_is_configurable(spread: int, nooks: int) -> None:
    assets = assets_of("house", **{"refuges.spread": spread, "refuges.nooks": nooks})
    far_from_clyde = (from_clyde(assets, places(assets)) >= 0.42).sum()
    assert 1 + spread <= assets.refuges <= 1 + spread + nooks
    assert far_from_clyde >= assets.refuges - 1 - spread
