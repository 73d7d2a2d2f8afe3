"""The entity network under Stable-Baselines3: it trains, keeps to the mask, saves and loads."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("torch")
pytest.importorskip("sb3_contrib")

import torch
from sb3_contrib import MaskablePPO

from pacman_env.sb3 import Observation, PacManBotVecEnv
from pacman_env.training.games import TrainingGames, make_games
from pacman_env.training.policy import EntityPolicy
from tests.training.test_arguments import tiny


def make_model(games: TrainingGames, **kwargs: object) -> MaskablePPO:
    kwargs = {"width": 8, **kwargs}
    return MaskablePPO(EntityPolicy, games, n_steps=8, batch_size=16, policy_kwargs=kwargs, seed=0, device="cpu")


@pytest.fixture(scope="module")
def games() -> TrainingGames:
    games = make_games(tiny(), 0)
    games.seed(0)
    return games


@pytest.fixture(scope="module")
def met(games: TrainingGames) -> Observation:
    """Observations of many games on their way."""
    rng = np.random.default_rng(0)
    seen = [games.reset()]
    for _ in range(30):
        seen.append(games.step(rng.integers(games.action_space.n, size=4))[0])  # type: ignore[attr-defined,arg-type]
    return {key: np.concatenate([o[key] for o in seen]) for key in seen[0]}


def tensors(observation: Observation) -> dict[str, torch.Tensor]:
    return {key: torch.tensor(array) for key, array in observation.items()}


def test_one_update_changes_all_weights_and_nothing_that_is_no_weight(games: TrainingGames) -> None:
    model = make_model(games, dropped_features=(4,))
    before = {name: value.clone() for name, value in model.policy.state_dict().items()}
    model.learn(32)
    for name, value in model.policy.state_dict().items():
        assert torch.isfinite(value).all(), name
        assert torch.equal(value, before[name]) == name.endswith("shown"), name


def test_masked_choices_are_never_taken(met: Observation, games: TrainingGames) -> None:
    """Neither at random nor deliberately, whether the mask comes with the call or with the observation."""
    model = make_model(games)
    allowed = met["action_mask"] > 0.5
    rows = np.arange(len(allowed))
    assert not allowed.all()
    for _ in range(20):
        for deterministic in (False, True):
            for masks in (allowed, None):
                choices, _ = model.predict(met, action_masks=masks, deterministic=deterministic)
                assert allowed[rows, choices].all()
    narrow = allowed & (np.cumsum(allowed, axis=1) == 2)  # the second of each, as the call says
    choices, _ = model.predict(met, action_masks=narrow)
    assert (choices == narrow.argmax(axis=1)).all()


def test_what_is_chosen_deliberately_has_the_highest_logit(met: Observation, games: TrainingGames) -> None:
    model = make_model(games)
    obs = tensors(met)
    with torch.no_grad():
        logits, values = model.policy.network(
            obs["planner_candidates"], obs["planner_globals"], obs["action_mask"] > 0.5
        )
        found = model.policy.predict_values(obs)[:, 0]
    choices, _ = model.predict(met, deterministic=True)
    assert (choices == logits.argmax(dim=1).numpy()).all()
    torch.testing.assert_close(found, values)


def test_forward_and_evaluate_actions_agree(met: Observation, games: TrainingGames) -> None:
    policy, obs = make_model(games).policy, tensors(met)
    with torch.no_grad():
        actions, values, log_prob = policy(obs)
        again, same, entropy = policy.evaluate_actions(obs, actions, action_masks=met["action_mask"])
    torch.testing.assert_close(values, again)
    torch.testing.assert_close(log_prob, same)
    assert values.shape == (len(actions), 1)
    counts = torch.tensor(met["action_mask"]).sum(dim=1)
    assert (entropy <= torch.log(counts) + 1e-5).all()
    assert (entropy[counts > 1] > 0).all()


def test_it_saves_and_loads_with_stable_baselines(met: Observation, games: TrainingGames, tmp_path: Path) -> None:
    model = make_model(games, dropped_kinds=(1,), dropped_features=(4, 5))
    model.learn(32)
    model.save(tmp_path / "run.zip")
    loaded = MaskablePPO.load(tmp_path / "run.zip", env=games, device="cpu")
    assert loaded.policy.network.dropped_kinds == (1,)
    assert all(torch.equal(v, loaded.policy.state_dict()[k]) for k, v in model.policy.state_dict().items())
    one, other = (m.predict(met, deterministic=True)[0] for m in (model, loaded))
    assert (one == other).all()
    loaded.learn(32)
    assert not torch.equal(loaded.policy.network.judge.weight, model.policy.network.judge.weight)


@pytest.mark.parametrize("observation", [None, "grid"])
def test_other_observations_are_refused_by_name(observation: str | None) -> None:
    env = PacManBotVecEnv(2, map="house", observation=observation)
    with pytest.raises(ValueError, match="EntityPolicy needs observation='planner' and goals as actions"):
        MaskablePPO(EntityPolicy, env, n_steps=4, batch_size=8, device="cpu")


def test_a_network_that_has_diverged_says_so(met: Observation, games: TrainingGames) -> None:
    model = make_model(games)
    with torch.no_grad():
        model.policy.network.judge.weight.fill_(torch.nan)
    with pytest.raises(FloatingPointError, match="the training has diverged"):
        model.predict(met)
