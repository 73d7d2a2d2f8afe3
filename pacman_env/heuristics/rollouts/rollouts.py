"""The policy ``rollouts``: tries the choices that a base policy prefers in games from the present situation.

In each game the robot drives to a candidate first, and then the base policy plays. All candidates meet the same drawn
futures. Another choice than the base's needs a significantly better mean return (rollout algorithm: Bertsekas,
Tsitsiklis and Wu, 1997).
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pacman_env.config import Config, RewardConfig
from pacman_env.game.ends import CAUGHT, RUNNING
from pacman_env.observations.situation import Situation
from pacman_env.observations.situation_writer import situation_of
from pacman_env.policies.base import BasePolicy, Explanation, Policy, keeps_state, require_numbers
from pacman_env.policies.learned import LearnedPlanner
from pacman_env.policies.registry import make_policy
from pacman_env.rng import POLICY, stream
from pacman_env.sim.batch import ALL_TICKS, GameBatch

from .games_from import games_for, games_from

#: Rewards in the futures and their scale: those of the training of ``ppo``, so that its values continue them.
_REWARDS = {"reward": RewardConfig(timeout=-10.0), "decisions.discount_per_s": 0.998}
_SCALE = 0.2
_TIE = 1e-9  # by which another candidate must be better than the base's choice
_UNTRIED = 1.0  # by which the score of a candidate that was not tried is lower than the lowest of the tried ones


class RolloutParameters(NamedTuple):
    """Parameters of the roll-outs, chosen on validation houses."""

    candidates: int = 3  # largest number of candidates that are tried
    futures: int = 16  # games for each of them; after half of them, those with a lower mean than the base's choice go
    seconds: float = 35.0  # length of a game, after which the base's value counts
    decide_s: float = 2.0  # time between two decisions in a game
    errors: float = 1.5  # standard errors of the advantage by which a candidate must be better than the base's choice
    every: int = 2  # a goal is kept for this many ticks
    certain: float = 0.999  # nothing is tried if the base gives its choice this probability ...
    near_m: float = 3.0  # ... and no ghost is as near as this


class Trial(NamedTuple):
    """What the futures of one situation showed about K candidates, the base's choice first."""

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

    ``base`` is a policy without state, or its name or file. The number of futures is fixed, except on a robot, whose
    limit ``decisions.limit_s`` ends late games at the base's values.
    """

    name = "rollouts"
    stateless = True

    def __init__(self, base: str | Policy = "ppo", **parameters: Any) -> None:
        self.parameters = p = RolloutParameters(**parameters)
        require_numbers(p._asdict(), ("candidates", "futures", "seconds", "decide_s", "every"))
        if p.futures % 2 or p.futures < 4:
            raise ValueError(f"futures = {p.futures!r}: must be an even number of at least 4")
        self.base = make_policy(base) if isinstance(base, str) else base
        if keeps_state(self.base):
            raise ValueError(f"base = {base!r}: must be a policy without state, which does not define reset")
        self._batch: GameBatch | None = None

    def reset(self, games: NDArray[np.bool_], config: Config) -> None:
        if config is not self.config:
            self._batch = None
        super().reset(games, config)
        self.base.reset(games, config)

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_batch": None}  # a copy makes its own games

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
        scores = np.where(situation.mask, self.base.scores(situation), -np.inf)
        trials: list[Trial | None] = [None] * len(situation)
        if self._batch is None and np.isfinite(scores[0]).any():  # compile everything, even if the choice is easy
            self._try(situation, 0, scores[0])
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
        if isinstance(self.base, LearnedPlanner):
            return self.base.judge_together(situation)
        scores = np.array(self.base.scores(situation), dtype=np.float64)
        return np.where(situation.mask, scores, -np.inf), np.zeros(len(scores))

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
        until_s = math.inf if self.clock_s is None else self.clock_s() + self.config.decisions.limit_s
        order = np.argsort(-scores, kind="stable")[: p.candidates]
        order = order[np.isfinite(scores[order])]
        trial = Trial(order, *(np.full((len(order), p.futures), np.nan) for _ in range(2)))
        seeds = np.array([_future_seed(situation, i, m) for m in range(p.futures)], dtype=np.uint64)
        rows, half = np.arange(len(order)), p.futures // 2
        for part in (slice(half), slice(half, p.futures)):
            games_from(situation, i, batch, seeds[part])
            index = np.arange(half, half * len(rows))
            batch.copy_games(index % half, index)
            returns = self._play(batch, np.repeat(order[rows], half), until_s)
            trial.returns[rows, part] = returns.reshape(-1, half)
            trial.caught[rows, part] = (batch.games["end"][: len(returns)] == CAUGHT).reshape(-1, half)
            rows = rows[(rows == 0) | (trial.bound(0.0)[rows] > 0.0)]
            if len(rows) == 1 or (self.clock_s is not None and self.clock_s() > until_s):
                break
        return trial

    def _play(self, batch: GameBatch, first: NDArray[np.int64], until_s: float) -> NDArray[np.float64]:
        """Play a game for each candidate in ``first`` (n,), at most until ``until_s``; return their returns (n,)."""
        n, p = len(first), self.parameters
        last = batch.games["tick"][0] + round(p.seconds / batch.config.execution.tick_s)
        played, choices = np.arange(batch.n) < n, np.full(batch.n, batch.hold)
        choices[:n] = first
        returns, factor, forbidden = np.zeros(batch.n), np.ones(batch.n), np.zeros(batch.n, dtype=np.bool_)
        ticks = p.every  # the first choice is kept as long as in the game
        while True:
            batch.step_until_due(choices, forbidden, None, played, ticks)
            ticks = ALL_TICKS
            returns[played] += _SCALE * factor[played] * batch.reward[played]
            factor[played] *= batch.config.decisions.discount_per_s ** batch.elapsed_s[played]
            played &= batch.games["end"] == RUNNING
            index = np.flatnonzero(played)
            if len(index) == 0:
                return returns[:n]
            scores, values = self._judge(situation_of(batch).rows(index))
            choices[index] = scores.argmax(axis=1)
            late = self.clock_s is not None and self.clock_s() > until_s
            over = index[(batch.games["tick"][index] >= last) | late]
            returns[over] += factor[over] * values[np.isin(index, over)]
            played[over] = False

    def _games(self, situation: Situation) -> GameBatch:
        p = self.parameters
        if self._batch is None:
            longest = {f"decisions.{name}": p.decide_s for name in ("longest_s", "threat_longest_s")}
            config = self.config.with_fields(**{"decisions.when": "event", **longest, **_REWARDS})
            self._batch = games_for(situation, config, p.candidates * p.futures // 2)
        return self._batch


def of_lookahead(**parameters: Any) -> Rollouts:
    """Return the policy ``rollouts:lookahead``, whose base is ``lookahead``, so that nothing is learned."""
    policy = Rollouts("lookahead", **parameters)
    policy.name = "rollouts:lookahead"
    return policy


def _future_seed(situation: Situation, i: int, number: int) -> np.uint64:
    """Return the seed of a future, which depends on the round's seed, the tick and the number of the future."""
    purpose = np.uint64((int(situation.tick[i]) << 12) + (number << 4) + POLICY)
    with np.errstate(over="ignore"):
        return np.uint64(stream(situation.seed[i], purpose)) >> np.uint64(1)  # seeds are below 2**63
