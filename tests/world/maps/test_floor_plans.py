"""The project's own maps: drawn as committed, and fit for the game."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from pacman_env.config import ClydeConfig, PelletConfig, RobotConfig
from pacman_env.game.pellets import PelletSet, generate_pellets
from pacman_env.world.maps import floor_plans
from pacman_env.world.maps.floor_plans import FLOOR_PLANS, Sketch, save_all, survey
from pacman_env.world.maps.occupancy import OccupancyMap, load_map

COMMITTED = Path(__file__).resolve().parents[3] / "maps"
JAMBS = np.array([(7.888, -0.820), (9.017, -1.040)])  # of the pocket room's doorway in the house, m, map frame


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


def test_saving_writes_the_committed_files_byte_for_byte(tmp_path: Path) -> None:
    save_all(tmp_path / "new")
    written = {p.name: p.read_bytes() for p in (tmp_path / "new").iterdir()}
    committed = {p.name: p.read_bytes() for p in COMMITTED.iterdir() if p.suffix in (".yaml", ".pgm")}
    assert written.keys() == committed.keys() == {f"{n}.{e}" for n in FLOOR_PLANS for e in ("yaml", "pgm")}
    assert [name for name in committed if written[name] != committed[name]] == []


def test_the_command_line_writes_every_plan(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.argv", ["floor_plans", str(tmp_path)])
    floor_plans.main()
    assert {p.stem for p in tmp_path.iterdir()} == set(FLOOR_PLANS)


@pytest.mark.parametrize("name", sorted(FLOOR_PLANS))
def test_map_loads_by_name_as_it_was_drawn(name: str) -> None:
    drawn, loaded = FLOOR_PLANS[name](), load_map(name)
    assert loaded.name == drawn.name == name
    assert loaded.hash == drawn.hash


def test_both_readings_of_the_image_agree_and_unknown_stays_unknown(plan: OccupancyMap) -> None:
    assert set(np.unique(plan.grey)) == {0, 205, 254}
    meaning = {0: 100, 205: -1, 254: 0}
    for grey, occupancy in meaning.items():
        assert (plan.occupancy[plan.grey == grey] == occupancy).all()


def test_free_area_is_that_of_a_home_and_in_one_piece(plan: OccupancyMap) -> None:
    free = plan.game_free()
    assert 60 <= free.sum() * plan.resolution**2 <= 120
    assert cv2.connectedComponents(free.astype(np.uint8), connectivity=4)[0] == 2
    assert free[1:-1, 1:-1].sum() == free.sum()


def test_home_lies_in_the_open(plan: OccupancyMap) -> None:
    assert clearance_m(plan.game_free(), plan.resolution)[home_cell(plan)] >= 0.5


@pytest.mark.parametrize(("spacing_m", "fewest", "most"), [(2.0, 8, 16), (1.0, 24, 60)])
def test_pellets_are_as_many_as_a_game_needs_and_all_reachable(
    plan: OccupancyMap, spacing_m: float, fewest: int, most: int
) -> None:
    pellets = generate_pellets(plan, PelletConfig(spacing_m=spacing_m))
    assert fewest <= len(pellets) <= most
    assert at(reached(plan, plan.game_free(), RobotConfig().inscribed_radius_m), pellets).all()


def test_a_ghost_can_go_everywhere(plan: OccupancyMap) -> None:
    half = round(ClydeConfig().clearance_m / plan.resolution)
    free = plan.game_free().astype(np.uint8)
    square = np.ones((2 * half + 1, 2 * half + 1), np.uint8)
    ghost = cv2.erode(free, square, borderValue=0)
    assert cv2.connectedComponents(ghost, connectivity=4)[0] == 2
    near = cv2.dilate(ghost, square).astype(np.bool_)
    assert near[clearance_m(plan.game_free(), plan.resolution) > 0.4].all()
    assert at(ghost.astype(np.bool_), generate_pellets(plan, PelletConfig())).all()


def away_from_doorway(plan: OccupancyMap) -> NDArray[np.float64]:
    """Distance of each cell from the line between the jambs, m."""
    points = np.stack(plan.cell_to_world(*np.meshgrid(np.arange(plan.width), np.arange(plan.height))), axis=-1)
    across = JAMBS[1] - JAMBS[0]
    share = np.clip((points - JAMBS[0]) @ across / (across @ across), 0.0, 1.0)
    return np.linalg.norm(points - JAMBS[0] - share[..., None] * across, axis=-1)


def path_cells(plan: OccupancyMap, drivable: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Path length from home in cells, octagonal metric; -1 where the robot cannot go."""
    kernels = [cv2.getStructuringElement(shape, (3, 3)) for shape in (cv2.MORPH_CROSS, cv2.MORPH_RECT)]
    cells, front = np.full(drivable.shape, -1), np.zeros(drivable.shape, np.uint8)
    front[home_cell(plan)] = 1
    for step in range(drivable.size):
        new = (front > 0) & (cells < 0)
        if not new.any():
            break
        cells[new] = step
        front = cv2.dilate(front, kernels[step % 2]) & drivable
    return cells


def test_one_doorway_guards_the_pocket_room_of_the_house_and_its_one_pellet() -> None:
    plan, radius = load_map("house"), RobotConfig().inscribed_radius_m
    pellets, free, away = generate_pellets(plan, PelletConfig()), plan.game_free(), away_from_doorway(plan)
    assert np.linalg.norm(JAMBS[1] - JAMBS[0]) >= 0.9
    whole, rest = reached(plan, free, radius), reached(plan, free & (away > 0.1), radius)
    assert at(whole, pellets).all()
    lost = ~at(rest, pellets)
    assert lost.sum() == 1
    assert at(path_cells(plan, whole), pellets).argmax() == lost.argmax()  # the farthest of all
    behind = whole & ~rest & (away > 0.1 + 2 * radius)
    sizes = cv2.connectedComponentsWithStats(behind.astype(np.uint8))[2][1:, cv2.CC_STAT_AREA]
    assert len(sizes) == 1
    assert 1.0 < sizes[0] * plan.resolution**2 < 6.0


@pytest.mark.parametrize("name", ["house", "loop", "maze", "open_plan"])
def test_no_map_is_a_tree_of_rooms(name: str) -> None:
    """Loops show as holes: solid parts that the robot can drive around."""
    plan = load_map(name)
    drivable = reached(plan, plan.game_free(), RobotConfig().inscribed_radius_m)
    solid_parts = cv2.connectedComponents((~drivable).astype(np.uint8), connectivity=8)[0] - 1
    assert solid_parts - 1 >= 3  # the outside is one part


def test_a_home_inside_a_wall_is_refused() -> None:
    sketch = Sketch((3.0, 3.0), home=(0.1, 0.1), turn_deg=0.0, pad_px=(14, 14))
    sketch.carve((0.0, 0.0, 3.0, 3.0))
    with pytest.raises(ValueError, match=r"shed: home \(0\.1, 0\.1\)"):
        survey("shed", sketch, seed=0)
