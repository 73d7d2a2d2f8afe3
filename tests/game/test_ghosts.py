import math
from typing import NamedTuple

import numpy as np
import pytest

from pacman_env.config import Config, ConfigError, make_config
from pacman_env.engine.jit import kernel
from pacman_env.game import ghosts as rule
from pacman_env.game.ghosts import BEHAVIOURS, GhostView, find_behaviour
from pacman_env.levels.assets import MapAssets
from pacman_env.levels.ghost_cells import ClydeCells, search_memory
from pacman_env.sim.ghost_state import head_for, wander_on
from pacman_env.sim.parameters import GHOST
from tests.drawn import drawn
from tests.levels.test_ghost_cells import PERIOD, POCKETS, house, path_between, pocket_cells
from tests.sim.players import new_batch

at_target, choose_target, ghost_stream = map(kernel, (rule.at_target, rule.choose_target, rule.ghost_stream))
spawn, walk = map(kernel, (rule.spawn, rule.walk))


class GhostLevel(NamedTuple):
    """Of a level, what ghosts walk on."""

    ghost_graph: np.ndarray
    ghost_part: np.ndarray
    ghost_part_start: np.ndarray
    ghost_part_cells: np.ndarray


def arrays(cells: ClydeCells) -> GhostLevel:
    return GhostLevel(cells.graph, cells.part, cells.part_start, cells.part_cells)


def record(seed: int = 1, speed: float = 0.25) -> np.ndarray:
    g = np.zeros(1, dtype=GHOST)
    g["stream"], g["speed"] = seed, speed
    return g


def luminance(colour: tuple[int, int, int]) -> float:
    """Return WCAG's relative luminance."""
    shares = np.array(colour) / 255
    linear = np.where(shares <= 0.04045, shares / 12.92, ((shares + 0.055) / 1.055) ** 2.4)
    return float(linear @ (0.2126, 0.7152, 0.0722))


@pytest.mark.parametrize("floor", [(255, 255, 253), (27, 34, 51)])
def test_ghosts_stand_out_from_light_and_dark_floors(floor: tuple[int, int, int]) -> None:
    for ghost in rule.GHOSTS:
        low, high = sorted((luminance(ghost.colour), luminance(floor)))
        assert (high + 0.05) / (low + 0.05) >= 3.0, ghost.name  # WCAG 1.4.11


# Walk


def test_ghost_walks_its_speed_and_stops_at_targets() -> None:
    _, cells = house()
    node, queue = search_memory(len(cells.position), cells.longest)
    paths = np.zeros((1, cells.longest), dtype=np.int32)
    g = record(seed=9, speed=0.35)
    spawn(g[0], int(cells.part_cells[100]), paths[0], cells.position)
    full = at_targets = 0
    for _ in range(1500):
        at, offset = int(g[0]["path_index"]), float(g[0]["path_offset"])
        before = np.array([g[0]["x"], g[0]["y"]])
        walk(g[0], paths[0], cells.position, 1.0, PERIOD)
        now = np.array([g[0]["x"], g[0]["y"]])
        passed = cells.position[paths[0, at + 1 : int(g[0]["path_index"]) + 1]]
        along = np.concatenate([before[None], passed, now[None]])
        walked = np.hypot(*np.diff(along, axis=0).T).sum()
        np.testing.assert_allclose([g[0]["vx"], g[0]["vy"]], (now - before) / PERIOD, atol=1e-12)
        if at_target(g[0]):
            at_targets += 1
            assert walked <= 0.35 * PERIOD + 1e-9
            np.testing.assert_allclose(now, cells.position[paths[0, g[0]["path_length"] - 1]])
            wander_on(g[0], paths[0], arrays(cells), (node, queue))
            assert (g[0]["path_index"], g[0]["path_offset"]) == (0, 0.0)
        else:
            full += 1
            assert walked == pytest.approx(0.35 * PERIOD, abs=1e-9)
            assert offset >= 0.0
    assert at_targets > 3
    assert full > 1000


def test_targets_are_uniform_over_the_connected_part() -> None:
    cells = pocket_cells()
    draws = 20000
    for part in (0, 1):
        inside = cells.part_cells[cells.part_start[part] : cells.part_start[part + 1]]
        g = record(seed=4 + part)
        targets = [
            choose_target(g[0], int(inside[0]), cells.part, cells.part_start, cells.part_cells) for _ in range(draws)
        ]
        assert (cells.part[targets] == part).all()
        bins = min(len(inside), 40)  # neighbouring numbers are neighbouring places
        counts, _ = np.histogram(np.searchsorted(inside, targets), bins=bins, range=(0, len(inside)))
        width, _ = np.histogram(np.arange(len(inside)), bins=bins, range=(0, len(inside)))
        expected = draws * width / len(inside)
        chi2 = ((counts - expected) ** 2 / expected).sum()
        assert chi2 < bins - 1 + 4 * math.sqrt(2 * (bins - 1))


