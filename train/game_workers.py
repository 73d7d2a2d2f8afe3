"""Training games in parts, on several cores: some parts are stepped in this process, as many in each of its workers.

A worker steps its parts with the same code in a process of its own. What it sends are observations; this process
chooses for all games and learns. Which process steps a part changes nothing in it.
"""

from __future__ import annotations

import multiprocessing
import signal
import traceback
from collections.abc import Callable, Sequence
from itertools import chain
from multiprocessing.connection import Connection
from typing import Any

import numpy as np
from numpy.typing import NDArray
from stable_baselines3.common.vec_env import VecEnv
from stable_baselines3.common.vec_env.base_vec_env import VecEnvIndices, VecEnvStepReturn

from pacman_env.envs.sb3_vec_env import Observation, PacManBotVecEnv
from pacman_env.policies.base import Policy
from pacman_env.policies.registry import make_policy

Make = Callable[[], PacManBotVecEnv]


class _Part:
    """Games that are stepped together."""

    def __init__(self, make: Make) -> None:
        self.games = make()
        self._teachers: dict[str, Policy] = {}

    def size(self) -> tuple[int, int]:
        """Games and candidates."""
        return self.games.num_envs, self.games.env.batch.candidates

    def reset(self, seed: int | None) -> Observation:
        if seed is not None:
            self.games.seed(seed)
        self._teachers = {}
        return self.games.reset()

    def step(self, actions: NDArray[Any]) -> VecEnvStepReturn:
        self.games.step_async(actions)
        result = self.games.step_wait()
        for teacher in self._teachers.values():
            teacher.reset(result[2])
        return result

    def choices(self, policy: str) -> NDArray[np.int64]:
        if policy not in self._teachers:
            self._teachers[policy] = make_policy(policy)
            self._teachers[policy].reset(np.ones(self.games.num_envs, dtype=np.bool_))
        return self._teachers[policy].select(self.games.env.situation)

    def masks(self) -> NDArray[np.bool_]:
        return self.games.env.action_masks()

    def close(self) -> None:
        self.games.close()


class _Parts:
    """Parts in one process."""

    def __init__(self) -> None:
        self.parts: list[_Part] = []

    def call(self, name: str, arguments: Sequence[tuple[Any, ...]]) -> list[Any]:
        """The answers of all parts to a call of theirs; ``make`` gives the process other parts."""
        if name == "make":
            self.parts = [_Part(*one) for one in arguments]
            name, arguments = "size", [()] * len(self.parts)
        return [getattr(part, name)(*one) for part, one in zip(self.parts, arguments, strict=True)]


class Worker:
    """A process that steps parts. It ends with the process that made it."""

    def __init__(self) -> None:
        context = multiprocessing.get_context("spawn")  # a fork would copy torch's threads in whatever state they are
        self._pipe, other = context.Pipe()
        self._process = context.Process(target=_serve, args=(other,), daemon=True)
        self._process.start()
        other.close()

    def send(self, name: str, arguments: Sequence[tuple[Any, ...]]) -> None:
        """Have a call answered there, as ``_Parts.call`` does it.

        Raises:
            RuntimeError: the process has ended.
        """
        try:
            self._pipe.send((name, arguments))
        except OSError:
            raise self._ended() from None

    def receive(self) -> list[Any]:
        """The answers to what was sent.

        Raises:
            RuntimeError: the process has ended, or the call has failed there, with its traceback.
        """
        try:
            result, error = self._pipe.recv()
        except (EOFError, OSError):
            raise self._ended() from None
        if error is not None:
            raise RuntimeError(f"in a worker:\n{error}")
        return list(result)

    @property
    def pid(self) -> int | None:
        """Of the process."""
        return self._process.pid

    @property
    def exitcode(self) -> int | None:
        """Of the process, None while it runs."""
        return self._process.exitcode

    def _ended(self) -> RuntimeError:
        self._process.join(timeout=1.0)
        return RuntimeError(f"a worker has ended with exit status {self._process.exitcode}")

    def close(self) -> None:
        """End the process."""
        self._pipe.close()
        self._process.join(timeout=60.0)  # it may still be importing what it needs
        if self._process.is_alive():
            self._process.kill()
            self._process.join()


