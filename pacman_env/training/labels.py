"""Imitation before PPO: the network learns the choices of a rule that teaches against its line-up.

From random weights, PPO spends its first half million decisions on hiding from Clyde; imitation avoids this.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import torch

from .arguments import Hyperparameters
from .games import PlannerGames, start
from .lineups import make_teacher
from .network import EntityNetwork, PackedSituations, choose, joined

if TYPE_CHECKING:
    from pacman_env.training.ppo import PPO

#: Number of turns of playing and fitting, epochs of each turn, minibatch size, learning rate.
_TURNS, _EPOCHS, _BATCH, _RATE = 4, 2, 2048, 1e-3
_ENTROPY = 0.1  # entropy coefficient, so that PPO can still explore


class Labels(NamedTuple):
    """Choices of teachers in B situations."""

    situations: PackedSituations
    slots: torch.Tensor  # (B,) places of the teacher's choices in the situations
    returns: torch.Tensor  # (B,) discounted returns
    valid: torch.Tensor  # (B,) 1 if the return is complete, because the round ended
    agreed: torch.Tensor  # (B,) 1 if the network chooses the same


def imitate(model: PPO, parts: Sequence[PlannerGames], decisions: int, *, games_seed: int, seed: int) -> float:
    """Fit the network to the teachers' choices in ``decisions`` situations; ``seed`` decides the order of minibatches.

    In the first of four turns the teacher plays. In the others the network plays and the teacher labels the
    situations, so that the network also learns in situations that the teacher avoids (DAgger: Ross, Gordon, Bagnell,
    2011). ``games_seed`` decides the rounds. Returns the share of choices in the last turn in which network and teacher
    agree.
    """
    steps = max(decisions // sum(part.num_envs for part in parts) // _TURNS, 1)
    optimizer = torch.optim.Adam(model.network.parameters(), lr=_RATE)
    generator = torch.Generator().manual_seed(seed)
    met: list[Labels] = []
    start(parts, games_seed, model.pool)
    for turn in range(_TURNS):
        play = partial(play_labelled, model.copy(), model.hyper, steps, turn == 0)
        played = list(model.pool.map(play, parts))
        met += played
        labels = joined(met, model.device)
        counts = labels.situations.mask.sum(dim=1)
        for _ in range(_EPOCHS):
            for rows in torch.randperm(len(counts), generator=generator).to(model.device).split(_BATCH):
                model.descend(optimizer, partial(loss, model.network, labels, len(rows)), rows, counts)
    return float(torch.cat([labels.agreed for labels in played]).mean())


@torch.inference_mode()
def play_labelled(
    network: EntityNetwork, hyper: Hyperparameters, steps: int, teaching: bool, games: PlannerGames
) -> Labels:
    """Label ``steps`` decisions in each game; the teacher plays if it is ``teaching``, otherwise the network."""
    config = games.env.env.config
    teacher = make_teacher(games.lineup, hyper.teacher_nodes)
    teacher.reset(np.ones(games.num_envs, dtype=np.bool_), config)
    situations, slots, agreed, rewards, dones = [], [], [], [], []
    for _ in range(steps):
        choices, labels = choose(network, games.observation), teacher.select(games.env.env.situation)
        situations.append(choices.situations)
        slots.append((choices.order == torch.from_numpy(labels)[:, None]).byte().argmax(dim=1))
        agreed.append(choices.slots == slots[-1])
        step = games.step(labels if teaching else choices.actions)
        if step.dones.any():
            teacher.reset(step.dones, config)
        rewards.append(torch.from_numpy(step.rewards))
        dones.append(torch.from_numpy(step.dones).float())
    returns, valid = discounted(torch.stack(rewards), torch.stack(dones), hyper.gamma)
    return Labels(joined(situations), torch.cat(slots), returns.flatten(), valid.flatten(), torch.cat(agreed).float())


def discounted(rewards: torch.Tensor, dones: torch.Tensor, gamma: float) -> tuple[torch.Tensor, torch.Tensor]:
    """Return the discounted returns (T, N), and a mask (T, N): 1 if the round ends within the T steps, else 0."""
    returns, future = torch.zeros_like(rewards), torch.zeros_like(rewards[0])
    for t in reversed(range(len(rewards))):
        returns[t] = future = rewards[t] + gamma * (1 - dones[t]) * future
    return returns, dones.flip(0).cummax(dim=0).values.flip(0)


def loss(network: EntityNetwork, labels: Labels, count: int, rows: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """Return the loss of ``rows`` (M,) of a minibatch of ``count`` situations, and no metrics (0,)."""
    situations, slots = labels.situations.of(rows), labels.slots[rows]
    logits, values = network(*situations)
    log_probs = logits.log_softmax(dim=1)
    entropy = -(log_probs.exp() * log_probs).sum()
    value_loss = ((values - labels.returns[rows]).square() * labels.valid[rows]).sum()
    allowed = slots < situations.mask.sum(dim=1)  # ignore a label that an ablation forbids
    label_log_probs = log_probs.gather(1, torch.where(allowed, slots, 0)[:, None])[:, 0]
    return (0.5 * value_loss - (label_log_probs * allowed).sum() - _ENTROPY * entropy) / count, torch.zeros(0)
