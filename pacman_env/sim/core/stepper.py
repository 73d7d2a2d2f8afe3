"""Ticks of N games: the tables that :func:`ticks.play` works on, one for each thread, and what follows a call of it."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...config import Config
from ...engine.bucket_queue import queue_arrays
from ...engine.native import Table, zeros
from ...engine.threads import Threads
from ...world.navigation.planner import detour_memory
from . import ticks
from .game_levels import GameLevels
from .ghosts import Ghosts
from .history import History
from .parameters import reward_record


class Stepper:
    """Plays ticks of N games.

    Args:
        arrays: the games' state by name.
        parameters: (1,) of type ``PARAMETERS``.
        config: rewards, and whether actions are velocities.
        ghosts: of the games.
        levels: of the games.
        history: what is decided is written there.
        threads: they share the games.

    Attributes:
        control: a view (1,) of each field of ``ticks.CONTROL``; a number is written through it in a fifth of the time.
    """

    def __init__(
        self,
        arrays: dict[str, NDArray[Any]],
        parameters: NDArray[Any],
        config: Config,
        ghosts: Ghosts,
        levels: GameLevels,
        history: History,
        threads: Threads,
    ) -> None:
        self._arrays, self._parameters, self._games = arrays, parameters, arrays["games"]
        self._ghosts, self._levels, self._history, self._threads = ghosts, levels, history, threads
        self._controls = np.zeros(1, dtype=ticks.CONTROL)
        self.control = {name: self._controls[name] for name in ticks.CONTROL.names or ()}
        self._rewards = reward_record(config.reward, config.decisions.discount_per_s**config.execution.tick_s)
        self._remembers = "driven" if config.action == "velocity" else "decisions"
        self._tables: list[Table] = []
        self._ghost_tables: list[Table] = []

    def forget_tables(self) -> None:
        """Arrays have been replaced by larger ones."""
        self._tables.clear()
        self._ghost_tables.clear()

    def play(self, *, resume: bool) -> None:
        """Let all games go on; those that come near a wall are given spaces."""
        self.control["resume"][0] = resume
        while len(self._tables) < self._threads.number:
            self._make_tables()
        while waiting := self._threads.run(ticks.play, self._tables, len(self._games)):
            if waiting < 0:
                self._games["stage"] = ticks.BEGIN
                self._ghosts.raise_again(self._ghost_tables[0].address, -1 - waiting)
            self._levels.provide_spaces(np.flatnonzero(self._games["stage"] == ticks.MOVE))
            self.control["resume"][0] = 1

    def _make_tables(self) -> None:
        """For one more thread, with scratch memory of its own."""
        stack = self._levels.stack
        ghosts = self._ghosts.table(self._games, self._history.ghost_choices, self._parameters)
        node, queue = detour_memory(stack.arrays["cell_xy"].shape[1], stack.longest_way_cm, stack.resolution)
        remembered = zeros(ticks.TickArrays, ("decisions", "driven"), N=len(self._games), t=0)
        remembered[self._remembers] = self._history.decisions
        table = Table(
            ticks.TickArrays,
            obstacles=self._ghosts.obstacles,
            parameters=self._parameters,
            rewards=self._rewards,
            control=self._controls,
            ghosts=ghosts.numbers,
            search_nodes=node,
            **queue_arrays(queue),
            **remembered,
            **self._arrays,
            **self._levels.spaces.named,
            **stack.arrays_for(ticks.TickArrays),
        )
        self._tables.append(table)
        self._ghost_tables.append(ghosts)
