"""Fragments: the steps of one part of the games between two updates, as a task that any process can play.

A fragment depends on its task alone: the state of the games, the network, a seed. The process that played a part's last
fragment keeps the part's games; another process restores them bit for bit.
"""

from __future__ import annotations

import functools
import io
import os
import pickle
import threading
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray

from pacman_env.policies.base import Policy
from pacman_env.sb3 import Observation
from pacman_env.training.games import Ending, Games, Part, PlannerGames
from pacman_env.training.network import EntityNetwork, PackedSituations, joined

#: The player: the network with drawn choices, a rule that teaches, or the network's best choices with a rule's labels.
How = Literal["drawn", "taught", "labelled"]


class FragmentChoices(NamedTuple):
    situations: PackedSituations
    order: torch.Tensor  # (B, C) original numbers of the candidates in ``situations``
    slots: torch.Tensor  # (B,) chosen candidates, by their place in ``situations``
    log_probs: torch.Tensor  # (B,)
    values: torch.Tensor  # (B,)


@dataclass(frozen=True)
class Task:
    key: tuple[int, int]  # key of the part in the learner's process
    number: int  # number of the fragment
    part: Part
    games_seed: int  # seed of the part's first rounds
    state: bytes | None  # pickled games before the fragment; None: new rounds start
    network: EntityNetwork
    seed: int  # seed of the choices in the fragment
    steps: int
    how: How


class Fragment(NamedTuple):
    """T steps in each of N games; the B = T N situations are ordered by step, then by game."""

    situations: tuple[NDArray[Any], ...]  # the fields of ``PackedSituations``
    slots: NDArray[np.int64]  # (B,) choices (a rule's labels, if any), by their place in the situations
    log_probs: NDArray[np.float32]  # (B,)
    values: NDArray[np.float32]  # (T + 1, N)
    rewards: NDArray[np.float32]  # (T, N)
    dones: NDArray[np.bool_]  # (T, N)
    endings: list[Ending]
    agreed: float  # share of the network's choices that equal the rule's
    state: bytes  # pickled games after the fragment


@torch.inference_mode()
def choose(
    network: EntityNetwork, observation: Observation, generator: torch.Generator | None = None
) -> tuple[FragmentChoices, NDArray[np.int64]]:
    """Return a choice for each situation and its numbers of candidates; draw with the generator, or take the best."""
    seen = {key: torch.from_numpy(array) for key, array in observation.items()}
    situations, order = network.pack(seen["planner_candidates"], seen["planner_globals"], seen["action_mask"] > 0.5)
    logits, values = network.judge_packed(situations.of(slice(None)))
    log_probs = logits.log_softmax(dim=1)
    check(values + log_probs.sum(dim=1))
    drawn = log_probs
    if generator is not None:
        drawn = log_probs - torch.empty_like(log_probs).exponential_(generator=generator).log()
    slots = drawn.argmax(dim=1, keepdim=True)
    chosen = order.gather(1, slots)[:, 0].numpy()
    return FragmentChoices(situations, order, slots[:, 0], log_probs.gather(1, slots)[:, 0], values), chosen


def check(numbers: torch.Tensor) -> None:
    if not torch.isfinite(numbers).all():
        raise FloatingPointError("the training has diverged: logits are no numbers any more")


