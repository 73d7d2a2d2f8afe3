"""The learner learns what stock MaskablePPO learns from the same decisions, however it is shared out."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest

pytest.importorskip("torch")
pytest.importorskip("sb3_contrib")

import torch
from sb3_contrib import MaskablePPO
from stable_baselines3.common.buffers import RolloutBuffer
from stable_baselines3.common.logger import Logger

from pacman_env.training import learner
from pacman_env.training.games import TrainingGames, make_games
from pacman_env.training.learner import Choices, Learner, Rollout, advantages, new_model
from pacman_env.training.policy import EntityPolicy
from tests.training.test_arguments import tiny

HYPER = tiny(games=6, n_steps=20, batch_size=50, segment=120, n_epochs=3, levels=4, width=16).hyper


def games(threads: int = 1) -> TrainingGames:
    arguments = tiny(games=6, n_steps=20, batch_size=50, segment=120, levels=4)
    made = make_games(dataclasses.replace(arguments, threads=threads), 0)
    made.seed(3)
    return made


def stock(env: TrainingGames, **sizes: Any) -> MaskablePPO:
    same = {name: getattr(HYPER, name) for name in ("n_steps", "batch_size", "n_epochs", "gamma", "gae_lambda")}
    kwargs = {"width": HYPER.width, **sizes}
    made = MaskablePPO(EntityPolicy, env, 3e-3, ent_coef=0.005, policy_kwargs=kwargs, device="cpu", seed=0, **same)
    made.set_logger(Logger(None, []))
    return made


def same_rollout(ours: Learner, other: MaskablePPO) -> None:
    """Give our learner what the other's buffer holds, in that order."""
    buffer: Any = other.rollout_buffer
    rows = {key: torch.from_numpy(buffer.swap_and_flatten(array)) for key, array in buffer.observations.items()}
    flat = {
        name: torch.from_numpy(buffer.swap_and_flatten(getattr(buffer, name))[:, 0])
        for name in ("actions", "log_probs", "values", "advantages", "returns")
    }
    network = ours.policy.network
    packed, order = network.pack(rows["planner_candidates"], rows["planner_globals"], rows["action_mask"] > 0.5)
    slots = (order == flat["actions"][:, None]).byte().argmax(dim=1)
    choices = Choices(packed, order, slots, flat["log_probs"], flat["values"])
    ours.rollout_buffer = Rollout(choices, flat["advantages"], flat["returns"])


