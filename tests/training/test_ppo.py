"""PPO learns what stock MaskablePPO learns from the same decisions, for any number of threads."""

import copy
import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("torch")
pytest.importorskip("sb3_contrib")

import torch
from sb3_contrib import MaskablePPO
from stable_baselines3.common.buffers import RolloutBuffer
from tqdm import tqdm

from pacman_env.heuristics.simple import Nearest
from pacman_env.observations.robot_features import Observation
from pacman_env.policies.learned import LearnedPlanner
from pacman_env.policies.opponents import BehaviourOpponent, Opponents
from pacman_env.sb3 import PacManBotVecEnv
from pacman_env.training import ppo
from pacman_env.training.games import Games, make_ghost_parts, make_parts, start
from pacman_env.training.labels import imitate
from pacman_env.training.network import choose
from pacman_env.training.ppo import PPO, Rollout, advantages
from tests.training.planners import random_planner
from tests.training.stock import random_choices, stock_model
from tests.training.test_arguments import tiny

SMALL: dict[str, Any] = {"games": 6, "n_steps": 20, "batch_size": 50, "segment": 120, "n_epochs": 3, "levels": 4}
HYPER = tiny(width=16, **SMALL).hyper
NO_BAR = tqdm(disable=True)


def rollout_of(other: MaskablePPO, network: Any) -> Rollout:
    """The content of the other's buffer, as our learner has it."""
    buffer: Any = other.rollout_buffer
    rows = {key: torch.from_numpy(buffer.swap_and_flatten(array)) for key, array in buffer.observations.items()}
    flat = {
        name: torch.from_numpy(buffer.swap_and_flatten(getattr(buffer, name))[:, 0])
        for name in ("actions", "log_probs", "values", "advantages", "returns")
    }
    packed, order = network.pack(rows["planner_candidates"], rows["planner_globals"], rows["action_mask"] > 0.5)
    slots = (order == flat["actions"][:, None]).byte().argmax(dim=1)
    return Rollout(packed, slots, *(flat[name] for name in ("log_probs", "values", "advantages", "returns")))


