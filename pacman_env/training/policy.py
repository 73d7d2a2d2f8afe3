"""The entity network as a policy of sb3-contrib's MaskablePPO.

Stable-Baselines3 expects a features extractor, two trunks and two heads; here one network gives logits and values at
once, so the methods that would chain those parts are replaced.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from gymnasium import spaces
from numpy.typing import NDArray
from sb3_contrib.common.maskable.distributions import MaskableDistribution
from sb3_contrib.common.maskable.policies import MaskableActorCriticPolicy
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
from torch import nn

from pacman_env.training.network import EntityNetwork

Tensors = dict[str, torch.Tensor]
Masks = NDArray[Any] | torch.Tensor | None


class _Nothing(BaseFeaturesExtractor):
    """The network reads the observation as it is."""

    def __init__(self, observation_space: spaces.Space) -> None:
        super().__init__(observation_space, 1)

    def forward(self, observations: Tensors) -> Tensors:
        return observations


class EntityPolicy(MaskableActorCriticPolicy):
    """Candidates in another order give the same choice; what is masked changes nothing.

    The observation needs ``planner_candidates``, ``planner_globals`` and ``action_mask`` (``observation="planner"``).
    """

    network: EntityNetwork

    def __init__(
        self,
        *args: Any,
        width: int = 64,
        dropped_features: tuple[int, ...] = (),
        dropped_kinds: tuple[int, ...] = (),
        **kwargs: Any,
    ) -> None:
        self._sizes = {"width": width, "dropped_features": dropped_features, "dropped_kinds": dropped_kinds}
        super().__init__(*args, **{**kwargs, "features_extractor_class": _Nothing})

    def _build(self, lr_schedule: Any) -> None:
        space = self.observation_space
        if not isinstance(space, spaces.Dict) or not {"planner_candidates", "action_mask"} <= set(space.spaces):
            raise ValueError("EntityPolicy needs observation='planner' and goals as actions")
        features, whole = space["planner_candidates"].shape, space["planner_globals"].shape
        assert features is not None
        assert whole is not None
        self.network = EntityNetwork(features[1], whole[0], **self._sizes)  # type: ignore[arg-type]
        self.mlp_extractor = self.action_net = self.value_net = nn.Identity()
        self.optimizer = self.optimizer_class(self.network.parameters(), lr=lr_schedule(1), **self.optimizer_kwargs)

    def _get_constructor_parameters(self) -> dict[str, Any]:
        return super()._get_constructor_parameters() | self._sizes

    def _evaluate(self, observation: Any, masks: Masks) -> tuple[MaskableDistribution, torch.Tensor]:
        """Distribution over candidates, and values (B,).

        Raises:
            FloatingPointError: the network gives no numbers any more.
        """
        allowed = observation["action_mask"] > 0.5
        if masks is not None:
            allowed = torch.as_tensor(masks, dtype=torch.bool).reshape(allowed.shape)
        logits, values = self.network.packed(observation["planner_candidates"], observation["planner_globals"], allowed)
        try:
            distribution = self.action_dist.proba_distribution(action_logits=logits)
        except ValueError:
            raise FloatingPointError("the training has diverged: logits are no numbers any more") from None
        distribution.apply_masking(allowed)
        return distribution, values

    def forward(
        self, obs: Any, deterministic: bool = False, action_masks: Masks = None
    ) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        """Choices (B,), values (B, 1) and log-probabilities (B,)."""
        distribution, values = self._evaluate(obs, action_masks)
        actions = distribution.get_actions(deterministic=deterministic)
        return actions, values[:, None], distribution.log_prob(actions)

    def evaluate_actions(
        self, obs: Any, actions: torch.Tensor, action_masks: Masks = None
    ) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor | None]:
        """Values (B, 1), log-probabilities (B,) and entropies (B,)."""
        distribution, values = self._evaluate(obs, action_masks)
        return values[:, None], distribution.log_prob(actions), distribution.entropy()

    def get_distribution(self, obs: Any, action_masks: NDArray[np.bool_] | None = None) -> MaskableDistribution:
        """Over the candidates of each situation."""
        return self._evaluate(obs, action_masks)[0]

    def predict_values(self, obs: Any) -> torch.Tensor:
        """Values (B, 1)."""
        return self._evaluate(obs, None)[1][:, None]
