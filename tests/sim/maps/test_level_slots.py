"""Slots for levels: levels come and go, slots are used again, and no game's level disturbs another's."""

import pickle
from functools import cache
from typing import Any

import numpy as np
import pytest
from numba import njit

from pacman_env.config import make_config
from pacman_env.sim.maps.level import Level, level_arrays
from pacman_env.sim.maps.level_slots import LevelSlots, Sizes
from pacman_env.sim.maps.level_source import GeneratedMaps, prepare_level
from pacman_env.world.maps.occupancy import MapError

CONFIG = make_config()


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


def test_arrays_of_a_level_share_its_maps_memory() -> None:
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


def test_level_is_kept_until_its_slot_is_needed() -> None:
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


def test_slot_longest_unused_is_reused() -> None:
    slots = slots_for(3)
    for number in (0, 1, 2):
        slots.release(slots.take(number, level))
    slots.release(slots.take(0, level))
    slots.take(3, level)
    assert [slots.has(number) for number in range(4)] == [True, False, True, True]


def test_levels_keep_the_sizes_of_their_source() -> None:
    sizes = GeneratedMaps(CONFIG, 0, 100).sizes()
    for number in range(6):
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


def test_failed_level_changes_nothing() -> None:
    slots = slots_for(2)
    slots.take(0, level)
    slots.release(slots.take(1, level))

    def fails(number: int) -> Level:
        raise MapError(f"level {number}")

    with pytest.raises(MapError, match="level 2"):
        slots.take(2, fails)
    assert holds(slots, 0, 0)
    assert slots.has(1)
