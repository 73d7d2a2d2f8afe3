"""Write the situations of a batch of games."""

import weakref

import numpy as np

from ..engine.arrays import Table
from ..engine.pipeline import Stage
from ..sim.batch import GameBatch
from .situation import Situation
from .situation_kernel import REQUEST, ViewArrays, write_situations

#: Of each batch: arrays to write to, and the stage that writes them. Creating their table takes longer than a copy.
_writers: "weakref.WeakKeyDictionary[GameBatch, tuple[Situation, Stage]]" = weakref.WeakKeyDictionary()


def situation_of(batch: GameBatch, player: int = -1) -> Situation:
    """Return the current situation of the robot's policy, or of the policy of ghost ``player``, in new arrays."""
    if batch not in _writers:
        situation = new_situation(batch)
        _writers[batch] = situation, situation_stage(batch, situation)
    situation, (write, tables) = _writers[batch]
    tables[0].arrays["request"]["player"] = player
    batch.threads.run(write, tables, batch.n)
    return situation.copy()


def new_situation(batch: GameBatch) -> Situation:
    """Return arrays for the situations of a batch, which are not yet filled."""
    return Situation.empty(batch.n, batch.candidates, batch.ghosts.shape[1], batch.levels, batch.threads)


def situation_stage(batch: GameBatch, situation: Situation, player: int = -1) -> Stage:
    """Return the stage that writes the situation of the robot (or of ghost ``player``) and ``batch.summary``."""
    request = np.array([(situation.table.address, player)], dtype=REQUEST)
    table = Table(
        ViewArrays,
        rules=batch.rule_arrays,
        ghosts=batch.ghosts,
        ghost_paths=batch.ghost_paths,
        request=request,
        summary=batch.summary,
    )
    return write_situations, [table]
