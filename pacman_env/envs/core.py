"""The common core of the environments: checked actions, the ghosts' policies, observations, rewards, infos."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from ..config import Config, ConfigError
from ..game.execution import RUNNING
from ..sim.core.batch import GameBatch
from ..sim.core.parameters import drawn_values
from ..sim.observation.kinds import Observer
from ..sim.observation.robot_features import Observation
from ..sim.observation.situation import Situation
from . import outcome
from .arguments import EnvArguments, check_render_mode


class EnvCore:
    """N games of one environment, from its arguments."""

    def __init__(self, n: int, arguments: EnvArguments, *, ghost_agents: bool = False) -> None:
        """Raises ConfigError or MapError for arguments that cannot be played.

        ``ghost_agents``: whoever steps the games chooses for ghosts whose behaviour is ``policy``.
        """
        self.config, self._policies = arguments.make_config()
        behaviours = enumerate(self.config.clyde.ghosts)
        self.ghost_agents = [k for k, name in behaviours if name == "policy" and k not in self._policies]
        if self.ghost_agents and not ghost_agents:
            raise ConfigError(f"clyde.ghosts[{self.ghost_agents[0]}] = 'policy': give the policy object in ghosts")
        self.batch = GameBatch(arguments.make_source(self.config), self.config, n)
        self._observer = Observer(self.batch)
        self.parts = self._observer.parts
        self._situation: Situation | None = None
        self._draws = bool(self.config.randomize.ranges())  # asked at every step otherwise

    @property
    def started(self) -> bool:
        """Whether a first round has begun."""
        return self._situation is not None

    def require_reset(self) -> None:
        """Raise ResetNeeded before the first reset."""
        if self._situation is None:
            raise gym.error.ResetNeeded("call reset() first")

    @property
    def situation(self) -> Situation:
        """The robot's policy sees this now; there is none before the first reset."""
        self.require_reset()
        assert self._situation is not None
        return self._situation

    def reset(self, index: NDArray[np.int64], seeds: NDArray[np.uint64]) -> None:
        """New episodes in the games ``index``."""
        self.batch.reset(index, seeds)
        if self._policies:
            mask = np.zeros(self.batch.n, dtype=np.bool_)
            mask[index] = True
            for policy in self._policies.values():
                policy.reset(mask)
        self._situation = self.batch.situation()

    def step(
        self, actions: NDArray[Any], ghost_choices: Mapping[int, int] | None = None
    ) -> tuple[NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_]]:
        """One decision: reward (N,), terminated (N,), truncated (N,); games that were over get no reward.

        ``ghost_choices``: those of ``ghost_agents`` by the ghost's number; the policies of the others are asked.

        Raises:
            ResetNeeded: before the first reset.
        """
        self.require_reset()
        batch = self.batch
        was_over = batch.games["end"] != RUNNING
        batch.step(actions, self._ghost_choices(ghost_choices or {}))
        self._situation = batch.situation()
        return outcome.reward_and_end(batch.games, was_over, self.config.reward)

    def ghost_reward(self) -> NDArray[np.float64]:
        """Of the tick that has just ended, for a ghost that plays for himself, (N,)."""
        never = np.zeros(self.batch.n, dtype=np.bool_)
        return outcome.reward_and_end(self.batch.games, never, self.config.ghost_reward)[0]

    def observe(self) -> Observation:
        """The robot's agent sees this now: one array (N, ...) per key."""
        return self._observer.observe(self.situation)

    def infos(self) -> dict[str, NDArray[Any]]:
        """Per game; see the environment."""
        batch, games = self.batch, self.batch.games
        result = outcome.infos(games)
        if len(batch.levels) > 1:
            result["level"] = batch.level_numbers()
        if self.config.endless:
            result["round"], result["score"] = games["round"].astype(np.int64), games["score"].astype(np.int64)
        return result | drawn_values(games, self.config) if self._draws else result

    def _ghost_choices(self, given: Mapping[int, int]) -> NDArray[np.int64] | None:
        if not (self._policies or given):
            return None
        choices = np.full(self.batch.ghosts.shape, self.batch.hold, dtype=np.int64)
        for number, policy in self._policies.items():
            chosen = np.asarray(policy.select(self.batch.situation(number)))
            if chosen.shape != (self.batch.n,) or chosen.dtype.kind not in "iu":
                raise ValueError(
                    f"ghosts[{number}]: select must return {self.batch.n} integers, got {chosen.dtype} of shape"
                    f" {chosen.shape}"
                )
            choices[:, number] = chosen
        for number, choice in given.items():
            choices[:, number] = choice
        return choices


class CoreEnv:
    """An environment over an :class:`EnvCore`, whatever its interface."""

    metadata: dict[str, Any]
    render_mode: str | None

    def _make_core(self, n: int, arguments: EnvArguments, **more: Any) -> None:
        check_render_mode(arguments.render_mode, self.metadata["render_modes"])
        self._core = EnvCore(n, arguments, **more)
        self.batch: GameBatch = self._core.batch
        self.config: Config = self._core.config
        self.render_mode = arguments.render_mode

    @property
    def situation(self) -> Situation:
        """A policy of this package sees this now: one situation per game.

        Raises:
            ResetNeeded: before the first reset.
        """
        return self._core.situation

    @property
    def action_masks(self) -> Callable[[], NDArray[np.bool_]]:
        """``action_masks()``: which candidates may be chosen now, the name that sb3-contrib looks for.

        (C,) bool, of a vector environment (N, C).

        Raises:
            AttributeError: velocities have no mask.
        """
        if self.config.action != "goal":
            raise AttributeError("velocity actions have no masks")
        return self._masks

    def _masks(self) -> NDArray[np.bool_]:
        return self.situation.mask.copy()
