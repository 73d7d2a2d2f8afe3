"""The stack of maps: levels come and go, slots are used again, and no game's level disturbs another's."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest

from pacman_env.config import Config, make_config
from pacman_env.game.execution import RUNNING
from pacman_env.sim.core.batch import GameBatch
from pacman_env.sim.maps.assets import MapAssets
from pacman_env.sim.maps.level_source import GeneratedMaps, prepare_level
from pacman_env.sim.maps.level_stack import LevelStack
from pacman_env.world.maps.occupancy import MapError

CONFIG = make_config()
QUICK: dict[str, Any] = {"time_limit_s": 8.0, "execution.pickup_radius_m": 0.6, "clyde.ghosts": ("wander", "chase")}


@cache
def level(number: int) -> MapAssets:
    return prepare_level(number, CONFIG)


def holds(stack: LevelStack, slot: int, number: int) -> bool:
    """The slot's rows are the level's arrays."""
    assets, arrays = level(number), stack.arrays
    pairs = [
        (arrays["cell_xy"], assets.cell_xy),
        (arrays["length_cm"], assets.length_cm),
        (arrays["next_step"], assets.next_step),
        (arrays["clearance_cm"], assets.grid.clearance_cm),
        (arrays["snap"], assets.grid.snap),
        (arrays["goal_xy"], assets.goal_xy),
        (arrays["ghost_xy"], assets.clyde.position),
        (arrays["ghost_graph"], assets.clyde.graph),
        (arrays["spawn_cells"], assets.spawn_cells),
    ]
    rows = [(stacked[slot][tuple(slice(n) for n in array.shape)], array) for stacked, array in pairs]
    return stack.assets(slot) is assets and all(np.array_equal(row, array) for row, array in rows)


def by_size() -> list[int]:
    return sorted(range(12), key=lambda number: len(level(number).cell_xy))


def test_one_map_for_all_is_stacked_without_a_copy() -> None:
    stack = LevelStack(level(0), CONFIG)
    assert len(stack) == 1
    assert np.shares_memory(stack.arrays["length_cm"], level(0).length_cm)
    assert holds(stack, 0, 0)


def test_a_level_is_taken_once_and_kept_until_its_slot_is_needed() -> None:
    stack, prepared = LevelStack(level(0), CONFIG, slots=3), []

    def prepare(number: int) -> MapAssets:
        prepared.append(number)
        return level(number)

    assert [stack.take(number, prepare) for number in (0, 1, 0, 2)] == [0, 1, 0, 2]
    assert prepared == [0, 1, 2]
    stack.release(1)  # nobody plays on level 1 now, but it stays
    assert stack.has(1)
    assert stack.take(1, prepare) == 1
    stack.release(1)
    stack.release(0)
    assert stack.take(3, prepare) == 1  # one game is still on level 0
    assert (stack.has(1), stack.has(0)) == (False, True)
    stack.release(0)
    stack.release(2)
    assert stack.take(4, prepare) == 0 or stack.take(5, prepare) == 0
    assert prepared[:4] == [0, 1, 2, 3]
    np.testing.assert_array_equal(stack.numbers >= 0, True)


def test_of_the_free_slots_the_one_longest_unused_is_given_up() -> None:
    stack = LevelStack(level(0), CONFIG, slots=3)
    for number in (0, 1, 2):
        stack.release(stack.take(number, level))
    stack.release(stack.take(0, level))
    stack.take(3, level)
    assert [stack.has(number) for number in range(4)] == [True, False, True, True]


def test_arrays_grow_for_larger_levels_and_keep_the_smaller_ones() -> None:
    order = by_size()
    stack, versions = LevelStack(level(order[0]), CONFIG, slots=12), set()
    for taken, number in enumerate(order):
        assert stack.take(number, level) == taken
        versions.add(stack.version)
        assert all(holds(stack, slot, other) for slot, other in enumerate(order[: taken + 1]))
    assert len(versions) > 1  # it grew, and those who look know
    assert stack.longest_way_cm >= max(level(n).length_cm[level(n).length_cm != 65535].max() for n in order)


def test_beyond_a_smaller_level_in_a_larger_ones_slot_lies_what_lies_at_its_edge() -> None:
    order = by_size()
    stack = LevelStack(level(order[0]), CONFIG, slots=2)
    for number in (order[-1], order[-2], order[0]):
        slot = stack.take(number, level)
        stack.release(slot)
    assert slot == 0  # where the largest was
    grid = level(order[0]).grid
    for name, array in (("snap", grid.snap), ("clearance_cm", grid.clearance_cm)):
        stacked = stack.arrays[name][slot]
        beyond = [(0, room - n) for room, n in zip(stacked.shape, array.shape, strict=True)]
        np.testing.assert_array_equal(stacked, np.pad(array, beyond, mode="edge"))


def test_a_level_that_cannot_be_prepared_changes_nothing() -> None:
    stack = LevelStack(level(0), CONFIG, slots=2)
    stack.take(0, level)
    stack.release(stack.take(1, level))

    def fails(number: int) -> MapAssets:
        raise MapError(f"level {number}")

    with pytest.raises(MapError, match="level 2"):
        stack.take(2, fails)
    assert holds(stack, 0, 0)
    assert stack.has(1)


# Game i of a batch is the same game alone, each on its own level


class Players:
    """Random allowed choices, and a new episode after each end: by the game's number alone."""

    def __init__(self, config: Config, levels: int, numbers: list[int]) -> None:
        self.batch = GameBatch(GeneratedMaps(config, 0, levels), config, len(numbers))
        self.rngs = [np.random.default_rng(number) for number in numbers]
        self.episode = np.array(numbers, dtype=np.uint64) * np.uint64(1000)
        self.batch.reset(np.arange(len(numbers)), self.episode)

    def step(self) -> None:
        over = np.flatnonzero(self.batch.games["end"] != RUNNING)
        if len(over) > 0:
            self.episode[over] += np.uint64(1)
            self.batch.reset(over, self.episode[over])
        velocity = self.batch.config.action == "velocity"
        masks = self.batch.situation().mask
        draws = [
            rng.uniform((0, -1), (0.3, 1)) if velocity else rng.choice(np.flatnonzero(mask))
            for rng, mask in zip(self.rngs, masks, strict=True)
        ]
        self.batch.step(np.array(draws))

    def everything(self, i: int) -> dict[str, bytes]:
        """All that there is to know of a game, but for the slot its level lies in."""
        games = self.batch.games[i : i + 1].copy()
        games["level"] = self.batch.level_numbers()[i]
        situation = self.batch.situation().rows(np.array([i]))
        seen = {name: value for name, value in vars(situation).items() if name not in ("maps", "threads", "level")}
        arrays = {name: games[name] for name in games.dtype.names or ()} | seen
        ghosts = self.batch.ghosts[i]
        arrays |= {f"ghosts.{name}": ghosts[name] for name in ghosts.dtype.names or ()}
        return {name: np.ascontiguousarray(array).tobytes() for name, array in arrays.items()}


@pytest.mark.parametrize("settings", [{}, {"action": "velocity"}, {"endless": True}], ids=str)
@pytest.mark.parametrize("levels", [4, 1000])
def test_a_game_on_its_level_is_the_same_alone_and_among_others(levels: int, settings: dict[str, Any]) -> None:
    config = make_config("robot", **QUICK, **settings)
    sizes = (1, 3, 20) if levels == 4 else (1, 3, 8)  # each episode is a new level to prepare
    batches = [Players(config, levels, list(range(7, 7 + n))) for n in sizes]
    last = Players(config, levels, [7 + sizes[-1] - 1])
    played = set()
    for k in range(60 if levels == 4 else 24):
        for players in (*batches, last):
            players.step()
        played.add(int(batches[0].batch.level_numbers()[0]))
        alone = batches[0].everything(0)
        for players in batches[1:]:
            found = players.everything(0)
            assert not [name for name in alone if alone[name] != found[name]], k
        assert last.everything(0) == batches[-1].everything(sizes[-1] - 1), k
    assert len(played) > 1
