"""Compute which candidates are power pellets and which ghosts are frightened or away, as float32 columns."""

from typing import Any, NamedTuple

import numpy as np

from ...engine.arrays import Array, Table, arrays_by_address, zeros
from ...engine.jit import table_kernel
from ...engine.native import address_of
from ...engine.pipeline import Stage
from .robot_features import OLD_S, Columns, Observation
from .situation import AWAY_S, FRIGHTENED_S, LAYOUT, Situation

CANDIDATE_POWER_COLUMNS: Columns = (("is_power", 0.0, 1.0, ""),)
GHOST_POWER_COLUMNS: Columns = (
    ("is_frightened", 0.0, 1.0, ""),
    ("frightened", 0.0, OLD_S, "s, until it is not frightened any more"),
    ("is_away", 0.0, 1.0, "1, after it was caught"),
    ("away", 0.0, OLD_S, "s, until it starts again"),
)


class PowerArrays(NamedTuple):
    candidate_power: Any = Array(np.float32, f"N C {len(CANDIDATE_POWER_COLUMNS)}")
    ghost_power: Any = Array(np.float32, f"N G {len(GHOST_POWER_COLUMNS)}")


class _FillArrays(NamedTuple):
    block: Any = Array(np.uint8, "b")  # of the situations
    lengths: Any = Array(np.int64, "3")
    power: Any = PowerArrays


_arrays, _situation = arrays_by_address(_FillArrays), LAYOUT.arrays


def power_features(situation: Situation) -> Observation:
    """Return ``candidate_power`` (N, C, 1) and ``ghost_power`` (N, G, 4)."""
    n, candidates, ghosts = situation.block()[1:]
    arrays = zeros(PowerArrays, PowerArrays._fields, N=n, C=candidates, G=ghosts)
    job, tables = power_stage(situation, arrays)
    situation.threads.run(job, tables, n)
    return arrays


def power_stage(situation: Situation, arrays: Observation) -> Stage:
    """Return the stage that fills the arrays of :func:`power_features`."""
    block, *lengths = situation.block()
    power = PowerArrays(**{name: arrays[name] for name in PowerArrays._fields})
    return write_power, [Table(_FillArrays, block=block, lengths=np.array(lengths), power=power)]


@table_kernel
def write_power(table, first, last):  # type: ignore[no-untyped-def]
    a = _arrays(table)
    n, count, others = a.lengths
    s, candidates, ghosts = (
        _situation(address_of(a.block), n, count, others),
        a.power.candidate_power,
        a.power.ghost_power,
    )
    for i in range(first, last):
        for c in range(count):
            candidates[i, c, 0] = s.is_power[i, c] and s.mask[i, c]
        for k in range(others):
            frightened_s, away_s = s.fright[i, k, FRIGHTENED_S], s.fright[i, k, AWAY_S]
            ghosts[i, k, 0], ghosts[i, k, 1] = frightened_s > 0.0, min(frightened_s, OLD_S)
            ghosts[i, k, 2], ghosts[i, k, 3] = away_s > 0.0, min(away_s, OLD_S)
    return 0
