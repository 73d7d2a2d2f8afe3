"""A first policy by imitation: the network learns what a rule chooses, and what the rule's rounds are worth.

PPO from random weights hides from Clyde for its first half million decisions; from here it begins where the rule ends.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from sb3_contrib import MaskablePPO

from pacman_env.envs.sb3_vec_env import Observation

from .games import TrainingGames
from .network import FORBIDDEN

_ROUNDS, _EPOCHS, _BATCH, _RATE = 4, 2, 2048, 1e-3
_ENTROPY = 0.1  # keeps the choices from becoming certain, so that PPO has something to compare


class _Lesson(NamedTuple):
    """Rows that are learned from."""

    observations: dict[str, torch.Tensor]
    choices: torch.Tensor  # (B,) the teacher's
    returns: torch.Tensor  # (B,) discounted
    known: torch.Tensor  # (B,) 1 where the return is known: the round ended in time


def imitate(model: MaskablePPO, games: TrainingGames, teacher: str, decisions: int, seed: int) -> dict[str, float]:
    """Fit the model's policy to what the teacher, a registered policy, would choose in ``decisions`` situations.

    In the first of four rounds the teacher plays, in the others the model does and the teacher says what he would do,
    so that the model also learns the way out of situations that the teacher does not get into (DAgger: Ross, Gordon,
    Bagnell, 2011).

    Returns:
        Share of choices that agree in the last round.
    """
    steps = max(decisions // games.num_envs // _ROUNDS, 1)
    optimizer = torch.optim.Adam(model.policy.parameters(), lr=_RATE)
    generator = torch.Generator().manual_seed(seed)
    lessons: list[_Lesson] = []
    agreement = 0.0
    observation = games.reset()
    for number in range(_ROUNDS):
        observation, lesson, agreement = _play(model, games, teacher, steps, observation, number > 0)
        lessons.append(lesson)
        _fit(model, optimizer, lessons, generator)
    return {"agreement": agreement}


def _fit(
    model: MaskablePPO, optimizer: torch.optim.Optimizer, lessons: list[_Lesson], generator: torch.Generator
) -> None:
    policy = model.policy
    policy.set_training_mode(True)
    seen = {key: torch.cat([lesson.observations[key] for lesson in lessons]) for key in lessons[0].observations}
    choices = torch.cat([lesson.choices for lesson in lessons])
    returns = torch.cat([lesson.returns for lesson in lessons])
    known = torch.cat([lesson.known for lesson in lessons])
    for _ in range(_EPOCHS):
        for rows in torch.randperm(len(choices), generator=generator).split(_BATCH):
            batch = {key: tensor[rows] for key, tensor in seen.items()}
            values, log_prob, entropy = policy.evaluate_actions(batch, choices[rows])
            assert entropy is not None
            error = ((values[:, 0] - returns[rows]).square() * known[rows]).mean()
            taught = log_prob > FORBIDDEN / 10  # what the network of an ablation may not choose teaches it nothing
            loss = -(log_prob * taught).mean() - _ENTROPY * entropy.mean() + 0.5 * error
            optimizer.zero_grad()
            loss.backward()
            torch.nn.utils.clip_grad_norm_(policy.parameters(), 0.5)
            optimizer.step()


def _play(
    model: MaskablePPO, games: TrainingGames, teacher: str, steps: int, observation: Observation, alone: bool
) -> tuple[Observation, _Lesson, float]:
    """Play on, the teacher or (``alone``) the model; the last observation, the lesson, and how often they agreed."""
    n = games.num_envs
    seen: list[Observation] = []
    choices = np.zeros((steps, n), dtype=np.int64)
    rewards, dones = np.zeros((steps, n), dtype=np.float32), np.zeros((steps, n), dtype=np.bool_)
    agreed = 0.0
    for t in range(steps):
        choices[t] = games.venv.choices(teacher)  # type: ignore[attr-defined]
        own, _ = model.predict(observation, action_masks=observation["action_mask"], deterministic=True)
        agreed += float((own == choices[t]).mean()) / steps
        seen.append(observation)
        observation, rewards[t], dones[t], _ = games.step(own if alone else choices[t])  # type: ignore[assignment]
    returns, known = discounted(rewards, dones, model.gamma)
    stacked = {key: torch.from_numpy(np.concatenate([o[key] for o in seen])) for key in observation}
    flat = (torch.from_numpy(array.reshape(-1)) for array in (choices, returns, known))
    return observation, _Lesson(stacked, *flat), agreed


def discounted(
    rewards: NDArray[np.float32], dones: NDArray[np.bool_], gamma: float
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Discounted sums of rewards to the end of the round, and 1 where that end is among the steps, 0 where not.

    Args:
        rewards: (T, N) of each step.
        dones: (T, N) the round ended with the step.
        gamma: per step.
    """
    returns, known = np.zeros_like(rewards), np.zeros_like(rewards)
    running, ends = np.zeros(rewards.shape[1], dtype=np.float32), np.zeros(rewards.shape[1], dtype=np.bool_)
    for t in reversed(range(len(rewards))):
        ends |= dones[t]
        running = rewards[t] + np.float32(gamma) * np.where(dones[t], np.float32(0.0), running)
        returns[t], known[t] = running, ends
    return returns, known