def play(task: Task) -> Fragment:
    """Play a fragment, in games that this process has kept or restores."""
    use_device("cpu")
    running = _begin(task)
    games, observation = running.games, running.observation
    generator = torch.Generator().manual_seed(task.seed) if task.how == "drawn" else None
    if task.how != "drawn":
        assert isinstance(games, PlannerGames), "only planners are taught"
        games.begin_teaching()
    size = task.steps, games.num_envs
    rewards, dones = np.zeros(size, dtype=np.float32), np.zeros(size, dtype=np.bool_)
    values = np.zeros((task.steps + 1, games.num_envs), dtype=np.float32)
    slots, log_probs = [], []
    endings: list[Ending] = []
    agreed = 0.0
    met: list[PackedSituations] = []
    for t in range(task.steps):
        labels = games.choices() if isinstance(games, PlannerGames) and task.how != "drawn" else None
        choices, actions = choose(task.network, observation, generator)
        met.append(choices.situations)
        if labels is None:
            slots.append(choices.slots)
        else:
            agreed += float((actions == labels).mean()) / task.steps
            slots.append((choices.order == torch.from_numpy(labels)[:, None]).byte().argmax(dim=1))
        log_probs.append(choices.log_probs)
        values[t] = choices.values.numpy()
        step = games.step(labels if task.how == "taught" and labels is not None else actions)
        observation, rewards[t], dones[t] = step[:3]
        endings += step.endings
    values[-1] = choose(task.network, observation)[0].values.numpy()
    running.observation = observation
    return Fragment(
        tuple(array.numpy() for array in joined(met)),
        torch.cat(slots).numpy(),
        torch.cat(log_probs).numpy(),
        values,
        rewards,
        dones,
        endings,
        agreed,
        _end(task, running),
    )


class _RunningPart:
    """Games of a part between fragments."""

    def __init__(self, task: Task) -> None:
        self._policies = task.part.policies()
        env = None
        if task.state is not None:
            env, self.observation = _Unpickler(task.state, self._policies).load()
        self.games: Games = task.part.make(self._policies, env)
        if task.state is None:
            self.observation = self.games.reset(task.games_seed)
        self.number = task.number

    def state(self) -> bytes:
        file = io.BytesIO()
        _Pickler(file, self._policies).dump((self.games.env, self.observation))
        return file.getvalue()


class _Pickler(pickle.Pickler):
    """Pickles games without their policies, which each process creates itself."""

    def __init__(self, file: io.BytesIO, policies: Sequence[Policy]) -> None:
        super().__init__(file)
        self._numbers = {id(policy): number for number, policy in enumerate(policies)}

    def persistent_id(self, obj: Any) -> int | None:
        return self._numbers.get(id(obj))


class _Unpickler(pickle.Unpickler):
    def __init__(self, state: bytes, policies: Sequence[Policy]) -> None:
        super().__init__(io.BytesIO(state))
        self._policies = policies

    def persistent_load(self, pid: int) -> Policy:
        return self._policies[pid]


#: Games that this worker process keeps between tasks; games of another learner replace them.
_KEPT: dict[tuple[int, int], _RunningPart] = {}
_LOCK = threading.Lock()


def _begin(task: Task) -> _RunningPart:
    with _LOCK:
        for key in [key for key in _KEPT if key[0] != task.key[0]]:
            del _KEPT[key]
        part = _KEPT.pop(task.key, None)
    return part if part is not None and part.number == task.number else _RunningPart(task)


def _end(task: Task, part: _RunningPart) -> bytes:
    part.number = task.number + 1
    with _LOCK:
        _KEPT[task.key] = part
    return part.state()


def forget() -> None:
    """Close the games that this process keeps."""
    with _LOCK:
        _KEPT.clear()


@functools.cache
def use_device(name: str) -> str:
    """Set torch up for reproducible training; raises ValueError if the device cannot be used."""
    os.environ.setdefault("CUBLAS_WORKSPACE_CONFIG", ":4096:8")  # otherwise the order of sums varies
    torch.set_deterministic_debug_mode("error")  # use_deterministic_algorithms imports a compiler for two seconds
    torch.utils.deterministic.fill_uninitialized_memory = False  # type: ignore[attr-defined]  # none is read
    torch.set_num_threads(1)  # the learner has its own threads
    torch.empty(31 << 20, dtype=torch.uint8)  # after this, glibc reuses large blocks (5 times faster)
    if name.partition(":")[0] not in ("cpu", "cuda"):
        raise ValueError(f"device = {name!r}: must be cpu or cuda, or cuda:N of several")
    try:
        torch.zeros(1, device=name)
    except (RuntimeError, AssertionError) as error:
        raise ValueError(f"device = {name!r}: cannot be used: {str(error).splitlines()[0]}") from None
    return name
