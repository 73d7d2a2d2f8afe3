"""The entity network under sb3-contrib's MaskablePPO, as earlier versions trained it: the reference for ours."""

from typing import Any

import numpy as np
import torch
from gymnasium import spaces
from numpy.typing import NDArray
from sb3_contrib import MaskablePPO
from sb3_contrib.common.maskable.distributions import MaskableDistribution
from sb3_contrib.common.maskable.policies import MaskableActorCriticPolicy
from stable_baselines3.common.logger import Logger
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
from torch import nn

from pacman_env.sb3 import PacManBotVecEnv
from pacman_env.training.arguments import Hyperparameters
from pacman_env.training.network import EntityNetwork

Masks = NDArray[Any] | torch.Tensor | None


class _Unchanged(BaseFeaturesExtractor):
    def __init__(self, observation_space: spaces.Space) -> None:
        super().__init__(observation_space, 1)

    def forward(self, observations: dict[str, torch.Tensor]) -> dict[str, torch.Tensor]:
        return observations


class StockPolicy(MaskableActorCriticPolicy):
    """``EntityNetwork`` as Stable-Baselines3 asks for it."""

    network: EntityNetwork

    def __init__(self, *args: Any, width: int = 64, dropped_kinds: Any = (), **kwargs: Any) -> None:
        self._sizes = {"width": width, "dropped_kinds": dropped_kinds}
        self._sizes["dropped_features"] = kwargs.pop("dropped_features", ())
        super().__init__(*args, **{**kwargs, "features_extractor_class": _Unchanged})

    def _build(self, lr_schedule: Any) -> None:
        space: Any = self.observation_space
        features, whole = space["planner_candidates"].shape[1], space["planner_globals"].shape[0]
        self.network = EntityNetwork(features, whole, **self._sizes)
        self.mlp_extractor = self.action_net = self.value_net = nn.Identity()
        self.optimizer = self.optimizer_class(self.network.parameters(), lr=lr_schedule(1), **self.optimizer_kwargs)

    def _evaluate(self, seen: Any, masks: Masks) -> tuple[MaskableDistribution, torch.Tensor]:
        allowed = seen["action_mask"] > 0.5
        if masks is not None:
            allowed = torch.as_tensor(masks, dtype=torch.bool).reshape(allowed.shape)
        logits, values = self.network(seen["planner_candidates"], seen["planner_globals"], allowed)
        distribution = self.action_dist.proba_distribution(action_logits=logits)
        distribution.apply_masking(allowed)
        return distribution, values[:, None]

    def forward(self, obs: Any, deterministic: bool = False, action_masks: Masks = None) -> Any:
        distribution, values = self._evaluate(obs, action_masks)
        actions = distribution.get_actions(deterministic=deterministic)
        return actions, values, distribution.log_prob(actions)

    def evaluate_actions(self, obs: Any, actions: torch.Tensor, action_masks: Masks = None) -> Any:
        distribution, values = self._evaluate(obs, action_masks)
        return values, distribution.log_prob(actions), distribution.entropy()

    def predict_values(self, obs: Any) -> torch.Tensor:
        return self._evaluate(obs, None)[1]


def stock_model(env: PacManBotVecEnv, hyper: Hyperparameters, **sizes: Any) -> MaskablePPO:
    same = {name: getattr(hyper, name) for name in ("n_steps", "batch_size", "n_epochs", "gamma", "gae_lambda")}
    kwargs = {"width": hyper.width, **sizes}
    ends = {"learning_rate": hyper.learning_rate[1], "ent_coef": hyper.ent_coef[1]}
    made = MaskablePPO(StockPolicy, env, policy_kwargs=kwargs, device="cpu", seed=0, **ends, **same)
    made.set_logger(Logger(None, []))
    return made


def random_choices(masks: NDArray[Any], rng: np.random.Generator) -> NDArray[np.int64]:
    """One that is allowed for each game."""
    return (rng.random(masks.shape) * (masks > 0.5)).argmax(axis=1)
