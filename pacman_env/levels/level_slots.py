"""Slots for the levels of a batch: each game refers to a slot, and each slot has the address of a level's arrays."""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..config import Config
from ..engine.arrays import address
from .level import Level, LevelFacts


class LevelSlots:
    """S slots. A level keeps its slot while games are played on it, and then until another level needs the slot.

    Attributes:
        most_goals: largest number of goals of any level so far.
        addresses: (S,) int64 addresses of each level's arrays (``LevelArrays``), for kernels.
        numbers: (S,) int64 level numbers; -1: empty slot.
    """

    def __init__(self, slots: int, sizes: LevelFacts, config: Config) -> None:
        """Create empty slots; ``sizes`` are upper bounds for all levels, by which kernels get scratch memory."""
        self.sizes, self.config = sizes, config
        self.addresses = np.zeros(slots, dtype=np.int64)
        self.numbers = np.full(slots, -1, dtype=np.int64)
        self._levels: list[Level | None] = [None] * slots
        self._users = np.zeros(slots, dtype=np.int64)
        self._last_use = np.zeros(slots, dtype=np.int64)
        self._clock = 0
        self.most_goals = 0

    @classmethod
    def only(cls, level: Level, config: Config) -> "LevelSlots":
        """Create a single slot that contains ``level`` as number 0."""
        slots = cls(1, level.facts, config)
        slots.put(0, 0, level)
        return slots

    def __len__(self) -> int:
        return len(self.addresses)

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self.addresses = np.array([0 if level is None else level.address for level in self._levels], dtype=np.int64)

    @property
    def address(self) -> int:
        """Memory address of the array ``addresses``."""
        return address(self.addresses)

    def level(self, slot: int) -> Level:
        level = self._levels[slot]
        assert level is not None
        return level

    def levels(self, slots: NDArray[np.integer[Any]]) -> set[Level]:
        """Return the levels in ``slots`` (M,)."""
        return {self.level(slot) for slot in (range(1) if len(self) == 1 else set(slots.tolist()))}

    def has(self, level: int) -> bool:
        return bool((self.numbers == level).any())

    def take(self, level: int, prepare: Callable[[int], Level], games: int = 1) -> int:
        """Reserve a slot with a level until as many ``games`` call :meth:`release`; prepare a level without a slot."""
        self._clock += 1
        if self.has(level):
            slot = int((self.numbers == level).argmax())
        else:
            free = np.flatnonzero(self._users == 0)
            slot = int(free[self._last_use[free].argmin()])
            self.put(slot, level, prepare(level))
        self._users[slot] += games
        self._last_use[slot] = self._clock
        return slot

    def release(self, slot: int) -> None:
        self._users[slot] -= 1

    def put(self, slot: int, number: int, level: Level) -> None:
        self._levels[slot], self.addresses[slot], self.numbers[slot] = level, level.address, number
        self.most_goals = max(self.most_goals, level.facts.pellets + level.facts.refuges)
