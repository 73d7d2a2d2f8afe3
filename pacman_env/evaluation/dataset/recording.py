"""Record rounds of a policy in an environment, in batches, with observations and decisions as arrays.

A task is plain data, and the arrays depend on it alone, neither on the batch in which a round is played nor on the
executor.
"""

import contextlib
from collections.abc import Generator, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pacman_env.config import Config, ConfigError
from pacman_env.envs.arguments import EnvArguments
from pacman_env.envs.game_runner import GameRunner
from pacman_env.envs.outcome import OUTCOMES
from pacman_env.envs.resets import SEEDS
from pacman_env.episodes.rollout import BATCH, MOST_ROUNDS, episode_seeds
from pacman_env.evaluation.rounds.scenarios import load_policy
from pacman_env.executors.base import Executor
from pacman_env.game.execution import RUNNING
from pacman_env.policies.asking import choose, reset
from pacman_env.sim.maps.level_source import FixedMap

_MOST_PER_TASK = 500  # most rounds of a task
_TASK_BYTES = 2**27  # approximate bytes of a task's observations
_DECISIONS = 100  # approximate number of decisions in a round
#: Record of a round.
ROUND = np.dtype(
    [
        ("seed", np.uint64),  # ``options={"round_seed": seed}`` plays it again
        ("level", np.int64),  # 0 if there is one map
        ("outcome", np.int64),  # index in OUTCOMES
        ("decisions", np.int64),
        ("return", np.float64),
        ("collected", np.int64),  # in an endless game, of all rounds
        ("spawned", np.int64),
        ("unlisted", np.int64),  # choices without an action, for which hold was played
    ]
)


@dataclass(frozen=True)
class Recording:
    """A task: rounds of one policy in one environment."""

    policy: str  # a name or a file
    arguments: EnvArguments
    seeds: NDArray[np.uint64]  # (E,)


@dataclass(frozen=True)
class RecordedRounds:
    """E rounds with D decisions in total, one after the other; each round has one more observation than decisions."""

    rounds: NDArray  # (E,) ROUND
    observations: dict[str, NDArray[Any]]  # (D + E, ...), nested keys joined by "/"; "" for a single array
    masks: NDArray[np.int8]  # (D + E, C)
    actions: NDArray[np.int64]  # (D,)
    rewards: NDArray[np.float64]  # (D,)
    terminated: NDArray[np.bool_]  # (D,)
    truncated: NDArray[np.bool_]  # (D,)
    elapsed_s: NDArray[np.float64]  # (D,) simulated, until the next decision

    def slices(self) -> Iterator[tuple[slice, slice]]:
        """Yield the slices of the decisions and of the observations of each round."""
        ends = np.cumsum(self.rounds["decisions"]).tolist()
        for number, (end, count) in enumerate(zip(ends, self.rounds["decisions"].tolist(), strict=True)):
            yield slice(end - count, end), slice(end - count + number, end + number + 1)


def round_seeds(seed: int, episodes: int) -> NDArray[np.uint64]:
    """Draw the seeds (E,) like a comparison, cut to 63 bits like the seeds of environments."""
    return episode_seeds(seed, episodes) % np.uint64(SEEDS)


def check(config: Config) -> None:
    """Raise ConfigError for an environment that policies of this package cannot play."""
    if config.action != "goal":
        raise ConfigError(f"action = {config.action!r}: must be goal, because policies choose goals")