@pytest.mark.parametrize("sizes", [{}, {"dropped_kinds": (1,), "dropped_features": (4,)}])
@pytest.mark.parametrize("threads", [1, 2])
def test_an_update_is_that_of_stable_baselines(
    sizes: dict[str, Any], threads: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """From the same rollout, with minibatches of the same rows and pieces that do not divide them."""
    monkeypatch.setattr(learner, "_PIECE", 17)
    env = games()
    other = stock(env, **sizes)
    ours = new_model(HYPER, env, 1, **sizes)
    ours.lr_schedule, ours.ent_coef, ours.threads = other.lr_schedule, other.ent_coef, threads
    ours.policy.load_state_dict(other.policy.state_dict())
    ours.set_logger(Logger(None, []))
    _, callback = other._setup_learn(240, None)
    other.collect_rollouts(env, callback, other.rollout_buffer, HYPER.n_steps)
    same_rollout(ours, other)
    orders = [np.random.default_rng(k).permutation(HYPER.rollout) for k in range(HYPER.n_epochs)]
    for module, kind in ((np.random, np.asarray), (torch, torch.from_numpy)):
        left = iter(orders)
        name = "permutation" if module is np.random else "randperm"
        monkeypatch.setattr(module, name, lambda _, left=left, kind=kind: kind(next(left)))
    before = {name: value.clone() for name, value in ours.policy.state_dict().items()}
    other.train()
    ours.train()
    moved = 0.0
    for name, value in ours.policy.state_dict().items():
        if name == "network.judge.bias":  # one number on all logits changes no choice: its gradient is rounding alone
            continue
        torch.testing.assert_close(value, other.policy.state_dict()[name], atol=1e-5, rtol=1e-5)
        moved = max(moved, float((value - before[name]).abs().max()))
    assert moved > 1e-2
    for name in ("train/value_loss", "train/policy_gradient_loss", "train/entropy_loss", "train/clip_fraction"):
        assert ours.logger.name_to_value[name] == pytest.approx(other.logger.name_to_value[name], abs=1e-5, rel=1e-3)


def rollout(threads: int, seed: int = 5) -> tuple[Learner, Rollout]:
    env = games(threads)
    model = new_model(HYPER, env, seed)
    model.threads = threads
    model.set_logger(Logger(None, []))
    model.learn(HYPER.rollout)
    env.close()
    return model, model.rollout_buffer


@pytest.mark.parametrize("threads", [0, 2, 3])
def test_threads_do_not_change_a_bit(threads: int) -> None:
    (one, kept), (other, same) = rollout(1), rollout(threads)
    for a, b in zip(kept.choices.situations, same.choices.situations, strict=True):
        assert torch.equal(a, b)
    assert torch.equal(kept.returns, same.returns)
    for name, value in one.policy.state_dict().items():
        assert torch.equal(value, other.policy.state_dict()[name]), name


def test_what_is_kept_of_a_rollout_is_what_was_met() -> None:
    """Situations as the games had them, choices that may be made, their log-probabilities and the values."""
    model, (choices, gains, returns) = rollout(1)
    fresh = new_model(HYPER, games(), 5)  # before the update
    situations = choices.situations
    logits, values = fresh.policy.network.judge_packed(situations.of(slice(None)))
    assert (choices.slots < situations.counts).all()
    assert len(choices.slots) == HYPER.rollout == model.num_timesteps
    expected = logits.log_softmax(dim=1).gather(1, choices.slots[:, None])[:, 0]
    torch.testing.assert_close(choices.log_probs, expected, atol=1e-5, rtol=1e-5)
    torch.testing.assert_close(choices.values, values, atol=1e-5, rtol=1e-5)
    torch.testing.assert_close(returns, gains + values, atol=1e-5, rtol=1e-5)


def test_choices_are_drawn_as_often_as_the_network_says() -> None:
    env = games()
    model = new_model(HYPER, env, 0)
    observation = {key: np.repeat(array[:1], 20000, axis=0) for key, array in env.reset().items()}
    model.policy.network.judge.weight.data.mul_(100.0)
    choices, actions = model.choose(observation)
    with torch.no_grad():
        logits, _ = model.policy.network.judge_packed(choices.situations.of(slice(0, 1)))
    odds = np.zeros(observation["action_mask"].shape[1])
    order = choices.order[0, : logits.shape[1]].numpy()
    odds[order] = logits.softmax(dim=1)[0].numpy()
    assert 0.05 < odds.max() < 0.95
    np.testing.assert_allclose(np.bincount(actions, minlength=len(odds)) / 20000, odds, atol=0.02)


def test_advantages_are_those_of_stable_baselines() -> None:
    rng = np.random.default_rng(0)
    env = games()
    rewards, values, dones = rng.normal(size=(9, 4)), rng.normal(size=(10, 4)), rng.random((9, 4)) < 0.3
    buffer = RolloutBuffer(9, env.action_space, env.action_space, gamma=0.9, gae_lambda=0.8, n_envs=4)
    buffer.rewards, buffer.values = rewards, values[:9]
    buffer.episode_starts = np.vstack([np.zeros((1, 4)), dones[:-1]])
    buffer.compute_returns_and_advantage(torch.from_numpy(values[9]), dones[8])
    found = advantages(*(torch.from_numpy(array * 1.0) for array in (rewards, values, dones)), 0.9, 0.8)
    np.testing.assert_allclose(found.numpy(), buffer.advantages, atol=1e-6)
