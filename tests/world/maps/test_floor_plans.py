"""The project's own maps: drawn as committed, and fit for the game."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from pacman_env.config import ClydeConfig, PelletConfig, RobotConfig
from pacman_env.game.pellets import PelletSet, generate_pellets
from pacman_env.world.maps.floor_plans import FLOOR_PLANS, Sketch, save_all, survey
from pacman_env.world.maps.occupancy import OccupancyMap, load_map

COMMITTED = Path(__file__).resolve().parents[3] / "maps"


@pytest.fixture(params=sorted(FLOOR_PLANS))
def plan(request: pytest.FixtureRequest) -> OccupancyMap:
    return load_map(request.param)


def clearance_m(free: NDArray[np.bool_], resolution: float) -> NDArray[np.float32]:
    return cv2.distanceTransform(free.astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE) * resolution


def home_cell(plan: OccupancyMap) -> tuple[int, int]:
    column, row = plan.world_to_cell(0.0, 0.0)
    return round(float(row)), round(float(column))


def reached(plan: OccupancyMap, free: NDArray[np.bool_], radius_m: float) -> NDArray[np.bool_]:
    """Cells that a disc can reach from home."""
    room = (clearance_m(free, plan.resolution) > radius_m).astype(np.uint8)
    labels = cv2.connectedComponents(room, connectivity=4)[1]
    assert room[home_cell(plan)]
    return labels == labels[home_cell(plan)]


def at(mask: NDArray[np.bool_], pellets: PelletSet) -> NDArray[np.bool_]:
    return mask[pellets.pixel[:, 1], pellets.pixel[:, 0]]


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


def test_free_area_is_one_home_sized_piece(plan: OccupancyMap) -> None:
    free = plan.game_free()
    assert 60 <= free.sum() * plan.resolution**2 <= 120
    assert cv2.connectedComponents(free.astype(np.uint8), connectivity=4)[0] == 2
    assert free[1:-1, 1:-1].sum() == free.sum()


def test_home_lies_in_the_open(plan: OccupancyMap) -> None:
    assert clearance_m(plan.game_free(), plan.resolution)[home_cell(plan)] >= 0.5


@pytest.mark.parametrize(("spacing_m", "fewest", "most"), [(2.0, 8, 16), (1.0, 24, 60)])
def test_pellets_suffice_and_are_reachable(plan: OccupancyMap, spacing_m: float, fewest: int, most: int) -> None:
    pellets = generate_pellets(plan, PelletConfig(spacing_m=spacing_m))
    assert fewest <= len(pellets) <= most
    assert at(reached(plan, plan.game_free(), RobotConfig().inscribed_radius_m), pellets).all()


def test_ghost_can_go_everywhere(plan: OccupancyMap) -> None:
    half = round(ClydeConfig().clearance_m / plan.resolution)
    free = plan.game_free().astype(np.uint8)
    square = np.ones((2 * half + 1, 2 * half + 1), np.uint8)
    ghost = cv2.erode(free, square, borderValue=0)
    assert cv2.connectedComponents(ghost, connectivity=4)[0] == 2
    near = cv2.dilate(ghost, square).astype(np.bool_)
    assert near[clearance_m(plan.game_free(), plan.resolution) > 0.4].all()
    assert at(ghost.astype(np.bool_), generate_pellets(plan, PelletConfig())).all()


def test_plan_has_loops(plan: OccupancyMap) -> None:
    """They show as holes: solid parts that the robot can drive around."""
    drivable = reached(plan, plan.game_free(), RobotConfig().inscribed_radius_m)
    solid_parts = cv2.connectedComponents((~drivable).astype(np.uint8), connectivity=8)[0] - 1
    assert solid_parts - 1 >= 3  # the outside is one part


def test_home_inside_a_wall_is_refused() -> None:
    sketch = Sketch((3.0, 3.0), home=(0.1, 0.1), turn_deg=0.0, pad_px=(14, 14))
    sketch.carve((0.0, 0.0, 3.0, 3.0))
    with pytest.raises(ValueError, match=r"shed: home \(0\.1, 0\.1\)"):
        survey("shed", sketch, seed=0)
