"""The project's own maps: drawn as committed, and fit for the game."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from pacman_env.config import ClydeConfig, Nav2Config, PelletConfig, RobotConfig, make_config
from pacman_env.game.pellets import generate_pellets
from pacman_env.world.map_check import check_map
from pacman_env.world.maps.occupancy import OccupancyMap, load_map
from pacman_env.world.navigation.grid import build_grid, clearance_m, connected_parts
from tests.world.maps.test_houses import holes
from tools.floor_plans import FLOOR_PLANS, Sketch, save_all, survey

COMMITTED = Path(__file__).resolve().parents[2] / "maps"


@pytest.fixture(params=sorted(FLOOR_PLANS))
def plan(request: pytest.FixtureRequest) -> OccupancyMap:
    return load_map(request.param)


def test_saving_writes_the_committed_bytes(tmp_path: Path) -> None:
    save_all(tmp_path / "new")
    written = {p.name: p.read_bytes() for p in (tmp_path / "new").iterdir()}
    committed = {p.name: p.read_bytes() for p in COMMITTED.iterdir() if p.suffix in (".yaml", ".pgm")}
    assert written.keys() == committed.keys() == {f"{n}.{e}" for n in FLOOR_PLANS for e in ("yaml", "pgm")}
    assert [name for name in committed if written[name] != committed[name]] == []


def test_both_readings_of_the_image_agree(plan: OccupancyMap) -> None:
    assert set(np.unique(plan.grey)) == {0, 205, 254}
    meaning = {0: 100, 205: -1, 254: 0}
    for grey, occupancy in meaning.items():
        assert (plan.occupancy[plan.grey == grey] == occupancy).all()


def test_free_area_is_home_sized_and_has_loops(plan: OccupancyMap) -> None:
    free = plan.game_free()
    assert 60 <= free.sum() * plan.resolution**2 <= 120
    assert len(connected_parts(free)[1]) == 2  # one part, and what is not free
    assert free[1:-1, 1:-1].sum() == free.sum()
    grid = build_grid(plan, RobotConfig(), Nav2Config(), PelletConfig())
    column, row = grid.to_cell(0.0, 0.0)
    assert grid.clearance[row, column] >= 0.5
    assert grid.home.tolist() == [0.0, 0.0, 0.0]
    assert holes(grid.cell_id < 0) >= 3


@pytest.mark.parametrize(("spacing_m", "fewest", "most"), [(2.0, 8, 16), (1.0, 24, 60)])
def test_pellets_suffice_and_are_reachable(plan: OccupancyMap, spacing_m: float, fewest: int, most: int) -> None:
    pellets = generate_pellets(plan, PelletConfig(spacing_m=spacing_m))
    assert fewest <= len(pellets) <= most
    assert check_map(plan, pellets.position, pellets.ids, make_config(), home=(0.0, 0.0)).unreachable == ()


def test_ghost_can_go_everywhere(plan: OccupancyMap) -> None:
    half = round(ClydeConfig().clearance_m / plan.resolution)
    free = plan.game_free()
    square = np.ones((2 * half + 1, 2 * half + 1), np.uint8)
    ghost = cv2.erode(free.astype(np.uint8), square, borderValue=0)
    assert len(connected_parts(ghost.astype(np.bool_))[1]) == 2
    assert cv2.dilate(ghost, square)[clearance_m(free, plan.resolution) > 0.4].all()
    column, row = generate_pellets(plan, PelletConfig()).pixel.T
    assert ghost[row, column].all()


def test_home_inside_a_wall_is_refused() -> None:
    sketch = Sketch((3.0, 3.0), home=(0.1, 0.1), turn_deg=0.0, pad_px=(14, 14))
    sketch.carve((0.0, 0.0, 3.0, 3.0))
    with pytest.raises(ValueError, match=r"shed: home \(0\.1, 0\.1\)"):
        survey("shed", sketch, seed=0)