def tasks_of(policy: str, arguments: EnvArguments, seeds: NDArray[np.uint64]) -> list[Recording]:
    """Return the tasks in the order of the data set; rounds of a level are adjacent, so that its map is prepared once.

    Raises ConfigError, MapError, or the error of creating the policy.
    """
    load_policy(policy)
    config, _ = arguments.make_config()
    check(config)
    source = arguments.make_source(config)
    if not isinstance(source, FixedMap):
        seeds = seeds[np.argsort(source.levels_of(seeds), kind="stable")]
    space = GameRunner(1, arguments).observation_space
    row = sum(part.dtype.itemsize * int(np.prod(part.shape)) for part in flattened(space).values())
    rounds = int(np.clip(_TASK_BYTES // (row * _DECISIONS), BATCH, _MOST_PER_TASK))
    parts = np.split(seeds, range(rounds, len(seeds), rounds))
    return [Recording(policy, arguments, part) for part in parts]


def recorded(tasks: Sequence[Recording], executor: Executor) -> Generator[RecordedRounds, None, None]:
    """Yield the rounds of all tasks in order, whatever the executor; raises the first error."""
    early: dict[int, RecordedRounds] = {}
    number = 0
    with contextlib.closing(executor.run(record, tasks)) as ends:
        for done in ends:
            early[done.number] = done.result()
            while number in early:
                yield early.pop(number)
                number += 1


def record(task: Recording) -> RecordedRounds:
    """Play the rounds of a task."""
    arguments, policy = task.arguments, load_policy(task.policy)
    runner = GameRunner(min(BATCH, len(task.seeds)), arguments)
    check(runner.config)
    return _Recorder(runner, policy, task.seeds).play()


class _View(NamedTuple):
    """Observations and mask of every game, before a decision or after the last one."""

    observations: dict[str, NDArray[Any]]
    mask: NDArray[np.bool_]


class _Decision(NamedTuple):
    """Decision and results of every game, each (N,)."""

    action: NDArray[np.int64]
    reward: NDArray[np.float64]
    terminated: NDArray[np.bool_]
    truncated: NDArray[np.bool_]
    elapsed_s: NDArray[np.float64]


class _Recorder:
    """Plays rounds in a batch; an ended game starts its next round in the step of the others, so one view is enough."""

    def __init__(self, runner: GameRunner, policy: Any, seeds: NDArray[np.uint64]) -> None:
        self._runner, self._policy, self._seeds = runner, policy, seeds
        n = runner.batch.n
        self._round = np.arange(n)  # round that each game plays, -1: none
        self._began = np.zeros(n, dtype=np.int64)  # step of the first decision in the round
        self._unlisted = np.zeros(n, dtype=np.int64)
        self._next = n  # next round to start
        self._rounds = np.zeros(len(seeds), dtype=ROUND)
        self._places = np.zeros((len(seeds), 2), dtype=np.int64)  # game and first step of each round

    def play(self) -> RecordedRounds:
        runner, n = self._runner, self._runner.batch.n
        runner.reset(np.arange(n), self._seeds[:n])
        reset(self._policy, np.ones(n, dtype=np.bool_), runner.config)
        over = np.zeros(n, dtype=np.bool_)
        views, decisions = [self._look()], list[_Decision]()
        while (self._round >= 0).any():
            decisions.append(self._decide(over))
            restarts = np.flatnonzero(over & (self._round >= 0))
            if len(restarts):
                runner.reset(restarts, self._seeds[self._round[restarts]], in_step=True)
                self._began[restarts], self._unlisted[restarts] = len(decisions), 0
            starts = np.isin(np.arange(n), restarts) | (runner.batch.completed_s > 0)
            if starts.any():
                reset(self._policy, starts, runner.config)
            views.append(self._look())
            over = self._end(decisions[-1], over, len(decisions))
        return self._collect(views, decisions)

    def _look(self) -> _View:
        return _View(flattened(self._runner.observe()), self._runner.masks())

    def _decide(self, over: NDArray[np.bool_]) -> _Decision:
        """Play the policy's choice until the next decision; games that are over stand still."""
        runner = self._runner
        chosen = choose(self._policy, runner.situation)
        action, listed = runner.observer.actions_of(chosen)
        self._unlisted += ~listed
        rewards, terminated, truncated = runner.step(action)
        return _Decision(action, rewards, terminated & ~over, truncated & ~over, runner.elapsed_s.copy())

    def _end(self, decision: _Decision, over: NDArray[np.bool_], steps: int) -> NDArray[np.bool_]:
        """Return the mask (N,) of games that are over; record their rounds and assign the next ones."""
        batch = self._runner.batch
        many = (batch.games["round"] > MOST_ROUNDS) & ~over
        decision.truncated[many & ~decision.terminated] = True
        ended = np.flatnonzero((decision.terminated | decision.truncated) & (self._round >= 0))
        rounds = self._round[ended]
        self._places[rounds] = np.stack([ended, self._began[ended]], axis=1)
        notes, games = self._rounds, batch.games[ended]
        notes["seed"][rounds] = self._seeds[rounds]
        notes["level"][rounds] = batch.level_numbers()[ended]
        notes["outcome"][rounds] = games["end"]
        notes["decisions"][rounds] = steps - self._began[ended]
        notes["collected"][rounds] = games["all_collected"]
        notes["spawned"][rounds] = games["spawned"]
        notes["unlisted"][rounds] = self._unlisted[ended]
        follow = self._next + np.arange(len(ended))
        self._round[ended] = np.where(follow < len(self._seeds), follow, -1)
        self._next += len(ended)
        return (batch.games["end"] != RUNNING) | many | (self._round < 0)

    def _collect(self, views: list[_View], decisions: list[_Decision]) -> RecordedRounds:
        """Return the rows of each round, in the order of the seeds."""
        counts, games, began = self._rounds["decisions"], self._places[:, 0], self._places[:, 1]

        def rows(steps: list[Any], extra: int) -> NDArray[Any]:
            many = counts + extra
            within = np.arange(many.sum()) - np.repeat(np.cumsum(many) - many, many)
            return np.stack(steps)[np.repeat(began, many) + within, np.repeat(games, many)]

        observations = {key: rows([one.observations[key] for one in views], 1) for key in views[0].observations}
        action, reward, *others = (rows(list(column), 0) for column in zip(*decisions, strict=True))
        self._rounds["return"] = np.add.reduceat(reward, np.cumsum(counts) - counts)
        masks = rows([one.mask for one in views], 1).astype(np.int8)
        return RecordedRounds(self._rounds, observations, masks, action, reward, *others)


def flattened(observation: Any, key: str = "") -> dict[str, Any]:
    """Return the arrays of a nested observation, or the parts of its space, by their keys joined by "/"."""
    if not hasattr(observation, "items"):
        return {key: observation}
    parts = (flattened(part, f"{key}/{name}".lstrip("/")) for name, part in observation.items())
    return {name: array for part in parts for name, array in part.items()}


def outcomes(rounds: NDArray) -> list[str]:
    """Return the outcome of each round as a word."""
    return [str(word) for word in OUTCOMES[rounds["outcome"]].tolist()]
