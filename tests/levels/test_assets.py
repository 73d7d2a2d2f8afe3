from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from pacman_env.config import Config, make_config
from pacman_env.game.pellets import generate_pellets
from pacman_env.levels import assets as module
from pacman_env.levels.assets import MapAssets, map_assets, prepare_map
from pacman_env.world.maps.occupancy import MapError, OccupancyMap, load_map
from pacman_env.world.navigation.paths import NO_STEP, UNREACHABLE_CM
from tests.drawn import box, drawn

CONFIG = make_config("robot")
#: A room with home, and a sealed one to its right; pellets lie in both at a spacing of 1.0 m.
SEALED = ["#" * 14, *["#" + "." * 7 + "#" + "." * 4 + "#"] * 6, "#" * 14]


def sealed_rooms() -> OccupancyMap:
    return drawn(SEALED, origin=(-1.5, -1.5, 0.0))


def fine(**changes: object) -> Config:
    return make_config("robot", **{"pellets.spacing_m": 1.0, "clyde.spawn_distance_m": 0.5, **changes})


@pytest.fixture
def clear_memory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[], None]:
    """Nothing is kept on disk; a function that empties the memory of the process, too."""

    def empty() -> None:
        monkeypatch.setattr(module, "_assets", type(module._assets)())

    monkeypatch.setenv("PACMAN_ENV_CACHE", str(tmp_path))
    empty()
    return empty


# Kept


def test_assets_are_shared_by_equal_map_settings() -> None:
    m = sealed_rooms()
    one = map_assets(m, fine())
    assert map_assets(sealed_rooms(), fine()) is one  # by its content
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


def test_path_fields_are_read_back_from_disk(
    clear_memory: Callable[[], None], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    computed = map_assets(sealed_rooms(), fine())
    assert len(list(tmp_path.glob("maps/*/*.npy"))) == 2
    sealed_rooms().save(tmp_path / "copy.yaml")
    copied = map_assets(tmp_path / "copy.yaml", fine())
    assert copied.length_cm is computed.length_cm
    assert (computed.occupancy.name, copied.occupancy.name) == (sealed_rooms().name, "copy")
    clear_memory()
    monkeypatch.setattr(module, "path_fields", None)  # nothing may be computed now
    loaded = map_assets(sealed_rooms(), fine())
    assert loaded is not computed
    for name in ("length_cm", "next_step"):
        np.testing.assert_array_equal(getattr(loaded, name), getattr(computed, name))
        assert getattr(loaded, name).dtype == getattr(computed, name).dtype


def everything(assets: MapAssets) -> dict[str, np.ndarray]:
    whole = {"assets": assets, "grid": assets.grid, "clyde": assets.clyde}
    fields = {f"{k}.{name}": value for k, part in whole.items() for name, value in vars(part).items()}
    return {name: np.asarray(value) for name, value in fields.items() if not hasattr(value, "__dict__")}


def test_prepared_map_has_same_bits_uncached(clear_memory: Callable[[], None], tmp_path: Path) -> None:
    prepared = prepare_map(sealed_rooms(), fine(), home=(0.5, 0.5, 0.0))
    assert not (tmp_path / "maps").exists()
    kept = map_assets(sealed_rooms(), fine(), home=(0.5, 0.5, 0.0))
    assert kept is not prepared
    one, other = everything(prepared), everything(kept)
    assert one.keys() == other.keys()
    assert {"assets.length_cm", "grid.cost", "clyde.graph"} <= one.keys()
    for name, value in one.items():
        np.testing.assert_array_equal(value, other[name], err_msg=name)


# Pellets


def test_unreachable_pellets_are_dropped() -> None:
    m = sealed_rooms()
    assets = map_assets(m, fine())
    everything = generate_pellets(m, fine().pellets)
    sealed = everything.position[:, 0] > 2.5  # the wall between the rooms is at 2.5 to 3.0 m
    assert 0 < sealed.sum() < len(sealed)
    assert assets.dropped_ids.tolist() == everything.ids[sealed].tolist()
    assert assets.pellet_ids.tolist() == everything.ids[~sealed].tolist()
    np.testing.assert_array_equal(assets.goal_xy[: assets.pellets], everything.position[~sealed])


def test_unreachable_pellets_may_stay_without_path() -> None:
    m = sealed_rooms()
    assets = map_assets(m, fine(**{"pellets.reachable_only": False}))
    everything = generate_pellets(m, fine().pellets)
    assert len(assets.dropped_ids) == 0
    assert assets.pellet_ids.tolist() == everything.ids.tolist()
    sealed = np.flatnonzero(everything.position[:, 0] > 3.6)  # farther from the wall than Nav2's tolerance
    assert (assets.goal_cell[sealed] == -1).all()
    assert (assets.length_cm[:, sealed] == UNREACHABLE_CM).all()
    assert (assets.next_step[sealed] == NO_STEP).all()


def test_unplayable_maps_are_refused() -> None:
    with pytest.raises(MapError, match=r"drawn: no pellet that the robot can reach at a spacing of 9\.0 m"):
        map_assets(drawn(box(8, 6)), make_config("robot", **{"pellets.spacing_m": 9.0}))
    with pytest.raises(MapError, match=r"the home pose must be x, y, heading"):
        prepare_map(sealed_rooms(), fine(), home=(np.nan, 0.0, 0.0))
    # The robot fits into the corridor of 0.5 m; Clyde, whose square is 0.55 m wide, only into the room below.
    corridor = ["#" * 20, *["#" + "." * 18 + "#"] * 2, "#" * 20]
    m = drawn([*corridor, *["#" * 14 + "....." + "#"] * 5, "#" * 20], square_m=0.25)
    config = make_config("robot", **{"pellets.spacing_m": 0.25, "pellets.wall_clearance_m": 0.2})
    with pytest.raises(MapError, match=r"drawn: no place of the robot's area is wide enough for Clyde"):
        map_assets(m, config, home=(2.0, 2.0, 0.0))


# Fields


def test_ghost_cells_know_the_drivable_cell_under() -> None:
    m = load_map("house")
    assets = map_assets(m, CONFIG)
    for k in np.random.default_rng(1).choice(len(assets.clyde.position), 300):
        u, v = assets.clyde.pixel[k]
        column, row = assets.grid.to_cell(*m.cell_to_world(u, v))  # the pixel's own cell, not the corner he stands on
        assert assets.clyde_drive[k] == assets.grid.cell_id[row, column]
    assert (assets.clyde.part[assets.spawn_cells] == assets.clyde_part).all()
