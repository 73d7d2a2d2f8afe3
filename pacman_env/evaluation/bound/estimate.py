"""Estimate the achievable completion: a wide beam search with perfect information plays the coarse model."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pacman_env.config import Config
from pacman_env.engine.jit import kernel
from pacman_env.game.ghosts import Behaviour
from pacman_env.heuristics.search.beam import NODE, BeamMemory, new_memory, search
from pacman_env.heuristics.search.search import SearchParameters
from pacman_env.sim.coarse.model import NOWHERE, Behaviours, Lags, play
from pacman_env.sim.coarse.start import CoarseStart, start
from pacman_env.sim.observation.situation import Situation

_STARTED_AGAIN = ("collected", "collected_s")  # counted from the start of a search


@kernel
def _play(begin, goal, until_s):  # type: ignore[no-untyped-def]
    play(begin.robot[0], begin.ghosts, goal, until_s, begin.model)


class Estimate:
    """Play rounds of one configuration in the coarse model by a beam search that foresees every ghost move.

    The robot has the lags of the coarse model.
    """

    def __init__(self, behaviours: list[Behaviour], config: Config, width: int) -> None:
        self.config = config
        self._behaviours = Behaviours(behaviours, config)
        self._lags = Lags(step_s=config.execution.check_period_s, death_margin_m=0.0)
        p = SearchParameters()
        self._segment_s = p.segment_s
        self._settings = p.settings()
        self._settings["width"] = width
        self._memory: BeamMemory = new_memory(width, len(behaviours), self._settings)

    def play(self, situation: Situation, i: int) -> tuple[bool, float]:
        """Return whether the round of situation ``i`` is completed, and when it ends, s."""
        begin = start(situation, i, self.config, self._behaviours, self._lags, NODE)
        robot = begin.robot[0]
        while robot["pellets"] and not robot["dead"] and robot["time_s"] < self.config.time_limit_s:
            goal = self._choose(begin)
            _play(begin, np.int64(goal), float(robot["time_s"]) + self._segment_s)
        return not robot["pellets"], float(robot["time_s"])

    def _choose(self, begin: CoarseStart) -> int:
        goals = self._goals(begin, begin.robot[0])
        best = np.empty(len(goals))
        copy = begin._replace(robot=begin.robot.copy(), ghosts=begin.ghosts.copy())
        for name in _STARTED_AGAIN:
            copy.robot[name] = 0
        copy.robot["closest_m"] = np.inf
        search(copy, goals, self._settings, self._memory, best)
        # Like the policy, prefer the current goal.
        best += SearchParameters().keep_worth * ((goals == begin.robot["goal"][0]) & (goals != NOWHERE))
        return int(goals[best.argmax()])

    def _goals(self, begin: CoarseStart, robot: Any) -> NDArray[np.int64]:
        """Return the goals (R,): the nearest remaining pellets, the nearest refuges, and staying."""
        length = begin.model.map.robot_length[robot["block"]]
        bit = begin.model.bit.astype(np.int64)
        left = (np.uint64(robot["pellets"]) >> np.maximum(bit, 0).astype(np.uint64)) & np.uint64(1)
        pellet = (bit >= 0) & (left == 1) & np.isfinite(length)
        refuge = (np.arange(len(length)) >= begin.pellets) & np.isfinite(length)
        order = np.argsort(length, kind="stable")
        goals = [order[pellet[order]][: int(self._settings["pellets"][0])]]
        goals += [order[refuge[order]][: int(self._settings["refuges"][0])], np.array([NOWHERE])]
        return np.concatenate(goals).astype(np.int64)
