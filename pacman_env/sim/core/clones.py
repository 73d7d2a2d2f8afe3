"""Copy the arrays of running games, and reseed games."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...engine.jit import kernel
from ...game.ghosts import ghost_stream
from ...rng import LOCALIZATION, NAVIGATION, stream
from .state import GameState

_ghost_stream = kernel(ghost_stream)
_stream = kernel(stream)


def rows_of(state: GameState, index: NDArray[np.int64]) -> list[NDArray[Any]]:
    """Return copies of the rows of the games ``index`` (M,) in all arrays of a state; the first are the records."""
    return [array[index] for array in _arrays(state)]


def write(rows: list[NDArray[Any]], state: GameState, index: NDArray[np.int64]) -> None:
    """Write :func:`rows_of` another state of the same kind to the rows ``index`` (M,)."""
    *same, (paths, copied) = zip(_arrays(state), rows, strict=True)
    for array, own in same:
        array[index] = own
    room = min(paths.shape[2], copied.shape[2])  # the shorter of both has room for every path on these levels
    paths[index, :, :room] = copied[:, :, :room]


def _arrays(state: GameState) -> list[NDArray[Any]]:
    """Return all arrays with a row for each game, the records first and the ghosts' paths last."""
    own = state.completed_s, state.ghosts, state.obstacles, state.summary.T
    return [*state.rules.values(), *state.arrays.values(), *own, state.ghost_paths]


def check(
    source: GameState,
    target: GameState,
    games: NDArray[np.int64],
    into: NDArray[np.int64],
    seeds: NDArray[np.uint64] | None,
) -> None:
    """Raise ValueError if ``games`` (M,) of the source cannot be copied to ``into`` (M,) of the target."""
    if target.config != source.config:
        raise ValueError("clone_into: the target has another configuration")
    if games.shape != into.shape or games.ndim != 1:
        raise ValueError(f"clone_into: games of shape {games.shape} into {into.shape}: must be (M,) both")
    if seeds is not None and np.shape(seeds) != games.shape:
        raise ValueError(f"clone_into: reseed of shape {np.shape(seeds)}: must be {games.shape}")
    for name, index, n in (("games", games, source.n), ("into", into, target.n)):
        bad = np.flatnonzero((index < 0) | (index >= n))
        if len(bad):
            raise ValueError(f"clone_into: {name}[{bad[0]}] = {index[bad[0]]}: there are {n} games")
    if len(np.unique(into)) < len(into):
        raise ValueError(f"clone_into: into = {into.tolist()}: a game is named twice")


def reseed(games: NDArray[Any], ghosts: NDArray[Any], index: NDArray[np.int64], seeds: NDArray[np.uint64]) -> None:
    """Reseed all random streams of the games ``index`` (M,) with ``seeds`` (M,)."""
    for i, seed in zip(index.tolist(), seeds, strict=True):
        games["seed"][i] = seed
        games["localization_stream"][i] = _stream(seed, LOCALIZATION)
        games["nav_stream"][i] = _stream(seed, NAVIGATION)
        for number in range(ghosts.shape[1]):
            ghosts["stream"][i, number] = _ghost_stream(seed, number)
