"""A policy that tries the choices of a base policy in games from the present situation.

In each game the robot drives to a candidate first, and then the base policy plays. All candidates meet the same drawn
futures. Another choice than the base's needs a significantly better mean return (rollout algorithm: Bertsekas,
Tsitsiklis and Wu, 1997). With this folder on ``PYTHONPATH``, its name in commands is ``rollouts:Rollouts``.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pacman_env import BasePolicy, Policy, make_policy
from pacman_env.config import RewardConfig
from pacman_env.game.ends import CAUGHT, RUNNING
from pacman_env.observations.games_from import games_for, games_from
from pacman_env.observations.planner_features import planner_features
from pacman_env.observations.situation import Situation
from pacman_env.observations.situation_writer import situation_of
from pacman_env.policies.base import Explanation
from pacman_env.policies.learned import LearnedPlanner
from pacman_env.rng import POLICY, stream
from pacman_env.sim.batch import GameBatch

#: Rewards in the futures and their scale, as in the training of ``ppo``, so that its values continue them.
_REWARDS = {"reward": RewardConfig(timeout=-10.0), "decisions.discount_per_s": 0.998}
_SCALE = 0.2
_TIE = 1e-9  # by which another candidate must be better than the base's choice
_UNTRIED = 1.0  # by which the score of a candidate that was not tried is lower than the lowest of the tried ones


class RolloutParameters(NamedTuple):
    """Parameters of the roll-outs."""

    candidates: int = 3  # largest number of candidates that are tried
    futures: int = 16  # games for each of them; after half of them, those with a lower mean than the base's choice go
    seconds: float = 33.0  # length of a game, after which the base's value counts
    decide_s: float = 3.0  # time between two decisions in a game
    errors: float = 1.5  # standard errors of the advantage by which a candidate must be better than the base's choice
    every: int = 2  # a goal is kept for this many ticks
    certain: float = 0.99  # nothing is tried if the base gives its choice this probability ...
    near_m: float = 4.0  # ... and no ghost is as near as this


class Trial(NamedTuple):
    """Holds the results of the futures of one situation for K candidates, the base's choice first."""

    candidates: NDArray[np.int64]  # (K,)
    returns: NDArray[np.float64]  # (K, M); NaN: not played
    caught: NDArray[np.float64]  # (K, M) 1: the robot was caught; NaN: not played

    def bound(self, errors: float) -> NDArray[np.float64]:
        """Return the mean advantage (K,) over the base's choice, plus ``errors`` standard errors."""
        gained = self.returns - self.returns[0]
        played = np.isfinite(gained).sum(axis=1)
        return np.nanmean(gained, axis=1) + errors * np.nanstd(gained, axis=1, ddof=1) / np.sqrt(played)