def sent(offset: float, start: int, first: int, second: int) -> tuple[np.ndarray, list[int]]:
    """A ghost sent to a second cell, ``offset`` m after he has set out for the first one; he and his path."""
    _, cells = house()
    memory = search_memory(len(cells.position), cells.longest)
    path = np.zeros(cells.longest + 1, dtype=np.int32)
    g = record()
    spawn(g[0], start, path, cells.position)
    head_for(g[0], path, first, arrays(cells), memory)
    g["path_offset"] = offset
    head_for(g[0], path, second, arrays(cells), memory)
    return g, path[: g["path_length"][0]].tolist()


def test_redirected_ghost_turns_at_the_next_cell() -> None:
    _, cells = house()
    start, first, second = cells.part_cells[[50, 1500, 900]].tolist()
    g, path = sent(0.0, start, first, second)
    assert path == path_between(cells, start, second).tolist()
    assert (g["path_index"][0], g["path_offset"][0]) == (0, 0.0)
    following = path_between(cells, start, first).tolist()[1]
    for target in (second, start, following):
        g, path = sent(0.03, start, first, target)
        assert path == [start, *path_between(cells, following, target).tolist()]
        assert (g["path_index"][0], g["path_offset"][0]) == (0, 0.03)  # he is where he was


def test_ghost_keeps_path_for_same_or_unreachable_target() -> None:
    _, cells = house()
    start, first = cells.part_cells[[50, 1500]].tolist()
    assert sent(0.03, start, first, first)[1] == path_between(cells, start, first).tolist()
    pockets = pocket_cells()
    inside, outside = int(pockets.part_cells[0]), int(pockets.part_cells[pockets.part_start[1]])
    memory = search_memory(len(pockets.position), pockets.longest)
    path = np.zeros(pockets.longest + 1, dtype=np.int32)
    g = record()
    spawn(g[0], inside, path, pockets.position)
    before = g.copy(), path.copy()
    head_for(g[0], path, outside, arrays(pockets), memory)
    np.testing.assert_array_equal(g, before[0])
    np.testing.assert_array_equal(path, before[1])


# The table


def goes_to(name: str, robot: tuple[float, float]) -> tuple[float, float]:
    """Of a ghost at the origin whose corner is at (-9, -9)."""
    entry = find_behaviour(name)
    assert entry.target is not None
    view = GhostView(0, 0.0, 0.0, 0.1, 0.0, *robot, 0.0, -9.0, -9.0)
    return entry.target(view, entry.constants(make_config(**{"clyde.arcade_distance_m": 5.0})))


def test_arcade_ghost_chases_only_beyond_its_distance() -> None:
    assert goes_to("arcade", (3.0, -4.01)) == (3.0, -4.01)
    assert goes_to("arcade", (3.0, -4.0)) == (-9.0, -9.0)
    assert goes_to("arcade", (0.0, 0.0)) == (-9.0, -9.0)


def test_chaser_targets_robot_and_wanderer_nothing() -> None:
    assert goes_to("chase", (0.1, 0.0)) == (0.1, 0.0)
    assert np.isnan(goes_to("wander", (0.1, 0.0))).all()
    with pytest.raises(ConfigError, match=f"unknown ghost behaviour 'sleep': choose one of {', '.join(BEHAVIOURS)}"):
        find_behaviour("sleep")


def test_every_ghost_has_its_own_stream() -> None:
    streams = {int(ghost_stream(np.uint64(seed), number)) for seed in range(500) for number in range(4)}
    assert len(streams) == 2000


# In a game


def spawn_places(config: Config, n: int = 400) -> tuple[MapAssets, np.ndarray]:
    occupancy = drawn(POCKETS, square_m=0.55, origin=(-2.5, -2.0, 0.0))
    batch = new_batch(config, n, occupancy)
    return batch.assets, np.stack([batch.ghosts["x"][:, 0], batch.ghosts["y"][:, 0]], axis=1)


def parts_under(cells: ClydeCells, place: np.ndarray) -> set[int]:
    distance = np.hypot(*np.moveaxis(cells.position[:, None] - place[None], 2, 0))
    assert distance.min(axis=0).max() < 1e-9
    return set(cells.part[distance.argmin(axis=0)].tolist())


def test_ghost_starts_connected_and_away_from_robot() -> None:
    assets, place = spawn_places(make_config("robot", **{"pellets.spacing_m": 1.0}))
    assert parts_under(assets.clyde, place) == {assets.clyde_part}
    distance = np.hypot(*(place - assets.grid.home[:2]).T)
    assert 1.5 <= distance.min() < 1.8
    assert distance.max() > 4.0
    changes = {"pellets.spacing_m": 1.0, "clyde.spawn": "anywhere", "clyde.spawn_distance_m": 4.4}
    assets, place = spawn_places(make_config("robot", **changes), 600)
    assert np.hypot(*(place - assets.grid.home[:2]).T).min() >= 4.4
    assert parts_under(assets.clyde, place) == {0, 1}


def test_ghost_moves_only_at_its_update_period() -> None:
    config = make_config("ideal", **{"clyde.update_period_s": 1.0, "execution.death_radius_m": 1e-6})
    batch = new_batch(config)
    moved = []
    for _ in range(12):
        before = batch.ghosts["x"][0, 0], batch.ghosts["y"][0, 0]
        batch.step(np.array([batch.hold]))
        moved.append((batch.ghosts["x"][0, 0], batch.ghosts["y"][0, 0]) != before)
    assert moved[2:] == [True, False] * 5
