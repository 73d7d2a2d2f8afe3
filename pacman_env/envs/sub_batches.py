"""Sub-batches of a vector environment: one is stepped while the network chooses for another."""

from __future__ import annotations

import collections
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from functools import partial
from typing import TYPE_CHECKING, Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from ..policies.base import Flags, Floats
from .resets import CheckedReset, ResetOptions, one_for_each

if TYPE_CHECKING:
    from .pacmanbot_vector import PacManBotVectorEnv

Step = tuple[Any, Floats, Flags, Flags, dict[str, Any]]


class SubBatches:
    """Sub-batches of equal size; each has a thread, and results come in the order in which steps were sent."""

    def __init__(self, envs: Sequence[PacManBotVectorEnv]) -> None:
        self.envs = envs
        self._size = envs[0].num_envs
        self._sent: collections.deque[tuple[int, Future[Step]]] = collections.deque()
        self._pool: ThreadPoolExecutor | None = None
        self._started = False
        self.last = 0  # index of the sub-batch received last
        self.received_all = False  # True if the last call received all sub-batches

    def __getstate__(self) -> dict[str, Any]:
        if self._sent:
            raise RuntimeError(f"{len(self._sent)} sub-batches are being stepped: recv() them before a copy is made")
        return {**self.__dict__, "_pool": None}

    def _ids(self, number: int) -> NDArray[np.int64]:
        return np.arange(number * self._size, (number + 1) * self._size)

    def reset(self, seed: Any, options: dict[str, Any] | None) -> None:
        """Start new rounds in all sub-batches, as if they had been sent; running steps are awaited and dropped."""
        games = len(self.envs) * self._size
        seeds, request = one_for_each(seed, games), ResetOptions.of(options, games)
        self._wait()  # a running step would change the games that are checked
        resets = []
        for k, env in enumerate(self.envs):
            own = [seeds[i] for i in self._ids(k)]
            resets.append(env._prepare(own, request.of_games(self._ids(k))))
        self.close()
        for k, (env, prepared) in enumerate(zip(self.envs, resets, strict=True)):
            self._submit(k, partial(_begin_games, env, prepared))
        self._started = True

    def send(self, actions: NDArray[Any], ids: NDArray[Any] | None) -> None:
        """Step the sub-batch with the games ``ids``, by default the one received last."""
        self._require_reset()
        number = self.last
        if ids is not None:
            first = np.asarray(ids).ravel()[:1]
            number = int(first[0]) // self._size if len(first) else -1
            if not 0 <= number < len(self.envs) or not np.array_equal(ids, self._ids(number)):
                raise ValueError(f"env_id = {ids!r}: must be the games of one sub-batch, as in the info of recv()")
        if any(number == other for other, _ in self._sent):
            raise ValueError(f"games {self._ids(number)[[0, -1]].tolist()} are being stepped: recv() them first")
        env = self.envs[number]
        self._submit(number, partial(env._step_games, env.check(actions).copy()))  # the caller may reuse its array

    def receive(self) -> Step:
        """Return the result of the sub-batch that was sent first; ``info["env_id"]`` lists its games."""
        if not self._sent:
            raise ValueError("nothing is being stepped: send() first")
        number, future = self._sent.popleft()
        observation, reward, terminated, truncated, info = future.result()
        self.last, self.received_all = number, False
        return observation, reward, terminated, truncated, {**info, "env_id": self._ids(number)}

    def send_all(self, actions: NDArray[Any]) -> None:
        """Step every sub-batch; raises ValueError if one is still being stepped."""
        self._require_reset()
        self.require_received()
        checked = [env.check(actions[self._ids(k)]) for k, env in enumerate(self.envs)]
        for k, env in enumerate(self.envs):
            self._submit(k, partial(env._step_games, checked[k]))

    def require_received(self) -> None:
        """Raise ValueError if a step was sent and not received."""
        if self._sent:
            raise ValueError(f"{len(self._sent)} sub-batches are being stepped: recv() them before step()")

    def received(self) -> Step:
        """Return the results of all sub-batches in the order of their games; after an error, drop the others."""
        self._wait()
        try:
            observations, *numbers, infos = zip(*[self.receive() for _ in self.envs], strict=True)
        finally:
            self._sent.clear()
        self.received_all = True
        reward, terminated, truncated = map(np.concatenate, numbers)
        return _join(observations), reward, terminated, truncated, _join_infos(infos)

    def close(self) -> None:
        """Wait for running steps and drop their results."""
        self._wait()
        self._sent.clear()
        if self._pool is not None:
            self._pool.shutdown()
            self._pool = None

    def _wait(self) -> None:
        for _, future in self._sent:
            future.exception()

    def _require_reset(self) -> None:
        if not self._started:
            raise gym.error.ResetNeeded("call async_reset() first")

    def _submit(self, number: int, work: Callable[[], Step]) -> None:
        if self._pool is None:
            self._pool = ThreadPoolExecutor(len(self.envs), thread_name_prefix="pacman_env-sub-batch")
        self._sent.append((number, self._pool.submit(work)))


def _begin_games(env: PacManBotVectorEnv, prepared: CheckedReset) -> Step:
    index = env._begin(prepared)
    nothing = np.zeros(env.num_envs, dtype=np.bool_)
    return env._runner.observe(), np.zeros(env.num_envs), nothing, nothing.copy(), env._infos(index)


def _join(values: Sequence[Any]) -> Any:
    if isinstance(values[0], dict):
        return {key: _join([value[key] for value in values]) for key in values[0]}
    return np.concatenate(values)


def _join_infos(infos: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Join infos in Gymnasium's layout; a key that some sub-batches lack is empty there, with a False mask."""
    result: dict[str, Any] = {}
    for key in dict.fromkeys(key for info in infos for key in info):
        like = next(info[key] for info in infos if key in info)
        if isinstance(like, dict):
            result[key] = _join_infos([info.get(key, {}) for info in infos])
        else:
            nothing = np.full_like(like, None if like.dtype == object else 0)  # sub-batches are of equal size
            result[key] = np.concatenate([info.get(key, nothing) for info in infos])
    return result
