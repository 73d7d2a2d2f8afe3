"""Write the situations of a batch of games."""

import weakref

import numpy as np

from ...engine.arrays import Table
from ...engine.pipeline import Stage
from ..core.batch import GameBatch
from .situation import Situation
from .situation_kernel import REQUEST, ViewArrays, direct, write_situations

_stages: "weakref.WeakKeyDictionary[GameBatch, Stage]" = weakref.WeakKeyDictionary()


def situation_of(batch: GameBatch, player: int = -1) -> Situation:
    """Return the current situation of the robot's policy, or of the policy of ghost ``player``, in new arrays."""
    situation = Situation.empty(batch.n, batch.candidates, batch.ghosts.shape[1], batch.levels, batch.threads)
    if batch not in _stages:
        _stages[batch] = situation_stage(batch, situation, player)
    write, tables = _stages[batch]
    direct(tables[0].arrays["request"], situation, player)
    batch.threads.run(write, tables, batch.n)
    return situation


def situation_stage(batch: GameBatch, situation: Situation, player: int = -1) -> Stage:
    """Return the stage that writes the situation of the robot (or of ghost ``player``) and ``batch.summary``."""
    request = np.zeros(1, dtype=REQUEST)
    direct(request, situation, player)
    table = Table(
        ViewArrays,
        rules=batch.rule_arrays,
        ghosts=batch.ghosts,
        ghost_paths=batch.ghost_paths,
        request=request,
        summary=batch.summary,
    )
    return write_situations, [table]
