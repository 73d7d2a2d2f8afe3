"""Infos of the games of an environment, as arrays or as the numbers of one game."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..game.ends import ENDS
from ..observations.kinds import MASK
from ..sim.batch import GameBatch
from ..sim.kernels import SUMMARY
from ..sim.parameters import drawn_values

#: ``info["outcome"]`` by the game's end code.
OUTCOMES = np.array([end.word for end in ENDS], dtype=object)


class GameInfos:
    """Infos of the games of a batch; ``outcome`` is a word, or its index in ``OUTCOMES`` with numeric infos.

    ``allowed`` (N, C) is the mask of the allowed actions.
    """

    def __init__(self, batch: GameBatch) -> None:
        self._batch, self._config = batch, batch.config
        self._numeric, self._masked = self._config.observation.numeric_info, self._config.observation.mask == "info"
        self._several_levels, self._draws = len(batch.levels) > 1, bool(self._config.randomize.ranges())

    def of_all(self, allowed: NDArray[np.int8]) -> dict[str, NDArray[Any]]:
        """Return the infos as new arrays, (N,) each; a mask among them is (N, C).

        ``round_seed`` is int64, or uint64 if a seed given to a reset does not fit into int64.
        """
        summary = self._batch.summary.copy()
        result: dict[str, NDArray[Any]] = dict(zip(SUMMARY, summary, strict=True))
        if (result["round_seed"] < 0).any():  # the summary stores the bits of a uint64
            result["round_seed"] = result["round_seed"].view(np.uint64)
        if not self._numeric:
            result["outcome"] = OUTCOMES[summary[0]]
        return result | self._more(allowed)

    def of_first(self, allowed: NDArray[np.int8]) -> dict[str, Any]:
        """Return the infos of the first game as Python numbers."""
        info = dict(zip(SUMMARY, self._batch.summary[:, 0].tolist(), strict=True))
        if info["round_seed"] < 0:  # the summary stores the bits of a uint64
            info["round_seed"] += 2**64
        if not self._numeric:
            info["outcome"] = OUTCOMES[info["outcome"]]
        for key, array in self._more(allowed).items():
            info[key] = array[0] if array.ndim > 1 else array.tolist()[0]
        return info

    def _more(self, allowed: NDArray[np.int8]) -> dict[str, NDArray[Any]]:
        batch, config = self._batch, self._config
        result: dict[str, NDArray[Any]] = {}
        if self._masked:
            result[MASK] = allowed.copy()
        if self._several_levels:
            result["level"] = batch.level_numbers()
        if config.endless:
            result["round"] = batch.games["round"].astype(np.int64)
        if config.decisions.when == "event":
            result["elapsed_s"] = batch.elapsed_s.copy()
        return result | drawn_values(batch.games, config) if self._draws else result
