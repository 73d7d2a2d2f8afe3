"""Infos of the games of a batch after a tick."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..game.ends import ENDS
from ..policies.base import Flags, Floats, Indices
from ..sim.core import kernels

#: ``info["outcome"]`` by the game's end code.
OUTCOMES = np.array([end.word for end in ENDS], dtype=object)
Ends = tuple[Floats, Flags, Flags]  # reward, terminated, truncated, each (N,)
Step = tuple[Any, Floats, Flags, Flags, dict[str, Any]]  # observations, Ends and infos


def infos(summary: Indices, numeric: bool = False) -> dict[str, NDArray[Any]]:
    """Return the infos as new arrays (N,) from a batch's ``summary`` (8, N), in the order of ``kernels.SUMMARY``.

    ``outcome`` is a word (object), or with ``numeric`` its index in ``OUTCOMES``. ``round_seed`` is int64, or uint64 if
    a seed given to a reset does not fit into int64.
    """
    summary = summary.copy()
    result: dict[str, NDArray[Any]] = dict(zip(kernels.SUMMARY, summary, strict=True))
    if (result["round_seed"] < 0).any():  # the summary stores the bits of a uint64
        result["round_seed"] = result["round_seed"].view(np.uint64)
    return result if numeric else {**result, "outcome": OUTCOMES[summary[0]]}


def info(summary: Indices, numeric: bool = False) -> dict[str, Any]:
    """Return the infos of the first game, column 0 of ``summary`` (8, N), as Python numbers."""
    result = dict(zip(kernels.SUMMARY, summary[:, 0].tolist(), strict=True))
    if result["round_seed"] < 0:  # the summary stores the bits of a uint64
        result["round_seed"] += 2**64
    if not numeric:
        result["outcome"] = OUTCOMES[result["outcome"]]
    return result
