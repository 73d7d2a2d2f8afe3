from pathlib import Path
from typing import Any

import pytest
import yaml
from gymnasium import spaces
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import VecFrameStack, VecNormalize

from pacman_env.training.baselines import Baseline, BaselineHyperparameters, Environment, load_baselines

DRIVING = {"flat": True, "action": "velocity", "settings": {"decisions.when": "tick", "observation.candidates": "all"}}


def test_baseline_defaults_equal_library_defaults() -> None:
    games = Baseline(environment=Environment(map="loop", flat=True)).make_games("loop", 2)
    ours = Baseline(learner="ppo").make_model(games, seed=0)
    stock = PPO("MlpPolicy", games, seed=0, device="cpu")
    names = ("n_steps", "batch_size", "n_epochs", "gamma", "gae_lambda", "ent_coef", "vf_coef", "max_grad_norm")
    assert [getattr(ours, name) for name in names] == [getattr(stock, name) for name in names]
    for name in ("lr_schedule", "clip_range"):
        assert getattr(ours, name)(0.3) == getattr(stock, name)(0.3)
    assert str(ours.policy) == str(stock.policy)


def test_baseline_stacks_frames_normalizes_and_sets_network() -> None:
    baseline = Baseline(
        environment=Environment(map="loop", observation=("features", "flat"), **DRIVING),  # type: ignore[arg-type]
        learner="ppo",
        frames=3,
        normalize=True,
        hyperparameters=BaselineHyperparameters(learning_rate=(0.002, 0.001), log_std_init=-0.5, net_arch=(32, 16)),
    )
    games = baseline.make_games("loop", 2)
    model = baseline.make_model(games, seed=0)
    wrapped = model.get_env()
    assert isinstance(wrapped, VecNormalize)
    assert isinstance(wrapped.venv, VecFrameStack)
    assert wrapped.observation_space.shape == (3 * games.observation_space.shape[0],)
    assert model.lr_schedule(0.5) == pytest.approx(0.0015)
    assert model.policy.log_std.tolist() == [-0.5, -0.5]
    assert [layer.out_features for layer in model.policy.mlp_extractor.policy_net[::2]] == [32, 16]


def test_baseline_does_not_normalize_images() -> None:
    given: dict[str, Any] = {"observation": ("features", "grid"), "settings": {"observation.normalize": False}}
    baseline = Baseline(environment=Environment(map="loop", flat=True, **given), normalize=True)
    wrapped = baseline.wrapped(baseline.make_games("loop", 1))
    assert isinstance(wrapped, VecNormalize)
    assert isinstance(wrapped.observation_space, spaces.Dict)
    assert set(wrapped.observation_space.spaces) - set(wrapped.norm_obs_keys or ()) == {"grid"}


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"learner": "dqn"}, r"learner = 'dqn': must be one of \('maskable_ppo', 'ppo'\)"),
        ({"steps": 3}, "Object contains unknown field `steps`"),
        ({"decisions": 0}, "decisions = 0: Expected `int` >= 1"),
        ({"games": "8"}, "games = '8': Expected `int`"),
        ({"normalize": 1}, "normalize = 1: Expected `bool`"),
        ({"hyperparameters": {"gama": 0.9}}, r"hyperparameters: Object contains unknown field `gama`"),
        ({"hyperparameters": {"gamma": 1.5}}, r"hyperparameters\.gamma = 1\.5: Expected `float` <= 1"),
        ({"hyperparameters": {"learning_rate": 1e-3}}, r"hyperparameters\.learning_rate = 0\.001: Expected `array`"),
        ({"hyperparameters": {"batch_size": 1}}, r"hyperparameters\.batch_size = 1: leaves a minibatch of 1"),
        ({"environment": {"observation": ["smell"]}}, "environment: observation = .*smell"),
        ({"environment": {"settings": {"clyde.colour": 1}}}, "environment: .*clyde.colour"),
        ({"environment": DRIVING}, "learner = 'maskable_ppo': must be ppo where actions are velocities"),
        (None, " = None: Expected `object`"),
    ],
)
def test_wrong_field_is_named_with_file_and_section(values: Any, message: str, tmp_path: Path) -> None:
    path = tmp_path / "some.yaml"
    path.write_text(yaml.safe_dump({"mine": values}))
    with pytest.raises(ValueError, match=rf"some\.yaml: mine.*{message}"):
        load_baselines(path)


@pytest.mark.parametrize("content", ["", "[1]"])
def test_file_without_baselines_is_refused(content: str, tmp_path: Path) -> None:
    path = tmp_path / "bad.yaml"
    path.write_text(content)
    with pytest.raises(ValueError, match=r"bad\.yaml: must have baselines by name"):
        load_baselines(path)
