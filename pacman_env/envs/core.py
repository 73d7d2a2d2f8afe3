"""The common core of the environments: checked actions, the ghosts' policies, observations, rewards, infos."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from ..config import Config, ConfigError
from ..game.execution import RUNNING
from ..sim.core import compile_ahead
from ..sim.core.batch import GameBatch
from ..sim.core.parameters import drawn_values
from ..sim.observation.kinds import FLAT, MASK, Observer
from ..sim.observation.nearest import MISSING
from ..sim.observation.situation import Situation
from . import outcome
from .arguments import EnvArguments, check_render_mode
from .spaces import OBSERVATION, action_space, observation_space, velocities

#: By the ghost's number: of all games (N,), or one for all of them.
GhostChoices = Mapping[int, NDArray[np.int64] | int]
_NOBODY = np.zeros(0, dtype=np.bool_)


class EnvCore:
    """N games of one environment, from its arguments."""

    def __init__(
        self,
        n: int,
        arguments: EnvArguments,
        *,
        ghost_agents: bool = False,
        num_threads: int = 1,
        copy: bool = True,
        settings: Mapping[str, Any] | None = None,
    ) -> None:
        """Raises ConfigError or MapError for arguments that cannot be played.

        Args:
            n: games.
            arguments: of the environment.
            num_threads: see :class:`~pacman_env.engine.threads.Threads`.
            copy: situations and features are new arrays at each step; False: two sets of arrays take turns.
            ghost_agents: whoever steps the games chooses for ghosts whose behaviour is ``policy``.
            settings: fields of the configuration, in place of those of the arguments.
        """
        compile_ahead.begin()
        self.config, self._policies = arguments.make_config()
        self.settings = dict(settings or {})
        self.config = self.config.with_fields(**self.settings)
        behaviours = enumerate(self.config.clyde.ghosts)
        self.ghost_agents = [k for k, name in behaviours if name == "policy" and k not in self._policies]
        if self.ghost_agents and not ghost_agents:
            raise ConfigError(f"clyde.ghosts[{self.ghost_agents[0]}] = 'policy': give the policy object in ghosts")
        self.batch = GameBatch(arguments.make_source(self.config), self.config, n, num_threads)
        self._observer = Observer(self.batch)
        self.parts = self._observer.parts
        self.candidates = self.batch.candidates if self._observer.nearest is None else self._observer.nearest.count
        self._numeric = arguments.numeric_info
        self._timeout_terminates = arguments.timeout_ends()
        self._mask_in_info = self.config.observation.mask == "info"
        self._mask_beside = self.config.observation.mask == "beside"
        if (self._mask_beside or self._mask_in_info) and self.config.action != "goal":
            raise ConfigError(f"observation.mask = {self.config.observation.mask!r}: velocities have no mask")
        self._situation: Situation | None = None
        self._copies = copy
        self._reused: list[Situation | None] = [None, None]
        self._listed: NDArray[np.int64] | None = None  # candidates by the number that an action has; None: their own
        self.elapsed_s = np.zeros(n)  # simulated, in the last step
        self._path_counts = bool(self.config.reward.progress or self.config.ghost_reward.progress)
        self._path_left = np.zeros(n)  # m, left to the nearest pellet; 0 where it does not count
        self._nearer = np.zeros(n)  # m, in the last step
        self._asks_who_was_over = self._path_counts or bool(self.ghost_agents)
        self._was_over = _NOBODY  # (N,) before the last step, where somebody asks
        several = len(self.batch.levels) > 1 or self.config.endless or self.config.decisions.when == "event"
        self._draws = bool(self.config.randomize.ranges())  # asked at every step otherwise
        self._more_infos = several or self._draws or self._mask_in_info

    @property
    def started(self) -> bool:
        """Whether a first round has begun."""
        return self._situation is not None

    def require_reset(self) -> None:
        """Raise ResetNeeded before the first reset."""
        if self._situation is None:
            raise gym.error.ResetNeeded("call reset() first")

    def require_running(self) -> None:
        """Raise ResetNeeded before the first reset, and where every episode is over."""
        self.require_reset()
        ends = self.batch.games["end"]
        if ends[0] != RUNNING and (ends != RUNNING).all():
            raise gym.error.ResetNeeded("the episode is over: call reset()")

    @property
    def situation(self) -> Situation:
        """The robot's policy sees this now; there is none before the first reset."""
        self.require_reset()
        assert self._situation is not None
        return self._situation

    def observation_space(self) -> spaces.Dict | spaces.Box:
        """Of one game."""
        return observation_space(self.parts, self.candidates if self._mask_beside else None)

    def ghost_observation_space(self) -> spaces.Dict | spaces.Box:
        """Of a ghost's agent."""
        return observation_space(self._ghost_observer.parts, self.batch.candidates if self._mask_beside else None)

    def action_space(self) -> spaces.Discrete | spaces.Box:
        """Of one game."""
        return action_space(self.batch, self.candidates)

    def reset(
        self,
        index: NDArray[np.int64],
        seeds: NDArray[np.uint64],
        levels: NDArray[np.int64] | None = None,
        *,
        in_step: bool = False,
    ) -> None:
        """New episodes in the games ``index``; ``in_step``: nobody has seen yet what came of the last step."""
        self.elapsed_s[index] = 0.0
        self.batch.reset(index, seeds, levels)
        if self._policies:
            mask = np.zeros(self.batch.n, dtype=np.bool_)
            mask[index] = True
            for policy in self._policies.values():
                policy.reset(mask)
        self._update_situation(index if in_step else None)

    @functools.cached_property
    def _ghost_observer(self) -> Observer:
        """Of ghosts that are agents: the features, laid out as the robot's observation."""
        config = replace(self.config.observation, kinds=("features",), candidates="all")
        return Observer(self.batch, config, ghost=True)

    def _update_situation(self, index: NDArray[np.int64] | None = None) -> None:
        """Situations of all games, or again of some whose last situation nobody has seen."""
        if index is not None:
            self._situation = self.batch.situation(again=self._situation, index=index)
        else:
            self._reused.reverse()
            self._situation = self._reused[0] = self.batch.situation(again=self._reused[0])
            if self._copies:
                self._reused[0] = None
        self._listed = self._observer.listed(self._situation)
        if self._path_counts:
            self._path_left = outcome.path_left(self.batch.alive, self._situation)

    def masks(self) -> NDArray[np.bool_]:
        """(N, C) which actions are allowed now."""
        return self.situation.mask.copy() if self._listed is None else self._listed != MISSING

    def actions_of(self, candidates: NDArray[np.int64]) -> NDArray[np.int64]:
        """(N,) the actions that stand for candidates (N,)."""
        self.require_reset()
        if self._listed is None:
            return candidates
        there = self._listed == candidates[:, None]
        return np.where(there.any(axis=1), there.argmax(axis=1), self.candidates - 1)

    def _chosen(self, actions: NDArray[Any]) -> tuple[NDArray[Any], NDArray[np.bool_]]:
        """The candidates that the actions stand for, hold where they are forbidden, and where that is."""
        if self._listed is None:
            there = (actions >= 0) & (actions < self.batch.candidates)  # others are refused by the batch
            rows = np.arange(self.batch.n)
            return actions, there & ~self.situation.mask[rows, np.where(there, actions, 0)]
        bad = np.flatnonzero((actions < 0) | (actions >= self.candidates))
        if len(bad):
            raise ValueError(f"choice {actions[bad[0]]} of game {bad[0]}: candidates are 0 to {self.candidates - 1}")
        chosen = np.take_along_axis(self._listed, actions[:, None], axis=1)[:, 0]
        forbidden = chosen == MISSING
        return np.where(forbidden, self.batch.hold, chosen), forbidden

    def step(
        self,
        actions: NDArray[Any],
        ghost_choices: GhostChoices | None = None,
        plays: NDArray[np.bool_] | None = None,
    ) -> tuple[NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_]]:
        """One decision: reward (N,), terminated (N,), truncated (N,); games that were over get no reward.

        ``ghost_choices``: those of ``ghost_agents`` by the ghost's number; the policies of the others are asked. With
        decisions at every tick, games that do not play (``plays`` (N,), None: all do) stand still as if they were over.

        Raises:
            ResetNeeded: before the first reset.
        """
        self.require_reset()
        batch, path_before = self.batch, self._path_left
        was_over = batch.games["end"] != RUNNING if self._asks_who_was_over else _NOBODY
        if plays is not None and self._asks_who_was_over:
            was_over |= ~plays
        self._was_over = was_over
        if self.config.decisions.when == "event":
            choose = self._policies_choose if self._policies else None
            batch.step_until_due(*self._chosen(actions), choose)
            self.elapsed_s = batch.elapsed_s.copy()
        else:
            if self.config.action == "velocity":
                actions = velocities(actions, self.config)
            elif self._listed is not None:
                actions, _ = self._chosen(actions)
            batch.step(actions, self._ghost_choices(ghost_choices or {}), plays)
        self._update_situation()
        reward, terminated, truncated = batch.reward.copy(), batch.terminated.copy(), batch.truncated.copy()
        if plays is not None:
            reward[~plays] = 0.0
        if self._timeout_terminates:
            terminated, truncated = terminated | truncated, np.zeros_like(truncated)
        if self._path_counts:
            self._nearer = self._progress(path_before, was_over, terminated)
            reward += self.config.reward.progress * self._nearer
        return reward, terminated, truncated

    def _progress(
        self, path_before: NDArray[np.float64], was_over: NDArray[np.bool_], terminated: NDArray[np.bool_]
    ) -> NDArray[np.float64]:
        """(N,) gamma phi(s') - phi(s), m, with minus the path length to the nearest pellet as phi; phi of an end is 0.

        Over an episode it telescopes: with gamma = 1, to the path length at its beginning, whatever was done.
        """
        config = self.config
        passed_s = self.elapsed_s if config.decisions.when == "event" else config.execution.tick_s
        left = np.where(terminated, 0.0, self._path_left)
        return np.where(was_over, 0.0, path_before - config.decisions.discount_per_s**passed_s * left)

    def _policies_choose(self) -> NDArray[np.int64] | None:
        return self._ghost_choices({})

    def ghost_reward(self) -> NDArray[np.float64]:
        """(N,) of the tick that has just ended, for a ghost that plays for himself; 0 in games that were over."""
        reward = outcome.reward_and_end(self.batch.games, self._was_over, self.config.ghost_reward)[0]
        return reward + self.config.ghost_reward.progress * self._nearer if self._path_counts else reward

    def observe(self) -> Any:
        """The robot's agent sees this now: one array (N, ...) per key, or one array where observations are flat."""
        seen = self._observer.observe(self.situation, self._listed)
        return self._laid_out(seen, self.masks() if self._mask_beside else None)

    def observe_ghost(self, situation: Situation) -> Any:
        """The agent of a ghost sees this in his situation: the features, laid out as the robot's observation."""
        seen = self._ghost_observer.observe(situation)
        return self._laid_out(seen, situation.mask if self._mask_beside else None)

    @staticmethod
    def _laid_out(seen: Mapping[str, NDArray[Any]], mask: NDArray[np.bool_] | None) -> Any:
        """An observation as its space has it; a mask goes beside it."""
        observation = seen.get(FLAT, seen)
        return observation if mask is None else {OBSERVATION: observation, MASK: mask.astype(np.int8)}

    def info_of_game(self) -> dict[str, Any]:
        """The infos of the only game, numbers as Python's."""
        if not self._more_infos:
            return outcome.info(self.batch.summary, self._numeric)
        return {key: array[0].copy() if array.ndim > 1 else array.tolist()[0] for key, array in self.infos().items()}

    @staticmethod
    def of_game(observation: Any, game: int) -> Any:
        """One game's observation, of all."""
        if isinstance(observation, dict):
            return {key: EnvCore.of_game(part, game) for key, part in observation.items()}
        return observation[game]

    def infos(self) -> dict[str, NDArray[Any]]:
        """Per game; see the environment."""
        batch, games = self.batch, self.batch.games
        result = outcome.infos(batch.summary, self._numeric)
        if self._mask_in_info:
            result[MASK] = self.masks().astype(np.int8)
        if len(batch.levels) > 1:
            result["level"] = batch.level_numbers()
        if self.config.endless:
            result["round"], result["score"] = games["round"].astype(np.int64), games["score"].astype(np.int64)
        if self.config.decisions.when == "event":
            result["elapsed_s"] = self.elapsed_s.copy()
        return result | drawn_values(games, self.config) if self._draws else result

    def _ghost_choices(self, given: GhostChoices) -> NDArray[np.int64] | None:
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
    _core: EnvCore

    def _make_core(self, n: int, arguments: EnvArguments, **more: Any) -> None:
        check_render_mode(arguments.render_mode, self.metadata["render_modes"])
        self._made_from = n, arguments, more
        self._core = EnvCore(n, arguments, **more)
        self.render_mode = arguments.render_mode

    @property
    def batch(self) -> GameBatch:
        """The games."""
        return self._core.batch

    @property
    def config(self) -> Config:
        """What is played by."""
        return self._core.config

    @property
    def started(self) -> bool:
        """Whether a first round has begun."""
        return self._core.started

    def _play_by(self, settings: Mapping[str, Any]) -> None:
        """Play by these from now on, beside the arguments.

        Raises:
            ConfigError: they cannot be played by, or the spaces would be others; nothing has changed then.
            MapError: the map cannot be played on with them.
        """
        if settings == self._core.settings:
            return
        n, arguments, more = self._made_from
        core = EnvCore(n, arguments, **more, settings=settings)
        same = core.observation_space() == self._core.observation_space()
        same &= core.ghost_agents == self._core.ghost_agents
        if not same or core.action_space() != self._core.action_space():
            names = ", ".join(sorted(settings))
            raise ConfigError(
                f"options['settings']: {names} would change the spaces or agents; make an environment with them"
            )
        self._core = core

    @property
    def situation(self) -> Situation:
        """A policy of this package sees this now: one situation per game.

        Raises:
            ResetNeeded: before the first reset.
        """
        return self._core.situation

    @property
    def action_masks(self) -> Callable[[], NDArray[np.bool_]]:
        """``action_masks()``: which candidates may be chosen now, the name that sb3-contrib calls.

        (C,) bool, of a vector environment (N, C); ``action_space.sample`` takes it as int8.

        Raises:
            AttributeError: velocities have no mask.
        """
        if self.config.action != "goal":
            raise AttributeError("velocity actions have no masks")
        return self._masks

    def action_of(self, candidates: NDArray[np.int64]) -> NDArray[np.int64]:
        """(N,) the actions that stand now for candidates (N,), as a policy of this package chooses them.

        Of the nearest candidates those that are not listed are the last action, hold.

        Raises:
            AttributeError: velocities choose no candidate.
            ResetNeeded: before the first reset.
        """
        if self.config.action != "goal":
            raise AttributeError("velocity actions choose no candidate")
        return self._core.actions_of(np.asarray(candidates))

    def _masks(self) -> NDArray[np.bool_]:
        return self._core.masks()

    def _pictures(self, cores: Sequence[EnvCore]) -> tuple[NDArray[np.uint8], ...] | None:
        """One for each game of them, if there is a render mode."""
        if self.render_mode is None:
            return None
        from ..render.frames import render_frame

        return tuple(render_frame(core.batch, i) for core in cores for i in range(core.batch.n))
