"""Rewards and ends of the steps of an environment: shaping, rewards of ghosts, and limits of decisions."""

from typing import Any

import numpy as np

from ..game.ends import RUNNING
from ..game.reward import Rewards, TickCounts, reward
from ..observations.situation import Situation
from ..policies.base import Flags, Floats, Indices
from ..sim.batch import GameBatch

Ends = tuple[Floats, Flags, Flags]  # reward, terminated, truncated, each (N,)
Step = tuple[Any, Floats, Flags, Flags, dict[str, Any]]  # observations, Ends and infos


class StepRewards:
    """Rewards and ends of the steps of N games.

    An episode has at most ``most_steps`` decisions (None: no limit); if ``several`` agents play, the setting
    ``max_cycles`` is the limit, and truncated games stand still as if they were over.
    """

    def __init__(self, batch: GameBatch, several: bool, most_steps: int | None) -> None:
        self._batch, self._config, self._several = batch, batch.config, several
        self._most_steps = self._config.max_cycles if several else most_steps
        self._steps = np.zeros(batch.n, dtype=np.int64)  # decisions in the current episode
        self.cut = np.zeros(batch.n, dtype=np.bool_)  # truncated by the step limit and not yet reset
        self._by_path = bool(self._config.reward.progress or self._config.ghost_reward.progress)
        self._path_left = np.zeros(batch.n)  # m, path from the believed pose to the nearest pellet; 0 if there is none
        self._nearer = np.zeros(batch.n)  # m by which this path became shorter in the last step
        self._was_over = np.zeros(batch.n, dtype=np.bool_)  # before the last step
        changed = several or self._by_path or self._most_steps is not None or self._config.timeout == "termination"
        self.plain = not changed  # these are the rewards and ends of the batch

    def begin_episodes(self, index: Indices, situation: Situation) -> None:
        """Start to count in the games ``index`` (M,), after the first observation of their episodes."""
        self._steps[index] = 0
        self.cut[index] = False
        self._measure(situation)

    @property
    def counters(self) -> dict[str, Any]:
        """Attributes (N,) on which the next rewards and ends depend."""
        return {name: value for name, value in vars(self).items() if isinstance(value, np.ndarray)}

    def begin_step(self) -> None:
        """Remember which games are over: the next step has no shaping reward and no reward of ghosts in them."""
        if self._by_path or self._several:
            over = self._batch.games["end"] != RUNNING
            self._was_over = over | self.cut if self._several else over

    def end_step(self, situation: Situation) -> Ends:
        """Return the rewards and ends of the step that led to ``situation``."""
        batch, config = self._batch, self._config
        earned, terminated, truncated = batch.reward.copy(), batch.terminated.copy(), batch.truncated.copy()
        if self._several:
            earned[self.cut] = 0.0
        if config.timeout == "termination":
            terminated, truncated = terminated | truncated, np.zeros_like(truncated)
        if self._by_path:
            before = self._path_left
            self._measure(situation)
            self._nearer = self._progress(before, terminated)
            earned += config.reward.progress * self._nearer
        if self._most_steps is not None:
            self._steps += 1
            long = self._steps >= self._most_steps
            self.cut = long & ~terminated & ~truncated
            truncated |= long & ~terminated if self._several else long  # one agent: as in Gymnasium's ``TimeLimit``
        return earned, terminated, truncated

    def of_ghost(self) -> Floats:
        """Return a ghost's reward (N,) in the last step, from ``config.ghost_reward``; 0 in games that were over."""
        games, config = self._batch.games, self._config.ghost_reward
        counts = TickCounts(*(games[name] for name in TickCounts._fields))
        earned = np.where(self._was_over, 0.0, reward(counts, games["end"], Rewards.of(config)))
        return earned + config.progress * self._nearer if self._by_path else earned

    def _measure(self, situation: Situation) -> None:
        if self._by_path:
            alive = self._batch.alive  # (N, P)
            lengths = np.where(alive, situation.path_robot[:, : alive.shape[1]], np.inf).min(axis=1)
            self._path_left = np.where(np.isfinite(lengths), lengths, 0.0)

    def _progress(self, path_before: Floats, terminated: Flags) -> Floats:
        """Return the shaping reward gamma phi(s') - phi(s) of the last step, (N,), m.

        The potential phi is minus the path length to the nearest pellet, and 0 after a termination. With gamma = 1 the
        sum over a terminated episode is the path length at its start, whatever the agent did.
        """
        config = self._config
        passed_s = self._batch.elapsed_s if config.decisions.when == "event" else config.execution.tick_s
        left = np.where(terminated, 0.0, self._path_left)
        return np.where(self._was_over, 0.0, path_before - config.decisions.discount_per_s**passed_s * left)
