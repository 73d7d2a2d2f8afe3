"""A first policy by imitation: the network learns what a rule chooses, and what the rule's rounds are worth.

PPO from random weights hides from Clyde for its first half million decisions; from here it begins where the rule ends.
"""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from sb3_contrib import MaskablePPO
from torch.nn import functional

from pacman_env.envs.sb3_vec_env import Observation
from pacman_env.policies.base import Policy
from train.games import TrainingGames

_EPOCHS, _BATCH, _RATE = 3, 2048, 1e-3
_ENTROPY = 0.01  # keeps the choices from becoming certain, so that PPO has something to compare


def imitate(model: MaskablePPO, games: TrainingGames, teacher: Policy, decisions: int, seed: int) -> dict[str, float]:
    """Fit the model's policy to the teacher's choices in ``decisions`` decisions of its own.

    Returns:
        Share of choices that agree and loss of the last epoch.
    """
    steps = max(decisions // games.num_envs, 1)
    observations, choices, returns, known = _play(games, teacher, steps, model.gamma)
    flat = {key: torch.from_numpy(value.reshape(-1, *value.shape[2:])) for key, value in observations.items()}
    chosen = torch.from_numpy(choices.reshape(-1))
    value, weight = torch.from_numpy(returns.reshape(-1)), torch.from_numpy(known.reshape(-1))
    policy = model.policy
    policy.set_training_mode(True)
    optimizer = torch.optim.Adam(policy.parameters(), lr=_RATE)
    generator = torch.Generator().manual_seed(seed)
    agree, losses = [], []
    for epoch in range(_EPOCHS):
        agree, losses = [], []
        for group in optimizer.param_groups:
            group["lr"] = _RATE * (1.0 - epoch / _EPOCHS)
        for rows in torch.randperm(len(chosen), generator=generator).split(_BATCH):
            batch = {key: tensor[rows] for key, tensor in flat.items()}
            values, log_prob, entropy = policy.evaluate_actions(batch, chosen[rows])  # type: ignore[arg-type]
            assert entropy is not None
            error = (functional.mse_loss(values[:, 0], value[rows], reduction="none") * weight[rows]).mean()
            loss = -log_prob.mean() - _ENTROPY * entropy.mean() + 0.5 * error
            optimizer.zero_grad()
            loss.backward()  # type: ignore[no-untyped-call]
            torch.nn.utils.clip_grad_norm_(policy.parameters(), 0.5)
            optimizer.step()
            losses.append(float(loss.detach()))
            agree.append(float((log_prob.detach() > np.log(0.5)).float().mean()))
    return {"agreement": float(np.mean(agree)), "loss": float(np.mean(losses))}


def _play(
    games: TrainingGames, teacher: Policy, steps: int, gamma: float
) -> tuple[Observation, NDArray[np.int64], NDArray[np.float32], NDArray[np.float32]]:
    """Observations, choices, discounted returns (T, N), and 1 where a return is known: its round ended in time."""
    n = games.num_envs
    seen: list[Observation] = []
    choices = np.zeros((steps, n), dtype=np.int64)
    rewards, dones = np.zeros((steps, n), dtype=np.float32), np.zeros((steps, n), dtype=np.bool_)
    observation = games.reset()
    teacher.reset(np.ones(n, dtype=np.bool_))
    world = games.venv.env  # type: ignore[attr-defined]
    for t in range(steps):
        choices[t] = teacher.select(world.situation)
        seen.append(observation)
        observation, rewards[t], dones[t], _ = games.step(choices[t])  # type: ignore[assignment]
        teacher.reset(dones[t])
    returns, known = np.zeros_like(rewards), np.zeros_like(rewards)
    running, ends = np.zeros(n, dtype=np.float32), np.zeros(n, dtype=np.bool_)
    for t in reversed(range(steps)):
        ends |= dones[t]
        running = rewards[t] + np.float32(gamma) * np.where(dones[t], np.float32(0.0), running)
        returns[t], known[t] = running, ends
    return {key: np.stack([o[key] for o in seen]) for key in observation}, choices, returns, known
