"""Play the ticks of a batch in single physics steps, so that a test can look at the games after each of them."""

import functools
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pacman_env.engine.jit import kernel
from pacman_env.game.ends import RUNNING, TIMEOUT
from pacman_env.levels.level import level_arrays
from pacman_env.sim.batch import GameBatch
from pacman_env.sim.ticks import begin_decision, begin_tick, end_tick, steer, tick_arrays
from pacman_env.world.navigation.physics import move

test_kernel = functools.partial(kernel, cached=False)
test_kernel.__test__ = False  # type: ignore[attr-defined]


def watch(batch: GameBatch, look: Callable[[], None]) -> None:
    """Call ``look`` after every physics step of ``batch``."""
    batch._play = functools.partial(_play, batch, look)  # type: ignore[method-assign]


def _play(batch: GameBatch, look: Callable[[], None]) -> None:
    _, tables = batch.tick_stage()
    table, ticks = tables[0].address, batch.arrays["last_decision"]["ticks"]
    _begin_decisions(table, batch.n)
    for _ in range(int(batch._controls["ticks"][0])):
        plays = ticks > 0
        if not plays.any():
            break
        _begin_ticks(table, plays)
        for step in range(batch._parameters["substeps"][0]):
            _step(table, plays, step)
            look()
        _end_ticks(table, plays)
    _note_ends(table, batch.n)


@test_kernel
def _begin_decisions(table: int, count: int) -> None:
    a = tick_arrays(table)
    for i in range(count):
        begin_decision(a, i)


@test_kernel
def _begin_ticks(table: int, plays: NDArray[np.bool_]) -> None:
    a = tick_arrays(table)
    for i in range(len(plays)):
        if plays[i]:
            begin_tick(a, i)


@test_kernel
def _step(table: Any, plays: NDArray[np.bool_], step: int) -> None:
    a = tick_arrays(table)
    for i in range(len(plays)):
        g = a.rules.games[i]
        level = level_arrays(a.rules.levels[g.level])
        if plays[i] and g.end == RUNNING and steer(a, i, step, level):
            move(g, level, a.rules.parameters[0], a.solver[0])


@test_kernel
def _end_ticks(table: Any, plays: NDArray[np.bool_]) -> None:
    a = tick_arrays(table)
    for i in range(len(plays)):
        if plays[i]:
            end_tick(a, i)


@test_kernel
def _note_ends(table: int, count: int) -> None:
    a = tick_arrays(table)
    for i in range(count):
        end = a.rules.games[i].end
        a.terminated[i], a.truncated[i] = end != RUNNING and end != TIMEOUT, end == TIMEOUT
