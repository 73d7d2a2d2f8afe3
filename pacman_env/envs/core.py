"""What the environments share: games with checked actions, the ghosts' policies, observations, rewards, infos."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pacman_env.game.execution import RUNNING

from ..config import Config, ConfigError
from ..sim.core.batch import GameBatch
from ..sim.core.parameters import drawn_values
from ..sim.maps.assets import MapSource
from ..sim.observation.observer import Observer
from ..sim.observation.robot_features import Observation
from ..sim.observation.situation import Situation
from . import outcome
from .arguments import Ghosts, make_settings, make_source


class Game:
    """N games of one environment, from its arguments; see :class:`~pacman_env.envs.pacmanbot.PacManBotEnv`."""

    def __init__(
        self,
        n: int,
        map: MapSource = "house",
        preset: str = "robot",
        execution: str = "robust",
        *,
        ghosts: Ghosts | None = None,
        observation: str | Sequence[str] | None = None,
        action: str | None = None,
        endless: bool | None = None,
        start_level: int | None = None,
        num_levels: int | None = None,
        settings: Mapping[str, Any] | None = None,
        config: Config | None = None,
        home: tuple[float, float, float] | None = None,
        seats: bool = False,
    ) -> None:
        """Raises ConfigError or MapError for arguments that cannot be played.

        ``seats``: ghosts with the behaviour ``policy`` are told by whoever steps the games.
        """
        self.config, self._policies = make_settings(
            preset,
            execution,
            ghosts=ghosts,
            observation=observation,
            action=action,
            endless=endless,
            settings=settings,
            config=config,
        )
        told = {k for k, behaviour in enumerate(self.config.clyde.ghosts) if behaviour == "policy"}
        self.seats = sorted(told - self._policies.keys())  # ghosts that nobody in here tells where to go
        if self.seats and not seats:
            raise ConfigError(f"clyde.ghosts[{self.seats[0]}] = 'policy': give the policy object in ghosts")
        source = make_source(map, self.config, home, start_level, num_levels)
        self.batch = GameBatch(source, self.config, n)
        self._observer = Observer(self.batch)
        self._situation: Situation | None = None

    @property
    def started(self) -> bool:
        """Whether a first round has begun."""
        return self._situation is not None

    @property
    def situation(self) -> Situation:
        """What the robot's policy sees now."""
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

        ``ghost_choices``: what each ghost is told by the number of his seat; the others' policies are asked.
        """
        batch = self.batch
        was_over = batch.games["end"] != RUNNING
        batch.step(actions, self._choices(ghost_choices or {}))
        self._situation = batch.situation()
        return outcome.reward_and_end(batch.games, was_over, self.config.reward)

    def ghost_reward(self) -> NDArray[np.float64]:
        """Of the tick that has just ended, for a ghost that plays for himself, (N,)."""
        never = np.zeros(self.batch.n, dtype=np.bool_)
        return outcome.reward_and_end(self.batch.games, never, self.config.ghost_reward)[0]

    def observe(self) -> Observation:
        """What the robot's agent sees now, one array (N, ...) per key."""
        return self._observer.observe(self.situation)

    def infos(self) -> dict[str, NDArray[Any]]:
        """Per game; see the environment."""
        batch, games = self.batch, self.batch.games
        result = outcome.infos(games)
        if len(batch.levels) > 1:
            result["level"] = batch.level_numbers()
        if self.config.endless:
            result["round"], result["score"] = games["round"].astype(np.int64), games["score"].astype(np.int64)
        return result | drawn_values(games, self.config)

    def _choices(self, told: Mapping[int, int]) -> NDArray[np.int64] | None:
        if not (self._policies or told):
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
        for number, choice in told.items():
            choices[:, number] = choice
        return choices