@pytest.mark.parametrize("sizes", [{}, {"dropped_kinds": (1,), "dropped_features": (4,)}])
@pytest.mark.parametrize("threads", [1, 2])
def test_update_equals_update_of_stable_baselines3(
    sizes: dict[str, Any], threads: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """From the same rollout, with minibatches of the same rows and chunks that do not divide them."""
    monkeypatch.setattr(ppo, "_CHUNK", 17)
    hyper = dataclasses.replace(HYPER, learning_rate=(3e-3, 3e-3), ent_coef=(0.005, 0.005))
    env = PacManBotVecEnv(6, map="generated", settings={"num_levels": 4}, observation="planner")
    other = stock_model(env, hyper, **sizes)
    ours = PPO(hyper, 1, threads=threads, **sizes)
    ours.network.load_state_dict(other.policy.network.state_dict())
    _, callback = other._setup_learn(240, None)
    other.collect_rollouts(env, callback, other.rollout_buffer, HYPER.n_steps)
    rollout = rollout_of(other, ours.network)
    orders = [np.random.default_rng(k).permutation(HYPER.rollout) for k in range(HYPER.n_epochs)]
    for module, kind in ((np.random, np.asarray), (torch, torch.from_numpy)):
        left = iter(orders)
        name = "permutation" if module is np.random else "randperm"
        monkeypatch.setattr(module, name, lambda _, left=left, kind=kind, generator=None: kind(next(left)))
    before = copy.deepcopy(ours.network.state_dict())
    other.train()
    ours.decisions = HYPER.rollout
    numbers = ours.update(rollout)
    moved = 0.0
    for name, value in ours.network.state_dict().items():
        if name == "judge.bias":  # one number on all logits changes no choice: its gradient is rounding alone
            continue
        torch.testing.assert_close(value, other.policy.network.state_dict()[name], atol=1e-5, rtol=1e-5)
        moved = max(moved, float((value - before[name]).abs().max()))
    assert moved > 1e-2
    for name in ("train/value_loss", "train/policy_gradient_loss", "train/entropy_loss", "train/clip_fraction"):
        assert numbers[name] == pytest.approx(other.logger.name_to_value[name], abs=1e-5, rel=1e-3)
    explained = other.logger.name_to_value["train/explained_variance"]
    assert numbers["train/explained_variance"] == pytest.approx(explained, abs=1e-4)


@pytest.mark.parametrize("kind", ["planner", "clyde"])
def test_threads_do_not_change_a_bit(kind: str, tmp_path: Path) -> None:
    """Of a rollout after another one, and of the weights after the update."""
    found = []
    for threads in (1, 3):
        lineups = {"ghosts": ["wander,learned", "chase"], "league_every": 1, "teacher_nodes": 221}
        arguments = tiny(**{**SMALL, **lineups}, threads=threads)
        pool = Opponents([BehaviourOpponent("arcade"), LearnedPlanner(random_planner(tmp_path))], [1.0, 2.0])
        parts: Sequence[Games]
        parts = make_parts(arguments, 0, pool) if kind == "planner" else make_ghost_parts(arguments, 0, Nearest())
        model = PPO(HYPER, 5, threads=threads)
        start(parts, 3, model.pool)
        for number in range(2):
            rollout, _ = model.collect(parts, (3, number), NO_BAR)
        model.update(rollout)
        found.append([*rollout.situations, *rollout[1:], *model.network.state_dict().values()])
    assert all(torch.equal(one, other) for one, other in zip(*found, strict=True))


def test_rollout_stores_choices_probabilities_and_values_of_network() -> None:
    """Situations as the games had them, choices that may be made, their log-probabilities and the values."""
    model, parts = PPO(HYPER, 5), make_parts(tiny(**SMALL), 0)
    start(parts, 3, model.pool)
    rollout, _ = model.collect(parts, (3, 0), NO_BAR)
    logits, values = model.network(*rollout.situations.of(slice(None)))
    assert rollout.situations.mask.gather(1, rollout.slots[:, None]).all()
    assert len(rollout.slots) == HYPER.rollout
    expected = logits.log_softmax(dim=1).gather(1, rollout.slots[:, None])[:, 0]
    torch.testing.assert_close(rollout.log_probs, expected, atol=1e-5, rtol=1e-5)
    torch.testing.assert_close(rollout.values, values, atol=1e-5, rtol=1e-5)
    torch.testing.assert_close(rollout.returns, rollout.advantages + values, atol=1e-5, rtol=1e-5)


@pytest.mark.parametrize("imitation", [0, 64])
def test_value_decisions_change_values_only(imitation: int) -> None:
    """Also after an imitation, which moves all weights."""
    model, parts = PPO(HYPER, 5, value_decisions=HYPER.rollout), make_parts(tiny(**SMALL), 0)
    if imitation:
        imitate(model, parts, imitation, games_seed=0, seed=0)
    changed: list[set[str]] = []

    def compare(numbers: dict[str, float], decisions: int) -> None:
        state = model.network.state_dict()
        changed.append({name for name in state if not torch.equal(state[name], before[name])})

    before = copy.deepcopy(model.network.state_dict())
    model.learn(parts, 2 * HYPER.rollout, 0, NO_BAR, compare)
    critic = {f"critic.{layer}.{kind}" for layer in (0, 2) for kind in ("weight", "bias")}
    assert changed[0] == critic < changed[1]
    assert "encode.weight" in changed[1]


def test_diverged_network_is_refused() -> None:
    model, parts = PPO(HYPER, 5), make_parts(tiny(**SMALL), 0)
    torch.nn.init.constant_(model.network.judge.weight, torch.nan)
    with pytest.raises(FloatingPointError, match="the training has diverged"):
        model.learn(parts, HYPER.rollout, 0, NO_BAR)


@pytest.fixture(scope="module")
def met() -> Observation:
    """Observations of many games on their way."""
    rng, env = np.random.default_rng(0), make_parts(tiny(**SMALL), 0)[0]
    env.reset(0)
    seen = [env.observation]
    for _ in range(90):
        env.step(random_choices(seen[-1]["action_mask"], rng))
        seen.append(env.observation)
    return {key: np.concatenate([one[key] for one in seen]) for key in seen[0]}


def test_masked_choices_are_never_taken(met: Observation) -> None:
    """Neither drawn nor as the likeliest."""
    model = PPO(HYPER, 0)
    allowed = met["action_mask"] > 0.5
    narrow = allowed & (np.cumsum(allowed, axis=1) == 2)  # the second of each
    assert not allowed.all()
    generator = torch.Generator().manual_seed(0)
    for _ in range(20):
        for drawn_by in (generator, None):
            chosen = choose(model.network, met, drawn_by).actions
            assert allowed[np.arange(len(allowed)), chosen].all()
    chosen = choose(model.network, {**met, "action_mask": narrow}, generator).actions
    assert (chosen == narrow.argmax(axis=1)).all()


def test_choice_without_generator_has_highest_logit(met: Observation) -> None:
    model = PPO(HYPER, 0)
    seen = {key: torch.tensor(array) for key, array in met.items()}
    with torch.no_grad():
        logits, values = model.network(seen["planner_candidates"], seen["planner_globals"], seen["action_mask"] > 0.5)
    choices = choose(model.network, met)
    assert (choices.actions == logits.argmax(dim=1).numpy()).all()
    torch.testing.assert_close(choices.values, values)


def test_choices_are_drawn_with_probabilities_of_network() -> None:
    model = PPO(HYPER, 0)
    games = make_parts(tiny(**SMALL), 0)[0]
    games.reset(3)
    observation = {key: np.repeat(array[:1], 20000, axis=0) for key, array in games.observation.items()}
    model.network.judge.weight.data.mul_(100.0)
    choices = choose(model.network, observation, torch.Generator().manual_seed(0))
    with torch.no_grad():
        logits, _ = model.network(*choices.situations.of(slice(0, 1)))
    odds = np.zeros(observation["action_mask"].shape[1])
    order = choices.order[0, : logits.shape[1]].numpy()
    odds[order] = logits.softmax(dim=1)[0].numpy()
    assert 0.05 < odds.max() < 0.95
    np.testing.assert_allclose(np.bincount(choices.actions, minlength=len(odds)) / 20000, odds, atol=0.02)


def test_rollout_figures_are_logged() -> None:
    logged: dict[str, float] = {}
    model = PPO(HYPER, 0)
    endings = model.learn(
        make_parts(tiny(**SMALL), 0), 20 * HYPER.rollout, 0, NO_BAR, lambda numbers, _: logged.update(numbers)
    )
    outcomes = [ending.outcome for ending in endings]
    assert logged["rollout/completed"] == pytest.approx(outcomes.count("complete") / len(outcomes))
    assert logged["rollout/timed_out"] == pytest.approx(outcomes.count("timeout") / len(outcomes))
    assert logged["rollout/ep_rew_mean"] == pytest.approx(np.mean([ending.reward for ending in endings[-100:]]))
    assert 1 <= logged["rollout/ep_len_mean"] <= 20 * HYPER.n_steps
    assert {ending.level for ending in endings} <= {None, 0, 1, 2, 3}


def test_advantages_equal_advantages_of_stable_baselines3() -> None:
    rng = np.random.default_rng(0)
    space = PacManBotVecEnv(1, map="house").action_space
    rewards, values, dones = rng.normal(size=(9, 4)), rng.normal(size=(10, 4)), rng.random((9, 4)) < 0.3
    buffer = RolloutBuffer(9, space, space, gamma=0.9, gae_lambda=0.8, n_envs=4)
    buffer.rewards, buffer.values = rewards, values[:9]
    buffer.episode_starts = np.vstack([np.zeros((1, 4)), dones[:-1]])
    buffer.compute_returns_and_advantage(torch.from_numpy(values[9]), dones[8])
    found = advantages(*(torch.from_numpy(array * 1.0) for array in (rewards, values, dones)), 0.9, 0.8)
    np.testing.assert_allclose(found.numpy(), buffer.advantages, atol=1e-6)