def _serve(pipe: Connection) -> None:
    """The work of a worker, until nobody sends any more."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # an interruption is for the process that learns
    parts = _Parts()
    while True:
        try:
            call = pipe.recv()
        except (EOFError, OSError):
            return
        try:
            result, error = parts.call(*call), None
        except Exception:  # whatever it is, it is told
            result, error = [], traceback.format_exc()
        pipe.send((result, error))


class ParallelGames(VecEnv):
    """The games of several parts in a row, as ``PacManBotVecEnv`` has them.

    Args:
        parts: what makes the games of each; they are dealt out to this process and the workers in turn.
        workers: processes; none: all games are stepped here. Those with nothing to do are left alone.

    Raises:
        ValueError: no parts, or parts whose candidates differ.
    """

    def __init__(self, parts: Sequence[Make], workers: Sequence[Worker] = ()) -> None:
        if not parts:
            raise ValueError("no games to play")
        self.here = _Parts()
        self._workers = list(workers[: len(parts) - 1])
        self._parts = len(parts)
        games, candidates = zip(*self._all("make", parts), strict=True)
        if len(set(candidates)) != 1:
            raise ValueError(f"candidates of the parts: {candidates}, must be as many in each")
        self._ends = np.cumsum(games)
        self._own = self.here.parts[0].games
        super().__init__(int(self._ends[-1]), self._own.observation_space, self._own.action_space)
        self._actions: NDArray[Any] = np.zeros(self.num_envs, dtype=np.int64)

    def _all(self, name: str, *arguments: Sequence[Any]) -> list[Any]:
        """The answers of all parts to a call, each with its own arguments; all processes are at it together."""
        each = list(zip(*arguments, strict=True)) if arguments else [()] * self._parts
        count = 1 + len(self._workers)
        for k, worker in enumerate(self._workers, start=1):
            worker.send(name, each[k::count])
        answers: list[Any] = [None] * self._parts
        answers[::count] = self.here.call(name, each[::count])
        for k, worker in enumerate(self._workers, start=1):
            answers[k::count] = worker.receive()
        return answers

    def reset(self) -> Observation:
        """Start new rounds in all games, with what ``seed`` has asked for since the last reset."""
        starts = [0, *self._ends[:-1].tolist()]
        result = _joined(self._all("reset", [self._seeds[start] for start in starts]))
        self._reset_seeds()
        self._reset_options()
        return result

    def step_async(self, actions: NDArray[Any]) -> None:
        """Keep the actions for ``step_wait``."""
        self._actions = actions

    def step_wait(self) -> VecEnvStepReturn:
        """One decision in every game."""
        results = self._all("step", np.split(np.asarray(self._actions), self._ends[:-1]))
        observations, rewards, dones, infos = zip(*results, strict=True)
        return _joined(observations), np.concatenate(rewards), np.concatenate(dones), list(chain.from_iterable(infos))

    def choices(self, policy: str) -> NDArray[np.int64]:
        """(N,) the choices of a registered policy in each game now."""
        return np.concatenate(self._all("choices", [policy] * self._parts))

    def close(self) -> None:
        """Close the games; workers are their owner's and can be given others."""
        self._all("close")

    def get_attr(self, attr_name: str, indices: VecEnvIndices = None) -> list[Any]:
        """An attribute that all games share.

        Raises:
            AttributeError: there is none of this name.
        """
        return self._own.get_attr(attr_name, [0]) * len(list(self._get_indices(indices)))

    def set_attr(self, attr_name: str, value: Any, indices: VecEnvIndices = None) -> None:
        """Refused.

        Raises:
            AttributeError: always.
        """
        raise AttributeError(f"{attr_name}: games of several processes cannot be changed")

    def env_method(
        self, method_name: str, *method_args: Any, indices: VecEnvIndices = None, **method_kwargs: Any
    ) -> list[Any]:
        """``action_masks`` alone.

        Raises:
            AttributeError: another method.
        """
        if method_name != "action_masks":
            raise AttributeError(f"games of several processes have no method {method_name!r}, only 'action_masks'")
        masks = np.concatenate(self._all("masks"))
        return [masks[i] for i in self._get_indices(indices)]

    def env_is_wrapped(self, wrapper_class: type, indices: VecEnvIndices = None) -> list[bool]:
        """Whether the wrapper is ``Monitor``."""
        return self._own.env_is_wrapped(wrapper_class, [0]) * len(list(self._get_indices(indices)))


def _joined(observations: Sequence[Observation]) -> Observation:
    return {key: np.concatenate([observation[key] for observation in observations]) for key in observations[0]}
