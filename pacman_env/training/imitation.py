"""A first policy by imitation: the network learns what a rule chooses, and the returns of the rule's rounds.

PPO from random weights hides from Clyde for its first half million decisions; from here it begins where the rule ends.
"""

from __future__ import annotations

from functools import partial
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray

from pacman_env.sb3 import Observation
from pacman_env.training.games import TrainingGames
from pacman_env.training.learner import Learner, PieceLoss
from pacman_env.training.network import Packed, Row

_ROUNDS, _EPOCHS, _BATCH, _RATE = 4, 2, 2048, 1e-3
_ENTROPY = 0.1  # keeps the choices from becoming certain, so that PPO has something to compare


class _Labels(NamedTuple):
    """The teacher's choices in situations, and the returns."""

    slots: torch.Tensor  # (B,) its choices, as the situations have them
    returns: torch.Tensor  # (B,) discounted
    known: torch.Tensor  # (B,) 1 where the return is known: the round ended in time

    def loss(self, model: Learner, met: Packed, count: int, rows: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Of some rows of a minibatch of ``count`` of the situations ``met``; no measures."""
        situations, slots = met.of(rows), self.slots[rows]
        logits, values = model.network.judge_packed(situations)
        log_probs = logits.log_softmax(dim=1)
        entropy = -(log_probs.exp() * log_probs).sum()
        error = ((values - self.returns[rows]).square() * self.known[rows]).sum()
        taught = slots < situations.counts  # nothing is learned from what the network of an ablation may not choose
        labelled = log_probs.gather(1, torch.where(taught, slots, 0)[:, None])[:, 0]
        return (0.5 * error - (labelled * taught).sum() - _ENTROPY * entropy) / count, torch.zeros(0)


def imitate(model: Learner, games: TrainingGames, decisions: int, *, games_seed: int, seed: int) -> dict[str, float]:
    """Fit the network to what the rule ``lookahead`` would choose in so many situations; ``seed`` orders minibatches.

    In the first of four rounds the rule plays, in the others the network does and the rule labels the situations, so
    that the network also learns in situations that the rule does not get into (DAgger: Ross, Gordon, Bagnell, 2011).
    Returns the share of choices that agree in the last round.
    """
    steps = max(decisions // games.num_envs // _ROUNDS, 1)
    optimizer = torch.optim.Adam(model.network.parameters(), lr=_RATE)
    generator = torch.Generator().manual_seed(seed)
    met, labelled = Row(_ROUNDS * steps * games.num_envs), list[_Labels]()
    observation = games.reset(games_seed)
    for number in range(_ROUNDS):
        observation, labels, agreement = _play(model, games, steps, observation, number > 0, met)
        labelled.append(labels)
        _fit(model, optimizer, met.situations(), _Labels(*map(torch.cat, zip(*labelled, strict=True))), generator)
    return {"agreement": agreement}


def _fit(
    model: Learner, optimizer: torch.optim.Optimizer, met: Packed, labels: _Labels, generator: torch.Generator
) -> None:
    def loss_of(rows: torch.Tensor) -> PieceLoss:
        return partial(labels.loss, model, met, len(rows))

    model.descend(optimizer, loss_of, met.counts, epochs=_EPOCHS, size=_BATCH, generator=generator)


def _play(
    model: Learner, games: TrainingGames, steps: int, observation: Observation, alone: bool, met: Row
) -> tuple[Observation, _Labels, float]:
    """Play on, the rule or (``alone``) the model, and add the situations to those ``met``.

    Returns the last observation, the labels, and how often they agreed.
    """
    n = games.num_envs
    slots: list[torch.Tensor] = []
    rewards, dones = np.zeros((steps, n), dtype=np.float32), np.zeros((steps, n), dtype=np.bool_)
    agreed = 0.0
    for t in range(steps):
        labels = games.choices("lookahead")
        choices, own = model.choose(observation, deterministic=True)
        agreed += float((own == labels).mean()) / steps
        met.add(choices.situations)
        slots.append((choices.order == torch.as_tensor(labels, device=model.device)[:, None]).byte().argmax(dim=1))
        observation, rewards[t], dones[t], _ = games.step(own if alone else labels)
    flat = (torch.from_numpy(array.ravel()).to(model.device) for array in discounted(rewards, dones, model.hyper.gamma))
    return observation, _Labels(torch.cat(slots), *flat), agreed


def discounted(
    rewards: NDArray[np.float32], dones: NDArray[np.bool_], gamma: float
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """(T, N) discounted sums of rewards to the end of the round, and 1 where that end is among the steps, else 0."""
    returns, known = np.zeros_like(rewards), np.zeros_like(rewards)
    running, ends = np.zeros(rewards.shape[1], dtype=np.float32), np.zeros(rewards.shape[1], dtype=np.bool_)
    for t in reversed(range(len(rewards))):
        ends |= dones[t]
        running = rewards[t] + np.float32(gamma) * np.where(dones[t], np.float32(0.0), running)
        returns[t], known[t] = running, ends
    return returns, known
