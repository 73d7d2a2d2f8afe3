"""Training games in sub-batches with houses of their own, stepped while the network chooses.

The few houses of a sub-batch stay in the processor's cache while it is stepped. Sub-batches form two groups, each with
a thread in the background: one is stepped while the network chooses for the other. The number of threads does not
change the games.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from itertools import chain
from typing import Any

import numpy as np
from numpy.typing import NDArray
from stable_baselines3.common.vec_env import VecEnv
from stable_baselines3.common.vec_env.base_vec_env import VecEnvIndices, VecEnvStepReturn

from pacman_env.policies.base import Policy
from pacman_env.policies.registry import make_policy
from pacman_env.sb3 import Observation, PacManBotVecEnv


class _SubBatch:
    def __init__(self, games: PacManBotVecEnv) -> None:
        self.games = games
        self._teachers: dict[str, Policy] = {}

    def reset(self, seed: int | None) -> Observation:
        if seed is not None:
            self.games.seed(seed)
        self._teachers = {}
        return self.games.reset()

    def step(self, actions: NDArray[Any]) -> VecEnvStepReturn:
        self.games.step_async(actions)
        result = self.games.step_wait()
        for teacher in self._teachers.values():
            teacher.reset(result[2], self.games.env.config)
        return result

    def choices(self, policy: str) -> NDArray[np.int64]:
        if policy not in self._teachers:
            self._teachers[policy] = make_policy(policy)
            every = np.ones(self.games.num_envs, dtype=np.bool_)
            self._teachers[policy].reset(every, self.games.env.config)
        return self._teachers[policy].select(self.games.env.situation)


class SubBatchedGames(VecEnv):
    """The games of several sub-batches in a row, as ``PacManBotVecEnv`` has them.

    Args:
        batches: the games of each.
        background: step each group in a thread of its own.

    Raises:
        ValueError: no games, or sub-batches whose candidates differ.
    """

    def __init__(self, batches: Sequence[PacManBotVecEnv], background: bool = False) -> None:
        if not batches:
            raise ValueError("no games to play")
        candidates = {games.env.batch.candidates for games in batches}
        if len(candidates) != 1:
            raise ValueError(f"candidates of the sub-batches: {sorted(candidates)}, must be as many in each")
        self.games = list(batches)
        self._batches = [_SubBatch(games) for games in batches]
        self._starts = [0, *np.cumsum([games.num_envs for games in batches]).tolist()]
        middle = len(batches) // 2
        self._halves = [half for half in (range(middle), range(middle, len(batches))) if half]
        self.groups = [slice(self._starts[half[0]], self._starts[half[-1] + 1]) for half in self._halves]
        self._sent: list[Callable[[], VecEnvStepReturn]] = [self._nothing_sent for _ in self.groups]
        self._pool = ThreadPoolExecutor(len(self.groups), "games") if background else None
        super().__init__(self._starts[-1], batches[0].observation_space, batches[0].action_space)

    def reset(self) -> Observation:
        """Start new rounds in all games, with what ``seed`` has asked for since the last reset."""
        starts = zip(self._batches, self._starts, strict=False)
        result = _joined([batch.reset(self._seeds[start]) for batch, start in starts])
        self._reset_seeds()
        self._reset_options()
        return result

    def send(self, group: int, actions: NDArray[Any]) -> None:
        """Have the games of a group take their next decision; other groups may be sent before it is received."""
        step = partial(self._step, self._halves[group], np.asarray(actions))
        self._sent[group] = step if self._pool is None else self._pool.submit(step).result

    def receive(self, group: int) -> VecEnvStepReturn:
        """The results of a group's last ``send``.

        Raises:
            RuntimeError: nothing was sent.
        """
        receive, self._sent[group] = self._sent[group], self._nothing_sent
        return receive()

    def _step(self, half: range, actions: NDArray[Any]) -> VecEnvStepReturn:
        first = self._starts[half[0]]
        ends = [self._starts[k + 1] - first for k in half[:-1]]
        each = np.split(actions, ends)
        return _in_a_row(self._batches[k].step(own) for k, own in zip(half, each, strict=True))

    @staticmethod
    def _nothing_sent() -> VecEnvStepReturn:
        raise RuntimeError("no actions were sent to these games")

    def step_async(self, actions: NDArray[Any]) -> None:
        for k, rows in enumerate(self.groups):
            self.send(k, np.asarray(actions)[rows])

    def step_wait(self) -> VecEnvStepReturn:
        return _in_a_row(map(self.receive, range(len(self.groups))))

    def choices(self, policy: str) -> NDArray[np.int64]:
        """(N,) the choices of a registered policy in each game now."""
        return np.concatenate([batch.choices(policy) for batch in self._batches])

    def close(self) -> None:
        """Close the games, after the step under way."""
        if self._pool is not None:
            self._pool.shutdown()
        for games in self.games:
            games.close()

    def get_attr(self, attr_name: str, indices: VecEnvIndices = None) -> list[Any]:
        """An attribute that all games share.

        Raises:
            AttributeError: there is none of this name.
        """
        return self.games[0].get_attr(attr_name, [0]) * len(list(self._get_indices(indices)))

    def set_attr(self, attr_name: str, value: Any, indices: VecEnvIndices = None) -> None:
        """Raise AttributeError: games of several sub-batches cannot be changed."""
        raise AttributeError(f"{attr_name}: games of several sub-batches cannot be changed")

    def env_method(
        self, method_name: str, *method_args: Any, indices: VecEnvIndices = None, **method_kwargs: Any
    ) -> list[Any]:
        """``action_masks`` alone.

        Raises:
            AttributeError: another method.
        """
        if method_name != "action_masks":
            raise AttributeError(f"games of several sub-batches have no method {method_name!r}, only 'action_masks'")
        masks = np.concatenate([games.env.action_masks() for games in self.games])
        return [masks[i] for i in self._get_indices(indices)]

    def env_is_wrapped(self, wrapper_class: type, indices: VecEnvIndices = None) -> list[bool]:
        """Whether the wrapper is ``Monitor``."""
        return self.games[0].env_is_wrapped(wrapper_class, [0]) * len(list(self._get_indices(indices)))


def _in_a_row(results: Iterator[VecEnvStepReturn]) -> VecEnvStepReturn:
    observations, rewards, dones, infos = zip(*results, strict=True)
    return _joined(observations), np.concatenate(rewards), np.concatenate(dones), list(chain.from_iterable(infos))


def _joined(observations: Sequence[Any]) -> Observation:
    return {key: np.concatenate([observation[key] for observation in observations]) for key in observations[0]}
