"""Slots for levels: levels come and go, slots are used again, and no game's level disturbs another's."""

import pickle
from functools import cache
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numba import njit

from pacman_env.config import make_config
from pacman_env.levels.level import Level, level_arrays
from pacman_env.levels.level_slots import LevelSlots
from pacman_env.levels.level_source import GeneratedMaps, prepare_level
from pacman_env.world.maps.occupancy import MapError

CONFIG = make_config()


@cache
def level(number: int) -> Level:
    return Level.of(prepare_level(number, CONFIG), CONFIG)


def slots_for(count: int) -> LevelSlots:
    return LevelSlots(count, GeneratedMaps(CONFIG, 0, 100).most(CONFIG), CONFIG)


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


@settings(max_examples=40)
@given(st.lists(st.tuples(st.integers(0, 5), st.booleans()), max_size=40))
def test_level_is_kept_until_its_slot_is_needed(program: list[tuple[int, bool]]) -> None:
    slots, prepared = slots_for(3), []
    kept: dict[int, int] = {}  # slot by level, the level taken longest ago first
    played: list[int] = []

    def prepare(number: int) -> Level:
        prepared.append(number)
        return level(number)

    for number, ends in program:
        if ends and played:
            slots.release(kept[played.pop(0)])
        elif number in kept or len(set(played)) < 3:
            missing = number not in kept
            slot = slots.take(number, prepare)
            if missing and len(kept) == 3:
                assert slot == kept.pop(next(one for one in kept if one not in played))
            assert kept.pop(number, slot) == slot
            assert prepared == [number] * missing
            prepared.clear()
            kept[number] = slot
            played.append(number)
        assert [slots.has(one) for one in range(6)] == [one in kept for one in range(6)]
    assert all(holds(slots, slot, one) for one, slot in kept.items())


def test_levels_keep_the_sizes_of_their_source() -> None:
    sizes = GeneratedMaps(CONFIG, 0, 100).most(CONFIG)
    for number in range(6):
        assert all(own <= most for own, most in zip(level(number).facts, sizes, strict=True))


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
