from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from pacman_env.config import Config, make_config
from pacman_env.game.pellets import generate_pellets
from pacman_env.sim.maps import assets as module
from pacman_env.sim.maps.assets import MapAssets, map_assets, path_fields, prepare_map
from pacman_env.world.maps.occupancy import MapError, OccupancyMap, load_map
from pacman_env.world.navigation.paths import AT_GOAL, NO_STEP, UNREACHABLE_CM
from tests.drawn import box, drawn
from tests.shared import shared_path

CONFIG = make_config("robot")
#: A room with home, and a sealed one to its right; pellets lie in both at a spacing of 1.0 m.
SEALED = ["#" * 14, *["#" + "." * 7 + "#" + "." * 4 + "#"] * 6, "#" * 14]


def sealed_rooms() -> OccupancyMap:
    return drawn(SEALED, origin=(-1.5, -1.5, 0.0))


def fine(**changes: object) -> Config:
    return make_config("robot", **{"pellets.spacing_m": 1.0, "clyde.spawn_distance_m": 0.5, **changes})


@pytest.fixture
def empty_caches(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Nothing kept in the process or on disk; the folder of the disk's."""
    monkeypatch.setenv("PACMAN_ENV_CACHE", str(tmp_path))
    monkeypatch.setattr(module, "_assets", type(module._assets)())
    return tmp_path / "maps"


# Kept


def test_the_second_call_for_a_map_gives_the_same_object_and_prepares_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    first = map_assets("house", CONFIG)
    monkeypatch.setattr(module, "_build", lambda *arguments: pytest.fail("prepared again"))
    assert map_assets("house", CONFIG) is first


def test_what_does_not_matter_to_the_map_shares_assets_and_what_does_has_its_own() -> None:
    m = sealed_rooms()
    one = map_assets(m, fine())
    for same in ({"clyde.speed_mps": 0.4}, {"time_limit_s": 30.0}, {"reward.death": -1.0}, {"robot.speed_mps": 0.2}):
        assert map_assets(m, fine(**same)) is one
    different: list[dict[str, object]] = [
        {"pellets.spacing_m": 1.5},
        {"pellets.wall_clearance_m": 0.2},
        {"clyde.clearance_m": 0.3},
        {"clyde.spawn": "anywhere"},
        {"refuges.spread": 2},
        {"nav2.inflation_scale": 5.0},
        {"robot.inscribed_radius_m": 0.2},
    ]
    assert all(map_assets(m, fine(**changes)) is not one for changes in different)
    assert map_assets(m, fine(), home=(0.5, 0.5, 0.0)) is not one


def test_a_map_is_known_by_its_content_and_keeps_its_name(tmp_path: Path) -> None:
    one = map_assets(sealed_rooms(), fine())
    assert map_assets(sealed_rooms(), fine()) is one
    sealed_rooms().save(tmp_path / "copy.yaml")
    copy = map_assets(tmp_path / "copy.yaml", fine())
    assert copy.length_cm is one.length_cm
    assert (one.occupancy.name, copy.occupancy.name) == (sealed_rooms().name, "copy")


def same_fields(one: MapAssets, other: MapAssets) -> None:
    for name in ("length_cm", "next_step"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
        assert getattr(one, name).dtype == getattr(other, name).dtype


def test_path_fields_come_back_from_disk_as_they_were_computed(
    empty_caches: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    computed = map_assets(sealed_rooms(), fine())
    assert len(list(empty_caches.glob("*/*.npy"))) == 2
    monkeypatch.setattr(module, "_assets", type(module._assets)())
    monkeypatch.setattr(module, "path_fields", None)  # nothing may be computed now
    loaded = map_assets(sealed_rooms(), fine())
    assert loaded is not computed
    same_fields(loaded, computed)


def everything(assets: MapAssets) -> dict[str, np.ndarray]:
    whole = {"assets": assets, "grid": assets.grid, "clyde": assets.clyde}
    fields = {f"{k}.{name}": value for k, part in whole.items() for name, value in vars(part).items()}
    return {name: np.asarray(value) for name, value in fields.items() if not hasattr(value, "__dict__")}


def test_a_prepared_map_is_the_same_bits_and_is_kept_nowhere(empty_caches: Path) -> None:
    prepared = prepare_map(sealed_rooms(), fine(), home=(0.5, 0.5, 0.0))
    assert not empty_caches.exists()
    assert len(module._assets) == 0
    kept = map_assets(sealed_rooms(), fine(), home=(0.5, 0.5, 0.0))
    assert kept is not prepared
    one, other = everything(prepared), everything(kept)
    assert one.keys() == other.keys()
    assert {"assets.length_cm", "grid.cost", "clyde.graph"} <= one.keys()
    for name, value in one.items():
        np.testing.assert_array_equal(value, other[name], err_msg=name)


def test_threads_prepare_maps_at_the_same_time() -> None:
    maps = [load_map("house"), load_map("maze")]
    alone = [everything(prepare_map(m, CONFIG)) for m in maps]
    with ThreadPoolExecutor(2) as pool:
        together = [everything(assets) for assets in pool.map(prepare_map, maps * 2, [CONFIG] * 4)]
    for k, found in enumerate(together):
        for name, value in alone[k % 2].items():
            np.testing.assert_array_equal(found[name], value, err_msg=name)


def test_a_home_pose_that_is_no_number_is_refused_when_preparing_too() -> None:
    with pytest.raises(MapError, match=r"the home pose must be x, y, heading"):
        prepare_map(sealed_rooms(), fine(), home=(np.nan, 0.0, 0.0))


def test_a_damaged_file_on_disk_is_computed_again(empty_caches: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    computed = map_assets(sealed_rooms(), fine())
    before = {name: np.array(getattr(computed, name)) for name in ("length_cm", "next_step")}
    for path in empty_caches.glob("*/*.npy"):
        content = path.read_bytes()
        path.unlink()
        path.write_bytes(content[: len(content) // 2])
    monkeypatch.setattr(module, "_assets", type(module._assets)())
    again = map_assets(sealed_rooms(), fine())
    for name, array in before.items():
        np.testing.assert_array_equal(getattr(again, name), array)


def test_only_the_last_maps_are_kept_in_the_process(empty_caches: Path) -> None:
    m = drawn(box(8, 6), origin=(-2.0, -1.5, 0.0))
    first = map_assets(m, fine())
    for k in range(module._KEEP):
        map_assets(m, fine(**{"pellets.spacing_m": 1.0 + 0.05 * (k + 1)}))
    assert len(module._assets) == module._KEEP
    assert map_assets(m, fine()) is not first


# Pellets


def test_pellets_out_of_reach_are_dropped_and_the_others_keep_their_ids() -> None:
    m = sealed_rooms()
    assets = map_assets(m, fine())
    everything = generate_pellets(m, fine().pellets)
    sealed = everything.position[:, 0] > 2.5  # the wall between the rooms is at 2.5 to 3.0 m
    assert 0 < sealed.sum() < len(sealed)
    assert assets.dropped_ids.tolist() == everything.ids[sealed].tolist()
    assert assets.pellet_ids.tolist() == everything.ids[~sealed].tolist()
    np.testing.assert_array_equal(assets.goal_xy[: assets.pellets], everything.position[~sealed])


def test_as_the_original_had_it_pellets_out_of_reach_stay_and_have_no_way() -> None:
    m = sealed_rooms()
    assets = map_assets(m, fine(**{"pellets.reachable_only": False}))
    everything = generate_pellets(m, fine().pellets)
    assert len(assets.dropped_ids) == 0
    assert assets.pellet_ids.tolist() == everything.ids.tolist()
    sealed = np.flatnonzero(everything.position[:, 0] > 3.6)  # farther from the wall than Nav2's tolerance
    assert (assets.goal_cell[sealed] == -1).all()
    assert (assets.length_cm[:, sealed] == UNREACHABLE_CM).all()
    assert (assets.next_step[sealed] == NO_STEP).all()


@pytest.mark.parametrize(("spacing", "pellets"), [(2.0, 8), (1.0, 24)])
def test_the_experiments_house_has_its_pellets(spacing: float, pellets: int) -> None:
    source = shared_path("maps/pacmanbot_house")
    assets = map_assets(source, make_config("robot", **{"pellets.spacing_m": spacing}))
    assert (assets.pellets, len(assets.dropped_ids)) == (pellets, 0)
    assert assets.pellet_ids.tolist() == list(range(pellets))
    assert np.hypot(*(assets.goal_xy[:pellets] - (7.84, -1.69)).T).min() < 0.01
    np.testing.assert_array_equal(assets.grid.home, [0.0, 0.0, 0.0])


def test_a_map_without_a_pellet_in_reach_is_refused() -> None:
    with pytest.raises(MapError, match=r"drawn: no pellet that the robot can reach at a spacing of 9\.0 m"):
        map_assets(drawn(box(8, 6)), make_config("robot", **{"pellets.spacing_m": 9.0}))


def test_a_map_whose_robots_part_is_too_narrow_for_clyde_is_refused() -> None:
    # The robot fits into the corridor of 0.5 m; Clyde, whose square is 0.55 m wide, only into the room below.
    corridor = ["#" * 20, *["#" + "." * 18 + "#"] * 2, "#" * 20]
    m = drawn([*corridor, *["#" * 14 + "....." + "#"] * 5, "#" * 20], square_m=0.25)
    config = make_config("robot", **{"pellets.spacing_m": 0.25, "pellets.wall_clearance_m": 0.2})
    with pytest.raises(MapError, match=r"drawn: no place of the robot's area is wide enough for Clyde"):
        map_assets(m, config, home=(2.0, 2.0, 0.0))


# Fields


def test_fields_lead_from_every_cell_to_every_goal() -> None:
    assets = map_assets("house", CONFIG)
    goals = np.arange(len(assets.goal_xy))
    np.testing.assert_array_equal(assets.next_step[goals, assets.goal_cell], np.full(len(goals), AT_GOAL))
    cells = np.random.default_rng(0).choice(len(assets.cell_xy), 200)
    for goal in goals:
        here = cells.copy()
        walked = np.zeros(len(here))
        for _ in range(2000):
            step = assets.next_step[goal, here].astype(np.int64)
            walked += np.hypot(*(assets.cell_xy[here + step] - assets.cell_xy[here]).T)
            here = here + step
        assert (here == assets.goal_cell[goal]).all()
        np.testing.assert_allclose(walked, assets.length_cm[cells, goal] / 100, atol=0.011)


def test_a_goal_without_a_cell_is_unreachable_from_everywhere() -> None:
    assets = map_assets(sealed_rooms(), fine())
    fields = path_fields(assets.grid, np.array([-1, 3], dtype=np.int32))
    assert (fields["length_cm"][:, 0] == UNREACHABLE_CM).all()
    assert (fields["next_step"][0] == NO_STEP).all()
    assert (fields["length_cm"][:, 1] < UNREACHABLE_CM).all()


def test_clydes_cells_know_the_robots_cell_under_them() -> None:
    m = load_map("house")
    assets = map_assets(m, CONFIG)
    for k in np.random.default_rng(1).choice(len(assets.clyde.position), 300):
        u, v = assets.clyde.pixel[k]
        column, row = assets.grid.to_cell(*m.cell_to_world(u, v))  # the pixel's own cell, not the corner he stands on
        assert assets.clyde_drive[k] == assets.grid.cell_id[row, column]
    assert (assets.clyde.part[assets.spawn_cells] == assets.clyde_part).all()
