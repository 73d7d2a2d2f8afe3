"""Slots for levels: levels come and go, slots are used again, and no game's level disturbs another's."""

from __future__ import annotations

import pickle
from functools import cache
from typing import Any

import numpy as np
import pytest
from numba import njit

from pacman_env.config import Config, make_config
from pacman_env.game.execution import RUNNING
from pacman_env.sim.core.batch import GameBatch
from pacman_env.sim.maps.level import Level, level_arrays
from pacman_env.sim.maps.level_slots import LevelSlots, Sizes
from pacman_env.sim.maps.level_source import GeneratedMaps, prepare_level
from pacman_env.world.maps.occupancy import MapError

CONFIG = make_config()
QUICK: dict[str, Any] = {"time_limit_s": 8.0, "execution.pickup_radius_m": 0.6, "clyde.ghosts": ("wander", "chase")}


@cache
def level(number: int) -> Level:
    return Level.of(prepare_level(number, CONFIG), CONFIG)


def slots_for(count: int) -> LevelSlots:
    return LevelSlots(count, GeneratedMaps(CONFIG, 0, 100).sizes(), CONFIG)


def holds(slots: LevelSlots, slot: int, number: int) -> bool:
    """Kernels find the level's own arrays by the slot's address."""
    found, own = _read(slots.addresses[slot]), level(number)
    same = all(np.array_equal(array, own.arrays[name]) for name, array in zip(found._fields, found, strict=True))
    return slots.level(slot) is own and slots.numbers[slot] == number and same


@njit
def _read(address: int) -> Any:
    return level_arrays(address)


def test_the_arrays_of_a_level_are_those_of_its_map_without_a_copy() -> None:
    slots = LevelSlots.only(level(0), CONFIG)
    assert len(slots) == 1
    assert holds(slots, 0, 0)
    assets, arrays = level(0).assets, level(0).arrays
    for name, array in (
        ("length_cm", assets.length_cm),
        ("snap", assets.grid.snap),
        ("ghost_graph", assets.clyde.graph),
    ):
        assert np.shares_memory(arrays[name], array)


def test_a_level_is_taken_once_and_kept_until_its_slot_is_needed() -> None:
    slots, prepared = slots_for(3), []

    def prepare(number: int) -> Level:
        prepared.append(number)
        return level(number)

    assert [slots.take(number, prepare) for number in (0, 1, 0, 2)] == [0, 1, 0, 2]
    assert prepared == [0, 1, 2]
    slots.release(1)  # nobody plays on level 1 now, but it stays
    assert slots.has(1)
    assert slots.take(1, prepare) == 1
    slots.release(1)
    slots.release(0)
    assert slots.take(3, prepare) == 1  # one game is still on level 0
    assert (slots.has(1), slots.has(0)) == (False, True)
    assert all(holds(slots, slot, number) for slot, number in ((0, 0), (1, 3), (2, 2)))
    slots.release(0)
    slots.release(2)
    assert slots.take(4, prepare) == 0 or slots.take(5, prepare) == 0
    assert prepared[:4] == [0, 1, 2, 3]
    np.testing.assert_array_equal(slots.numbers >= 0, True)


def test_of_the_free_slots_the_one_longest_unused_is_given_up() -> None:
    slots = slots_for(3)
    for number in (0, 1, 2):
        slots.release(slots.take(number, level))
    slots.release(slots.take(0, level))
    slots.take(3, level)
    assert [slots.has(number) for number in range(4)] == [True, False, True, True]


def test_no_level_exceeds_the_sizes_of_its_source() -> None:
    sizes = GeneratedMaps(CONFIG, 0, 100).sizes()
    for number in range(12):
        assert all(own <= most for own, most in zip(Sizes.of(level(number)), sizes, strict=True))


def test_kernels_find_the_arrays_of_a_copy() -> None:
    slots = slots_for(2)
    slots.take(0, level)
    other = pickle.loads(pickle.dumps(slots))
    del slots
    found = _read(other.addresses[0])
    assert found.length_cm.ctypes.data == other.level(0).arrays["length_cm"].ctypes.data
    np.testing.assert_array_equal(found.length_cm, level(0).arrays["length_cm"])
    assert other.level(0).address != level(0).address


def test_a_level_that_cannot_be_prepared_changes_nothing() -> None:
    slots = slots_for(2)
    slots.take(0, level)
    slots.release(slots.take(1, level))

    def fails(number: int) -> Level:
        raise MapError(f"level {number}")

    with pytest.raises(MapError, match="level 2"):
        slots.take(2, fails)
    assert holds(slots, 0, 0)
    assert slots.has(1)


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
