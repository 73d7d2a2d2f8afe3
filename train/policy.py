"""The entity network as a policy of sb3-contrib's MaskablePPO."""

from __future__ import annotations

from typing import Any

import torch
from gymnasium import spaces
from sb3_contrib.common.maskable.policies import MaskableActorCriticPolicy
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
from torch import nn

from pacman_env.policies.entity_network import EntityNetwork


class _Pass(BaseFeaturesExtractor):
    """The observation's arrays in one row: nothing is learned here."""

    def __init__(self, observation_space: spaces.Dict) -> None:
        candidates = observation_space["planner_candidates"].shape or (0, 0)
        whole = observation_space["planner_globals"].shape or (0,)
        super().__init__(observation_space, candidates[0] * candidates[1] + whole[0] + candidates[0])

    def forward(self, observations: dict[str, torch.Tensor]) -> torch.Tensor:
        return torch.cat(
            [
                observations["planner_candidates"].flatten(1),
                observations["planner_globals"],
                observations["action_mask"].float(),
            ],
            dim=1,
        )


class _Heads(nn.Module):
    """Where SB3 expects two separate trunks: here logits and value come from one network."""

    def __init__(self, candidates: int, candidate_features: int, global_features: int, width: int) -> None:
        super().__init__()
        self.shape = candidates, candidate_features, global_features
        self.network = EntityNetwork(candidate_features, global_features, width)
        self.latent_dim_pi, self.latent_dim_vf = candidates, 1

    def forward(self, row: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        count, features, whole = self.shape
        candidates = row[:, : count * features].reshape(-1, count, features)
        rest = row[:, count * features :]
        logits, value = self.network(candidates, rest[:, :whole], rest[:, whole:] > 0.5)
        return logits, value[:, None]

    def forward_actor(self, row: torch.Tensor) -> torch.Tensor:
        return self.forward(row)[0]

    def forward_critic(self, row: torch.Tensor) -> torch.Tensor:
        return self.forward(row)[1]


class EntityPolicy(MaskableActorCriticPolicy):
    """Candidates in another order give the same choice; what is masked changes nothing."""

    def __init__(self, *args: Any, width: int = 64, **kwargs: Any) -> None:
        self._width = width
        super().__init__(*args, features_extractor_class=_Pass, **kwargs)

    def _build_mlp_extractor(self) -> None:
        assert isinstance(self.observation_space, spaces.Dict)
        candidates = self.observation_space["planner_candidates"].shape or (0, 0)
        whole = self.observation_space["planner_globals"].shape or (0,)
        self.mlp_extractor = _Heads(candidates[0], candidates[1], whole[0], self._width)  # type: ignore[assignment]

    def _build(self, lr_schedule: Any) -> None:
        self.ortho_init = False  # the network has initialised itself
        super()._build(lr_schedule)
        self.action_net, self.value_net = nn.Identity(), nn.Identity()  # type: ignore[assignment]
        self.optimizer = self.optimizer_class(self.parameters(), lr=lr_schedule(1), **self.optimizer_kwargs)