class Rollouts(BasePolicy):
    """The roll-out policy; further arguments are the fields of :class:`RolloutParameters`.

    ``base`` is a policy without state, or its name or file.
    """

    name = "rollouts"

    def __init__(self, base: str | Policy = "ppo", **parameters: Any) -> None:
        self.parameters = RolloutParameters(**parameters)
        self.base = make_policy(base) if isinstance(base, str) else base
        self._batch: GameBatch | None = None
        self._made_for: Any = None  # configuration of the games of ``_batch``

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_batch": None, "_made_for": None}  # a copy makes its own games

    def scores(self, situation: Situation) -> NDArray[np.float64]:
        """Return scores (N, C): the lower bound of the advantage over the base's choice, or the base's scores."""
        return self._think(situation)[0]

    def explain(self, situation: Situation) -> Explanation:
        """Return the base's terms, and for each candidate that was tried its mean return and the share of catches."""
        scores, trials = self._think(situation)
        reasons = self.base.explain(situation)
        for row, own, trial in zip(reasons, scores.tolist(), trials, strict=True):
            for reason, score in zip(row, own, strict=True):
                reason["score"] = score
            if trial is not None:
                returns, caught = np.nanmean(trial.returns, axis=1), np.nanmean(trial.caught, axis=1)
                for candidate, value, share in zip(trial.candidates.tolist(), returns, caught, strict=True):
                    row[candidate] |= {"return": float(value), "caught_in_futures": float(share)}
        return reasons

    def _think(self, situation: Situation) -> tuple[NDArray[np.float64], list[Trial | None]]:
        """Return scores (N, C), and for each situation the trial, or None if its choice is easy."""
        if self._made_for is not self.config:
            self.base.reset(np.ones(len(situation), np.bool_), self.config)
            self._batch, self._made_for = None, self.config
        scores = np.where(situation.mask, self.base.scores(situation), -np.inf)
        trials: list[Trial | None] = [None] * len(situation)
        for i, own in enumerate(scores):
            current = int(situation.current[i])
            if situation.tick[i] % self.parameters.every and current >= 0 and situation.mask[i, current]:
                own[current] = own.max() + 1.0
            elif not self._is_easy(situation, i, own):
                trials[i] = trial = self._try(situation, i, own)
                tried = trial.bound(-self.parameters.errors)
                tried[1:] -= _TIE
                own += tried.min() - _UNTRIED - own.max()
                own[trial.candidates] = tried
        return scores, trials

    def _judge(self, situation: Situation) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the base's scores (N, C) and values (N,), 0 for a base without values, in games of one trial."""
        if not isinstance(self.base, LearnedPlanner):
            return np.where(situation.mask, self.base.scores(situation), -np.inf), np.zeros(len(situation))
        # For a file of your own, one run for all games is several times faster than ``scores``, but rounds differently.
        candidates, whole = planner_features(situation, self.base.metadata.robot_speed_mps)
        logits, values = self.base.run(candidates, whole, situation.mask)
        return np.where(situation.mask, logits, -np.inf).astype(np.float64), values.astype(np.float64)

    def _is_easy(self, situation: Situation, i: int, scores: NDArray[np.float64]) -> bool:
        """Return True if there is no choice, or the base is certain of it and no ghost is near."""
        if np.isfinite(scores).sum() < 2:
            return True
        probability = 1.0 / np.exp(scores - scores.max()).sum()
        seen = situation.ghosts[i, ~situation.harmless[i], :2]
        near_m = np.hypot(*(seen - situation.robot[i, :2]).T).min(initial=np.inf)
        return bool(probability >= self.parameters.certain and near_m > self.parameters.near_m)

    def _try(self, situation: Situation, i: int, scores: NDArray[np.float64]) -> Trial:
        """Play the futures of the candidates with the best ``scores`` (C,) in situation ``i``."""
        p, batch = self.parameters, self._games(situation)
        order = np.argsort(-scores, kind="stable")[: p.candidates]
        order = order[np.isfinite(scores[order])]
        trial = Trial(order, *(np.full((len(order), p.futures), np.nan) for _ in range(2)))
        seeds = np.array([_future_seed(situation, i, m) for m in range(p.futures)], dtype=np.uint64)
        rows, half = np.arange(len(order)), p.futures // 2
        for part in (slice(half), slice(half, p.futures)):
            games_from(situation, i, batch, seeds[part])
            index = np.arange(half, half * len(rows))
            batch.copy_games(index % half, index)
            returns = self._play(batch, np.repeat(order[rows], half))
            trial.returns[rows, part] = returns.reshape(-1, half)
            trial.caught[rows, part] = (batch.games["end"][: len(returns)] == CAUGHT).reshape(-1, half)
            rows = rows[(rows == 0) | (trial.bound(0.0)[rows] > 0.0)]
            if len(rows) == 1:
                break
        return trial

    def _play(self, batch: GameBatch, first: NDArray[np.int64]) -> NDArray[np.float64]:
        """Play a game for each candidate in ``first`` (n,), and return their returns (n,)."""
        n, p = len(first), self.parameters
        last = batch.games["tick"][0] + round(p.seconds / batch.config.execution.tick_s)
        played, choices = np.arange(batch.n) < n, np.full(batch.n, batch.hold)
        choices[:n] = first
        returns, factor, forbidden = np.zeros(batch.n), np.ones(batch.n), np.zeros(batch.n, dtype=np.bool_)
        while True:
            batch.step_until_due(choices, forbidden, None, played)
            returns[played] += _SCALE * factor[played] * batch.reward[played]
            factor[played] *= batch.config.decisions.discount_per_s ** batch.elapsed_s[played]
            played &= batch.games["end"] == RUNNING
            index = np.flatnonzero(played)
            if len(index) == 0:
                return returns[:n]
            scores, values = self._judge(situation_of(batch).rows(index))
            choices[index] = scores.argmax(axis=1)
            over = index[batch.games["tick"][index] >= last]
            returns[over] += factor[over] * values[np.isin(index, over)]
            played[over] = False

    def _games(self, situation: Situation) -> GameBatch:
        p = self.parameters
        if self._batch is None:
            longest = {f"decisions.{name}": p.decide_s for name in ("longest_s", "threat_longest_s")}
            config = self.config.with_fields(**{"decisions.when": "event", **longest, **_REWARDS})
            self._batch = games_for(situation, config, p.candidates * p.futures // 2)
        return self._batch


def _future_seed(situation: Situation, i: int, number: int) -> np.uint64:
    """Return the seed of a future, which depends on the round's seed, the tick and the number of the future."""
    purpose = np.uint64((int(situation.tick[i]) << 12) + (number << 4) + POLICY)
    with np.errstate(over="ignore"):
        return np.uint64(stream(situation.seed[i], purpose)) >> np.uint64(1)  # seeds are below 2**63
