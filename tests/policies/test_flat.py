"""A model of Stable-Baselines3 as a policy: it sees and chooses what it did in its environment, and when."""

import functools
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("onnx")
pytest.importorskip("sb3_contrib")

import stable_baselines3
from sb3_contrib import MaskablePPO, RecurrentPPO
from stable_baselines3.common.vec_env import VecEnv, VecFrameStack, VecNormalize

from pacman_env.envs.arguments import EnvArguments
from pacman_env.episodes.rollout import episode_seeds, play
from pacman_env.policies.base import Policy
from pacman_env.policies.registry import make_policy
from pacman_env.sb3 import PacManBotVecEnv, export
from tests.envs.helpers import QUICK, joined, make_vector
from tests.policies.contract import PolicyContract

SMALL = {"seed": 0, "device": "cpu", "policy_kwargs": {"net_arch": [16]}}
FLAT = {"flat": True, "settings": {**QUICK, "time_limit_s": 40.0}}


def model_of(kind: Any, games: VecEnv, policy: str = "MlpPolicy", **arguments: Any) -> Any:
    """A model that has hardly learned, but whose choices differ."""
    steps = {"learning_starts": 8} if kind is stable_baselines3.DQN else {"n_steps": 16, "learning_rate": 0.01}
    return kind(policy, games, **SMALL, **steps, **arguments).learn(64)


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("flat") / "mine.onnx"
    export(model_of(MaskablePPO, PacManBotVecEnv(2, **FLAT)), path)
    return path


class TestFlatPolicy(PolicyContract):
    @pytest.fixture(autouse=True)
    def _path(self, path: Path) -> None:
        self.path = path

    def make(self) -> Policy:
        return make_policy(str(self.path))


def scores_of(model: Any, observation: Any) -> Any:
    """What a model without masks maximises, as numbers (N, A)."""
    if hasattr(model.policy, "q_net"):
        return model.policy.q_net(observation)
    return model.policy.get_distribution(observation).distribution.logits


@pytest.mark.parametrize(
    ("kind", "normalized", "arguments"),
    [
        (MaskablePPO, False, {}),
        (MaskablePPO, True, {"preset": "arcade"}),
        (MaskablePPO, False, {"observation": ("features", "flat"), "settings": {"observation.mask": "observation"}}),
        (stable_baselines3.PPO, True, {"ghosts": ("arcade", "chase"), "settings": {"observation.nearest_pellets": 6}}),
        (stable_baselines3.DQN, False, {"settings": {"decisions.when": "tick"}}),
    ],
)
def test_policy_plays_same_rounds_as_model(kind: Any, normalized: bool, arguments: Any, tmp_path: Path) -> None:
    """The environment plays with events and masks, the policy is asked at each tick."""
    arguments = joined(FLAT, arguments)
    games: Any = PacManBotVecEnv(4, **arguments)
    games = VecNormalize(games) if normalized else games
    model = model_of(kind, games)
    export(model, tmp_path / "model.onnx")
    seeds = episode_seeds(5, 40)
    env = make_vector(len(seeds), autoreset_mode="Disabled", **arguments)
    observation, info = env.reset(options={"round_seed": seeds.tolist()})
    decisions = 0
    while (running := info["outcome"] == 0).any():
        seen, masks = games.normalize_obs(observation) if normalized else observation, env.action_masks()
        if kind is MaskablePPO:
            actions = model.predict(seen, deterministic=True, action_masks=masks)[0]
        else:
            scores = scores_of(model, model.policy.obs_to_tensor(seen)[0]).detach().numpy()
            actions = np.where(masks, scores, -np.inf).argmax(axis=1)
        observation, *_, info = env.step(actions)
        decisions += running.sum()
    config = env.config.with_fields(**{"decisions.when": "tick", "observation.flat": False})
    records, _ = play(EnvArguments().make_source(config), config, str(tmp_path / "model.onnx"), seeds)
    assert decisions > 200
    assert records["collected"].tolist() == info["collected"].tolist()
    np.testing.assert_allclose(records["time_s"], env.batch.games["step"] * config.physics_step_s)


BESIDE = {"flat": True, "settings": {"observation.mask": "beside"}}
REFUSED: dict[str, Any] = {
    "observation.flat": (MaskablePPO, "MultiInputPolicy", {}, None),
    "observation_space": (MaskablePPO, "MultiInputPolicy", BESIDE, None),
    "action": (stable_baselines3.PPO, "MlpPolicy", {"action": "velocity", "observation": ("features", "flat")}, None),
    "policy": (RecurrentPPO, "MlpLstmPolicy", {"flat": True}, None),
    "env": (MaskablePPO, "MlpPolicy", {"flat": True}, functools.partial(VecFrameStack, n_stack=2)),
    "observation.kinds": (MaskablePPO, "MlpPolicy", {"flat": True, "observation": ("scan", "flat")}, None),
}


@pytest.mark.parametrize("field", REFUSED)
def test_model_that_reads_anything_else_is_refused(field: str, tmp_path: Path) -> None:
    kind, policy, arguments, wrap = REFUSED[field]
    games: Any = PacManBotVecEnv(1, **arguments)
    model = kind(policy, wrap(games) if wrap else games, n_steps=16, batch_size=16, device="cpu")
    with pytest.raises(ValueError, match=rf"{field} = "):
        export(model, tmp_path / "model.onnx")
    assert not list(tmp_path.iterdir())
