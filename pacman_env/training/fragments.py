"""Fragments: the steps of one part of the games between two updates, which a thread plays.

A fragment depends on the games, the network and a seed, not on the thread or on other parts.
"""

from __future__ import annotations

import functools
import os
from typing import Any, Literal, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray

from pacman_env.sb3 import Observation
from pacman_env.training.planner_network import EntityNetwork, PackedSituations, joined
from pacman_env.training.training_games import Ending, Games, PlannerGames

#: Who plays: the network with drawn choices, a rule that teaches, or the network's best choices with a rule's labels.
How = Literal["drawn", "taught", "labelled"]


class FragmentChoices(NamedTuple):
    situations: PackedSituations
    order: torch.Tensor  # (B, C) numbers of the candidates before they were packed
    slots: torch.Tensor  # (B,) places of the chosen candidates in ``situations``
    log_probs: torch.Tensor  # (B,)
    values: torch.Tensor  # (B,)


class Fragment(NamedTuple):
    """T steps in each of N games; the B = T N situations are ordered by step, then by game."""

    situations: tuple[NDArray[Any], ...]  # the fields of ``PackedSituations``
    slots: NDArray[np.int64]  # (B,) places of the choices, or of a rule's labels
    log_probs: NDArray[np.float32]  # (B,)
    values: NDArray[np.float32]  # (T + 1, N)
    rewards: NDArray[np.float32]  # (T, N)
    dones: NDArray[np.bool_]  # (T, N)
    endings: list[Ending]
    agreed: float  # share of choices that the network and the rule agree on


@torch.inference_mode()
def choose(
    network: EntityNetwork, observation: Observation, generator: torch.Generator | None = None
) -> tuple[FragmentChoices, NDArray[np.int64]]:
    """Return the network's choices in N situations, and the numbers (N,) of the chosen candidates.

    The choices are drawn with ``generator``; None: the candidates with the highest logits.
    """
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


def play(
    games: Games, observation: Observation, network: EntityNetwork, steps: int, how: How, seed: int
) -> tuple[Fragment, Observation]:
    """Play the next ``steps`` decisions in each game; ``how`` selects the player, ``seed`` decides drawn choices.

    ``observation`` is the present one; the one after the fragment is returned with it.
    """
    generator = torch.Generator().manual_seed(seed) if how == "drawn" else None
    if how != "drawn":
        assert isinstance(games, PlannerGames), "only planners are taught"
        games.begin_teaching()
    size = steps, games.num_envs
    rewards, dones = np.zeros(size, dtype=np.float32), np.zeros(size, dtype=np.bool_)
    values = np.zeros((steps + 1, games.num_envs), dtype=np.float32)
    slots, log_probs = [], []
    endings: list[Ending] = []
    agreed = 0.0
    met: list[PackedSituations] = []
    for t in range(steps):
        labels = games.choices() if isinstance(games, PlannerGames) and how != "drawn" else None
        choices, actions = choose(network, observation, generator)
        met.append(choices.situations)
        if labels is None:
            slots.append(choices.slots)
        else:
            agreed += float((actions == labels).mean()) / steps
            slots.append((choices.order == torch.from_numpy(labels)[:, None]).byte().argmax(dim=1))
        log_probs.append(choices.log_probs)
        values[t] = choices.values.numpy()
        step = games.step(labels if how == "taught" and labels is not None else actions)
        observation, rewards[t], dones[t] = step[:3]
        endings += step.endings
    values[-1] = choose(network, observation)[0].values.numpy()
    fragment = Fragment(
        tuple(array.numpy() for array in joined(met)),
        torch.cat(slots).numpy(),
        torch.cat(log_probs).numpy(),
        values,
        rewards,
        dones,
        endings,
        agreed,
    )
    return fragment, observation


@functools.cache
def use_device(name: str) -> str:
    """Set torch up for reproducible training on a device, and return the device's name.

    A second call with the same name does nothing. Raises ValueError if the device cannot be used.
    """
    os.environ.setdefault("CUBLAS_WORKSPACE_CONFIG", ":4096:8")  # otherwise the order of additions on a GPU varies
    torch.set_deterministic_debug_mode("error")  # use_deterministic_algorithms imports a compiler for two seconds
    torch.utils.deterministic.fill_uninitialized_memory = False  # uninitialized memory is never read
    torch.set_num_threads(1)  # the learner has its own threads
    torch.empty(31 << 20, dtype=torch.uint8)  # after this, glibc reuses large blocks
    if name.partition(":")[0] not in ("cpu", "cuda"):
        raise ValueError(f"device = {name!r}: must be cpu or cuda, or cuda:N of several")
    try:
        torch.zeros(1, device=name)
    except (RuntimeError, AssertionError) as error:
        raise ValueError(f"device = {name!r}: cannot be used: {str(error).splitlines()[0]}") from None
    return name
