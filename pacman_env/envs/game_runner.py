"""Run the games of an environment: ghost policies, observations, rewards and infos."""

import functools
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from pacman_env.sim.observation.situation_writer import situation_of

from ..config import ConfigError
from ..game.ends import RUNNING
from ..game.reward import Rewards, TickCounts, reward
from ..policies.base import Flags, Floats, Indices
from ..sim.core import compile_ahead
from ..sim.core.batch import GameBatch
from ..sim.core.ghost_state import GHOST_CHOICE, choices_of
from ..sim.core.parameters import drawn_values
from ..sim.observation.kinds import FLAT, MASK
from ..sim.observation.observer import Observer
from ..sim.observation.robot_features import Observation
from ..sim.observation.situation import Situation
from . import outcome
from .arguments import EnvArguments
from .observed_games import ObservedGames
from .outcome import Ends
from .spaces import OBSERVATION, action_space, observation_space

_NONE_OVER = np.zeros(0, dtype=np.bool_)


class GameRunner:
    """N games of one environment, built from its arguments.

    With ``ghost_agents`` the caller of ``step`` chooses for ghosts whose behaviour is ``policy``. Without ``copy``,
    situations and observations use two sets of arrays in turn. ``settings`` override the settings of the arguments.
    """

    def __init__(
        self,
        n: int,
        arguments: EnvArguments,
        *,
        ghost_agents: bool = False,
        num_threads: int = 1,
        copy: bool = True,
        max_episode_steps: int | None = None,
        settings: Mapping[str, Any] | None = None,
    ) -> None:
        compile_ahead.begin()
        self.settings = dict(settings or {})
        config, self._policies = arguments.make_config(several=ghost_agents)
        self.config = config.with_fields(**self.settings)
        behaviours = enumerate(self.config.clyde.ghosts)
        self.ghost_agents = [k for k, name in behaviours if name == "policy" and k not in self._policies]
        if self.ghost_agents and not ghost_agents:
            raise ConfigError(f"clyde.ghosts[{self.ghost_agents[0]}] = 'policy': give the policy object in ghosts")
        self.batch = GameBatch(arguments.make_source(self.config), self.config, n, num_threads)
        self._games = ObservedGames(self.batch, copy)
        nearest = self.observer.nearest
        self.candidates = self.batch.candidates if nearest is None else nearest.count
        self._mask_in_info = self.config.observation.mask == "info"
        self._mask_beside = self.config.observation.mask == "beside"
        if (self._mask_beside or self._mask_in_info) and self.config.action != "goal":
            raise ConfigError(f"observation.mask = {self.config.observation.mask!r}: velocities have no mask")
        beside = self.candidates if self._mask_beside else None
        self.observation_space = observation_space(self.observer.parts, beside)  # space of the robot's agent
        self.action_space = action_space(self.batch, self.candidates)
        self.begun = False  # True after the first reset
        self._copies = copy
        self._shown: Situation | None = None  # copy returned by ``situation`` since the last step
        self.elapsed_s = np.zeros(n)  # simulated time of the last step
        self._most_steps = max_episode_steps
        self._steps = np.zeros(n, dtype=np.int64)  # decisions in the current episode
        self.cut = np.zeros(n, dtype=np.bool_)  # truncated by the step limit and not yet reset
        self._path_counts = bool(self.config.reward.progress or self.config.ghost_reward.progress)
        self._path_left = np.zeros(n)  # m, path from the believed pose to the nearest pellet; 0 if there is none
        self._nearer = np.zeros(n)  # m by which this path became shorter in the last step
        self._was_over = _NONE_OVER  # (N,) over before the last step; only set if a reward needs it
        self._draws = bool(self.config.randomize.ranges())
        self._by_event = self.config.decisions.when == "event"

    def __getstate__(self) -> dict[str, Any]:
        """Return the state without the copied situation."""
        return {**self.__dict__, "_shown": None}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        if self.begun:
            self._games.maps_changed(np.arange(self.batch.n))
            self._games.observe()
            self._refresh()

    @property
    def observer(self) -> Observer:
        """Return the observer with the current observation."""
        return self._games.observer

    def require_reset(self, running: bool = False) -> None:
        """Raise ResetNeeded before the first reset, and with ``running`` also if every episode is over."""
        if not self.begun:
            raise gym.error.ResetNeeded("call reset() first")
        if running and self.batch.summary[0, 0] != RUNNING and (self.batch.summary[0] != RUNNING).all():
            raise gym.error.ResetNeeded("the episode is over: call reset()")

    @property
    def situation(self) -> Situation:
        """Return the current situation of the robot's policy, in arrays that later steps do not change."""
        self.require_reset()
        if self._shown is None:
            self._shown = self.observer.situation.copy()
        return self._shown

    def ghost_observation_space(self) -> spaces.Dict | spaces.Box:
        """Return the observation space of a ghost agent."""
        return observation_space(self._ghost_observer.parts, self.candidates if self._mask_beside else None)

    def reset(
        self, index: Indices, seeds: NDArray[np.uint64], levels: Indices | None = None, *, in_step: bool = False
    ) -> None:
        """Start episodes in the games ``index`` (M,) with their seeds (M,) and levels (M,) (None: by seed).

        With ``in_step`` the present observation of these games is overwritten.
        """
        self.elapsed_s[index] = 0.0
        self._steps[index] = 0
        self.cut[index] = False
        self.batch.reset(index, seeds, levels)
        if self._policies:
            games = np.zeros(self.batch.n, dtype=np.bool_)
            games[index] = True
            for policy in self._policies.values():
                policy.reset(games, self.config)
        self._games.maps_changed(index)
        if not in_step:
            self._games.take_turns()
        self._games.observe(index if in_step else None)
        self._refresh()
        self.begun = True

    def _refresh(self) -> None:
        """Update the path length to the nearest pellet, and drop the copied situation."""
        self._shown = None
        if self._path_counts:
            alive = self.batch.alive  # (N, P)
            lengths = np.where(alive, self.observer.situation.path_robot[:, : alive.shape[1]], np.inf).min(axis=1)
            self._path_left = np.where(np.isfinite(lengths), lengths, 0.0)

    @functools.cached_property
    def _ghost_observer(self) -> Observer:
        """Return the observer of ghost agents: the features, in the layout of the robot's observation."""
        config = replace(self.config.observation, kinds=("features",))
        return Observer(self.batch, config, ghost=True)

    def masks(self) -> Flags:
        """Return the mask of the allowed actions, (N, C)."""
        self.require_reset()
        return self.observer.allowed != 0

    def step(self, actions: NDArray[Any], ghost_choices: Mapping[int, Indices] | None = None) -> Ends:
        """Play one decision with checked actions, (N,) or (N, 2), and return rewards and ends; see ``Ends``.

        Games that were over before the decision get no reward.
        ``ghost_choices`` maps each of ``ghost_agents`` to its choices (N,); policy objects choose for the other ghosts.
        With several agents, truncated games stand still as if they were over.
        """
        self.require_reset()
        batch, path_before = self.batch, self._path_left
        if self._path_counts or self.ghost_agents:
            over = batch.games["end"] != RUNNING
            self._was_over = over | self.cut if self.ghost_agents else over
        by_python = self._policies or self.ghost_agents or self.config.endless
        if by_python:
            choose = functools.partial(self._ghost_choices, {}) if self._policies else None
            plays = ~self.cut if self.ghost_agents and self.cut.any() else None
            choices = None if self._by_event else self._ghost_choices(ghost_choices or {})
            self._games.play_by_steps(actions, choose, choices, plays)
        else:
            self._games.play_in_one_call(actions)
        self._refresh()
        if self._by_event:
            self.elapsed_s = batch.elapsed_s.copy()
        reward, terminated, truncated = batch.reward.copy(), batch.terminated.copy(), batch.truncated.copy()
        if self.ghost_agents and self.cut.any():
            reward[self.cut] = 0.0
        if self.config.timeout == "termination":
            terminated, truncated = terminated | truncated, np.zeros_like(truncated)
        if self._path_counts:
            self._nearer = self._progress(path_before, terminated)
            reward += self.config.reward.progress * self._nearer
        if self.ghost_agents or self._most_steps is not None:
            self._cut_long_episodes(terminated, truncated)
        return reward, terminated, truncated

    def _cut_long_episodes(self, terminated: Flags, truncated: Flags) -> None:
        """Set ``truncated`` (N,) for episodes at the step limit.

        With one agent this includes episodes that terminate in the same step, as in Gymnasium's ``TimeLimit``.
        """
        most = self.config.max_cycles if self.ghost_agents else self._most_steps
        if most is not None:
            self._steps += 1
            long = self._steps >= most
            self.cut = long & ~terminated & ~truncated
            truncated |= long & ~terminated if self.ghost_agents else long

    def _progress(self, path_before: Floats, terminated: Flags) -> Floats:
        """Return the shaping reward gamma phi(s') - phi(s) of the last step, (N,), m.

        The potential phi is minus the path length to the nearest pellet, and 0 after a termination. With gamma = 1 the
        sum over a terminated episode is the path length at its start, whatever the agent did.
        """
        config = self.config
        passed_s = self.elapsed_s if self._by_event else config.execution.tick_s
        left = np.where(terminated, 0.0, self._path_left)
        return np.where(self._was_over, 0.0, path_before - config.decisions.discount_per_s**passed_s * left)

    def ghost_reward(self) -> Floats:
        """Return a ghost's reward (N,) in the last step, from ``config.ghost_reward``; 0 in games that were over."""
        games, config = self.batch.games, self.config.ghost_reward
        counts = TickCounts(*(games[name] for name in TickCounts._fields))
        earned = np.where(self._was_over, 0.0, reward(counts, games["end"], Rewards.of(config)))
        return earned + config.progress * self._nearer if self._path_counts else earned

    def observe(self, copy: bool | None = None) -> Any:
        """Return the robot's observation: one array (N, ...) per key, or one array if observations are flat.

        Without ``copy`` (None: the setting of the environment), a later step overwrites the arrays.
        """
        observer = self.observer
        return self._lay_out(observer.result, observer.allowed, self._copies if copy is None else copy)

    def observe_game(self) -> Any:
        """Return the observation of the only game: one array per key, or one array."""
        return self._lay_out(*self.observer.first_game, True)

    def observe_ghost(self, number: int) -> tuple[Any, Flags, Indices | None]:
        """Return a ghost's observation, its mask (N, C) and the candidates of actions (None: all, by number)."""
        observer = self._ghost_observer
        observer.observe(number)
        listed = None if observer.listed is None else observer.listed.copy()
        return self._lay_out(observer.result, observer.allowed, True), observer.allowed != 0, listed

    def _lay_out(self, arrays: Observation, allowed: NDArray[np.int8], copy: bool) -> Any:
        if copy:
            arrays = {key: array.copy() for key, array in arrays.items()}
        observation = arrays.get(FLAT, arrays)
        return {OBSERVATION: observation, MASK: allowed.copy()} if self._mask_beside else observation

    def info_of_game(self) -> dict[str, Any]:
        """Return the infos of the only game as Python numbers."""
        info = outcome.info(self.batch.summary, self.config.observation.numeric_info)
        for key, array in self._more_infos().items():
            info[key] = array[0].copy() if array.ndim > 1 else array.tolist()[0]
        return info

    @staticmethod
    def of_game(observation: Any, game: int) -> Any:
        """Return one game's part of an observation of all games."""
        if isinstance(observation, dict):
            return {key: GameRunner.of_game(part, game) for key, part in observation.items()}
        return observation[game]

    def infos(self) -> dict[str, NDArray[Any]]:
        """Return the infos, (N,) each; a mask among them is (N, C)."""
        return outcome.infos(self.batch.summary, self.config.observation.numeric_info) | self._more_infos()

    def _more_infos(self) -> dict[str, NDArray[Any]]:
        batch, games = self.batch, self.batch.games
        result: dict[str, NDArray[Any]] = {}
        if self._mask_in_info:
            result[MASK] = self.masks().astype(np.int8)
        if len(batch.levels) > 1:
            result["level"] = batch.level_numbers()
        if self.config.endless:
            result["round"] = games["round"].astype(np.int64)
        if self._by_event:
            result["elapsed_s"] = self.elapsed_s.copy()
        return result | drawn_values(games, self.config) if self._draws else result

    def _ghost_choices(self, given: Mapping[int, Indices]) -> NDArray[Any] | None:
        """Return the choices (N, G) of the ghosts' policies, or ``given`` by ghost number; None if none is needed."""
        if not (self._policies or given):
            return None
        choices = np.zeros(self.batch.ghosts.shape, dtype=GHOST_CHOICE)
        for number, policy in self._policies.items():
            chosen = np.asarray(policy.select(situation_of(self.batch, number)))
            if chosen.shape != (self.batch.n,) or (chosen.dtype != GHOST_CHOICE and chosen.dtype.kind not in "iu"):
                wanted, got = f"{self.batch.n} integers", f"{chosen.dtype} of shape {chosen.shape}"
                raise ValueError(f"ghosts[{number}]: select must return {wanted}, got {got}")
            choices[:, number] = choices_of(chosen)
        for number, choice in given.items():
            choices[:, number] = choices_of(choice)
        return choices
