"""The common core of the environments: the games, the ghosts' policies, observations, rewards, infos."""

import functools
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from ..config import Config, ConfigError
from ..engine.pipeline import Pipeline
from ..game.execution import RUNNING
from ..policies.base import Flags, Floats, Indices
from ..sim.core import compile_ahead
from ..sim.core.batch import ALL_TICKS, GameBatch
from ..sim.core.parameters import drawn_values
from ..sim.observation.kinds import FLAT, MASK
from ..sim.observation.observer import Observer
from ..sim.observation.planner_features import NEEDS_MAPS
from ..sim.observation.robot_features import Observation
from ..sim.observation.situation import MISSING, Situation, at_places
from . import outcome
from .arguments import EnvArguments, check_render_mode
from .outcome import Ends
from .spaces import OBSERVATION, action_space, observation_space, velocities

_NONE_OVER = np.zeros(0, dtype=np.bool_)


class EnvCore:
    """N games of one environment, from its arguments.

    ``ghost_agents``: the caller of ``step`` chooses for ghosts whose behaviour is ``policy``. Without ``copy``,
    situations and features are written to two sets of arrays in turn. ``settings`` replace those of the arguments.
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
        #: Without copies two, in turn: what the step before has returned stays as it is.
        self._observers = [Observer(self.batch) for _ in range(1 if copy else 2)]
        nearest = self._observer.nearest
        self.candidates = self.batch.candidates if nearest is None else nearest.count
        self._mask_in_info = self.config.observation.mask == "info"
        self._mask_beside = self.config.observation.mask == "beside"
        if (self._mask_beside or self._mask_in_info) and self.config.action != "goal":
            raise ConfigError(f"observation.mask = {self.config.observation.mask!r}: velocities have no mask")
        beside = self.candidates if self._mask_beside else None
        self.observation_space = observation_space(self._observer.parts, beside)  # of the robot's agent
        self.action_space = action_space(self.batch, self.candidates)
        self.begun = False  # a first round
        self._copies = copy
        self._shown: Situation | None = None  # the situation as it was given away since the last step
        self._actions = np.zeros(n, dtype=np.int64)
        self._calls: dict[Observer, tuple[tuple[int, int], Pipeline]] = {}  # with what they are made for
        self.elapsed_s = np.zeros(n)  # simulated, in the last step
        self._most_steps = max_episode_steps
        self._steps = np.zeros(n, dtype=np.int64)  # of each episode
        self.cut = np.zeros(n, dtype=np.bool_)  # by the most steps, and not reset since
        self._path_counts = bool(self.config.reward.progress or self.config.ghost_reward.progress)
        self._path_left = np.zeros(n)  # m, from the believed pose to the nearest pellet left; 0: none, or no path
        self._nearer = np.zeros(n)  # m, in the last step
        self._was_over = _NONE_OVER  # (N,) before the last step, where a reward asks for it
        self._draws = bool(self.config.randomize.ranges())
        self._by_event = self.config.decisions.when == "event"

    def __getstate__(self) -> dict[str, Any]:
        """Without what is made again."""
        return {**self.__dict__, "_shown": None, "_calls": {}}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        if self.begun:
            self._maps_changed(np.arange(self.batch.n))
            self._look()

    @property
    def _observer(self) -> Observer:
        """What the observation of now is in."""
        return self._observers[0]

    def require_reset(self, running: bool = False) -> None:
        """Raise ResetNeeded before the first reset, or with ``running`` where every episode is over."""
        if not self.begun:
            raise gym.error.ResetNeeded("call reset() first")
        if running and self.batch.games["end"][0] != RUNNING and (self.batch.games["end"] != RUNNING).all():
            raise gym.error.ResetNeeded("the episode is over: call reset()")

    @property
    def situation(self) -> Situation:
        """As the robot's policy sees it now; it stays as it is."""
        self.require_reset()
        if self._shown is None:
            self._shown = self._observer.situation.copy()
        return self._shown

    def ghost_observation_space(self) -> spaces.Dict | spaces.Box:
        """Of a ghost's agent."""
        return observation_space(self._ghost_observer.parts, self.candidates if self._mask_beside else None)

    def reset(
        self, index: Indices, seeds: NDArray[np.uint64], levels: Indices | None = None, *, in_step: bool = False
    ) -> None:
        """New episodes in the games ``index``; ``in_step``: the situation after the last step is not in use."""
        self.elapsed_s[index] = 0.0
        self._steps[index] = 0
        self.cut[index] = False
        self.batch.reset(index, seeds, levels)
        if self._policies:
            games = np.zeros(self.batch.n, dtype=np.bool_)
            games[index] = True
            for policy in self._policies.values():
                policy.reset(games, self.config)
        self._maps_changed(index)
        if not in_step:
            self._take_turns()
        self._look(index if in_step else None)
        self.begun = True

    def _maps_changed(self, index: Indices) -> None:
        """Prepare for the maps that the games ``index`` (M,) are on now."""
        for observer in self._observers:
            observer.maps_changed(index)

    def _step_call(self) -> Pipeline:
        """The one call of a step, made anew if arrays that it works on have been replaced.

        Actions stand for candidates as the observation before lists them.
        """
        batch, observer, last = self.batch, self._observer, self._observers[-1]
        made_for = batch.revision, batch.levels.most_goals
        known = self._calls.get(observer)
        if known is None or known[0] != made_for:
            stages = [batch.situation_stage(observer.situation), *observer.stages()]
            if self.config.action == "goal":
                stages = [
                    batch.choice_stage(self._actions, last.situation.mask, last.order),
                    batch.tick_stage(),
                    *stages,
                ]
            else:
                stages = [batch.tick_stage(), *stages]
            known = self._calls[observer] = (batch.revision, batch.levels.most_goals), Pipeline(stages, batch.threads)
        return known[1]

    def _look(self, index: Indices | None = None) -> None:
        """Observe all games anew, or those in ``index`` alone."""
        self._observer.observe(index=index)
        self._seen()

    def _seen(self) -> None:
        """Keep what is asked of the new situations."""
        self._shown = None
        if self._path_counts:
            alive = self.batch.alive  # (N, P)
            lengths = np.where(alive, self._observer.situation.path_robot[:, : alive.shape[1]], np.inf).min(axis=1)
            self._path_left = np.where(np.isfinite(lengths), lengths, 0.0)

    def _take_turns(self) -> None:
        """The next observation goes to the other arrays, if there are two sets."""
        if len(self._observers) > 1:
            self._observers.reverse()

    @functools.cached_property
    def _ghost_observer(self) -> Observer:
        """Of ghosts that are agents: the features, laid out as the robot's observation."""
        config = replace(self.config.observation, kinds=("features",))
        return Observer(self.batch, config, ghost=True)

    @property
    def listed(self) -> Indices | None:
        """(N, K) the candidates that actions stand for now; None: their own."""
        return self._observer.listed

    def masks(self) -> Flags:
        """(N, C) which actions are allowed now."""
        self.require_reset()
        return self._observer.allowed != 0

    def actions_of(self, candidates: NDArray[Any]) -> tuple[NDArray[Any], Flags]:
        """(N,) the actions that stand for candidates, hold where none does, and where one does."""
        if self.listed is None:
            return candidates, np.ones(len(candidates), dtype=np.bool_)
        there = (self.listed == candidates[:, None]) & (self.listed != MISSING)
        listed = there.any(axis=1)
        return np.where(listed, there.argmax(axis=1), self.candidates - 1), listed

    def observe_from(self, situation: Situation) -> Any:
        """The observation of situations from elsewhere, such as a robot's; masks and actions are of them from now on.

        Kinds that are made of the games themselves, such as a scan, are those of the games.
        """
        self._observer.look_at(situation)
        self._shown, self.begun = situation, True
        return self.observe()

    def _chosen(self, actions: NDArray[Any]) -> tuple[NDArray[Any], Flags]:
        """The candidates that checked actions stand for, hold where they are forbidden, and where that is."""
        if self.listed is None:
            return actions, self._observer.situation.mask[np.arange(self.batch.n), actions] == 0
        return at_places(self.listed, actions, self.batch.hold)

    @property
    def _in_one_call(self) -> bool:
        """Whether nothing but kernels is asked between the actions and the observation."""
        by_python = self._policies or self.ghost_agents or self.config.endless or self.batch.after_physics_step
        return not by_python

    def _play_in_one_call(self, actions: NDArray[Any]) -> None:
        batch = self.batch
        if self.config.action == "velocity":
            batch.arrays["velocities"][:] = velocities(actions, self.config)
            batch.wake()
        else:
            self._actions[:] = actions
        batch.send_no_ghosts()
        batch.prepare_ticks(watch=self._by_event, most=ALL_TICKS if self._by_event else 1)
        self._take_turns()
        result = self._step_call().run(batch.n)
        if result:  # a game waits for a space, a map is to be prepared, or a ghost's function has raised
            batch.resume(max(result, 1) if result <= NEEDS_MAPS else result)
            self._observer.observe()
        else:
            self._observer.finish()
        self._seen()

    def _play_by_steps(self, actions: NDArray[Any], given: Mapping[int, Indices]) -> None:
        batch = self.batch
        plays = ~self.cut if self.ghost_agents and self.cut.any() else None
        if self._by_event:
            choose = functools.partial(self._ghost_choices, {}) if self._policies else None
            batch.step_until_due(*self._chosen(actions), choose)
        else:
            if self.config.action == "velocity":
                actions = velocities(actions, self.config)
            elif self.listed is not None:
                actions, _ = self._chosen(actions)
            batch.step(actions, self._ghost_choices(given), plays)
        self._take_turns()
        self._look()

    def step(self, actions: NDArray[Any], ghost_choices: Mapping[int, Indices] | None = None) -> Ends:
        """One decision; games that were over get no reward.

        ``ghost_choices`` (N,) are those of ``ghost_agents`` by the ghost's number; the policies of the others are
        asked. With several agents, games that were cut stand still as if they were over.
        """
        self.require_reset()
        batch, path_before = self.batch, self._path_left
        if self._path_counts or self.ghost_agents:
            over = batch.games["end"] != RUNNING
            self._was_over = over | self.cut if self.ghost_agents else over
        if self._in_one_call:
            self._play_in_one_call(actions)
        else:
            self._play_by_steps(actions, ghost_choices or {})
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
        """Truncate episodes at the most steps; with one agent terminated ones too, as Gymnasium's ``TimeLimit``."""
        most = self.config.max_cycles if self.ghost_agents else self._most_steps
        if most is not None:
            self._steps += 1
            long = self._steps >= most
            self.cut = long & ~terminated & ~truncated
            truncated |= long & ~terminated if self.ghost_agents else long

    def _progress(self, path_before: Floats, terminated: Flags) -> Floats:
        """(N,) gamma phi(s') - phi(s), m, with minus the path length to the nearest pellet as phi; phi of an end is 0.

        Over an episode it telescopes: with gamma = 1, to the path length at its beginning, whatever was done.
        """
        config = self.config
        passed_s = self.elapsed_s if self._by_event else config.execution.tick_s
        left = np.where(terminated, 0.0, self._path_left)
        return np.where(self._was_over, 0.0, path_before - config.decisions.discount_per_s**passed_s * left)

    def ghost_reward(self) -> Floats:
        """(N,) of a ghost in the last step, by ``config.ghost_reward``; 0 in games that were over."""
        reward = outcome.reward_and_end(self.batch.games, self._was_over, self.config.ghost_reward)[0]
        return reward + self.config.ghost_reward.progress * self._nearer if self._path_counts else reward

    def observe(self, copy: bool | None = None) -> Any:
        """Of the robot's agent: one array (N, ...) per key, or one array where observations are flat.

        Without ``copy`` (None: as the environment was made) the arrays are written again by a later step.
        """
        observer = self._observer
        return self._laid_out(observer.result, observer.allowed, self._copies if copy is None else copy)

    def observe_game(self) -> Any:
        """Of the only game: one array per key, or one array."""
        return self._laid_out(*self._observer.first_game, True)

    def observe_ghost(self, number: int) -> tuple[Any, Flags, Indices | None]:
        """Of a ghost's agent, laid out alike; its mask (N, C) and ``listed``, as the robot's."""
        observer = self._ghost_observer
        observer.observe(number)
        listed = None if observer.listed is None else observer.listed.copy()
        return self._laid_out(observer.result, observer.allowed, True), observer.allowed != 0, listed

    def _laid_out(self, seen: Observation, allowed: NDArray[np.int8], copy: bool) -> Any:
        if copy:
            seen = {key: array.copy() for key, array in seen.items()}
        observation = seen.get(FLAT, seen)
        return {OBSERVATION: observation, MASK: allowed.copy()} if self._mask_beside else observation

    def info_of_game(self) -> dict[str, Any]:
        """The infos of the only game, as Python's numbers."""
        info = outcome.info(self.batch.summary, self.config.observation.numeric_info)
        for key, array in self._more_infos().items():
            info[key] = array[0].copy() if array.ndim > 1 else array.tolist()[0]
        return info

    @staticmethod
    def of_game(observation: Any, game: int) -> Any:
        """One game's observation, of all."""
        if isinstance(observation, dict):
            return {key: EnvCore.of_game(part, game) for key, part in observation.items()}
        return observation[game]

    def infos(self) -> dict[str, NDArray[Any]]:
        """Per game (N,), and with a mask in them (N, C), as the environment describes them."""
        return outcome.infos(self.batch.summary, self.config.observation.numeric_info) | self._more_infos()

    def _more_infos(self) -> dict[str, NDArray[Any]]:
        batch, games = self.batch, self.batch.games
        result: dict[str, NDArray[Any]] = {}
        if self._mask_in_info:
            result[MASK] = self.masks().astype(np.int8)
        if len(batch.levels) > 1:
            result["level"] = batch.level_numbers()
        if self.config.endless:
            result["round"], result["score"] = games["round"].astype(np.int64), games["score"].astype(np.int64)
        if self._by_event:
            result["elapsed_s"] = self.elapsed_s.copy()
        return result | drawn_values(games, self.config) if self._draws else result

    def _ghost_choices(self, given: Mapping[int, Indices]) -> Indices | None:
        """(N, G), from the policies and as given; None: every ghost has a behaviour."""
        if not (self._policies or given):
            return None
        choices = np.full(self.batch.ghosts.shape, self.batch.hold, dtype=np.int64)
        for number, policy in self._policies.items():
            chosen = np.asarray(policy.select(self.batch.situation(number)))
            if chosen.shape != (self.batch.n,) or chosen.dtype.kind not in "iu":
                wanted, got = f"{self.batch.n} integers", f"{chosen.dtype} of shape {chosen.shape}"
                raise ValueError(f"ghosts[{number}]: select must return {wanted}, got {got}")
            choices[:, number] = chosen
        for number, choice in given.items():
            choices[:, number] = choice
        return choices


_FIXED = ("observation_space", "action_space", "ghost_agents")  # of an environment


class CoreEnv:
    """An environment over an :class:`EnvCore`, whatever its interface."""

    metadata: dict[str, Any]
    render_mode: str | None
    _core: EnvCore
    _spec: Any = None

    def _make_core(self, n: int, arguments: EnvArguments, **more: Any) -> None:
        check_render_mode(arguments.render_mode, self.metadata["render_modes"])
        self._made_from = n, arguments, more
        self._core = EnvCore(n, arguments, **more)
        self.render_mode = arguments.render_mode

    @property
    def spec(self) -> Any:
        """Gymnasium's or PettingZoo's; its arguments are as JSON gives them back, so that specs compare equal."""
        return self._spec

    @spec.setter
    def spec(self, spec: Any) -> None:
        if spec is not None:
            spec.kwargs = as_json(spec.kwargs)
        self._spec = spec

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
        return self._core.begun

    def _core_by(self, settings: Mapping[str, Any]) -> EnvCore:
        """That of this environment, or another one if it plays by other settings beside the arguments."""
        if settings == self._core.settings:
            return self._core
        n, arguments, more = self._made_from
        core = EnvCore(n, arguments, **more, settings=settings)
        if any(getattr(core, name) != getattr(self._core, name) for name in _FIXED):
            would = f"{', '.join(sorted(settings))} would change the spaces or agents"
            raise ConfigError(f"options['settings']: {would}; make an environment with them")
        return core

    @property
    def situation(self) -> Situation:
        """One per game, as a policy of this package sees it now; raises ResetNeeded before the first reset."""
        return self._core.situation

    @property
    def action_masks(self) -> Callable[[], NDArray[np.bool_]]:
        """``action_masks()``: which candidates may be chosen now, the name that sb3-contrib calls.

        (C,) bool, of a vector environment (N, C); ``action_space.sample`` takes it as int8. Raises AttributeError with
        velocities, which have no mask.
        """
        if self.config.action != "goal":
            raise AttributeError("velocity actions have no masks")
        return self._masks

    def action_of(self, candidates: NDArray[np.int64]) -> NDArray[np.int64]:
        """(N,) the actions that stand now for candidates (N,), as a policy of this package chooses them.

        Of the nearest candidates those that are not listed are the last action, hold. Raises AttributeError with
        velocities, and ResetNeeded before the first reset.
        """
        if self.config.action != "goal":
            raise AttributeError("velocity actions choose no candidate")
        self._core.require_reset()
        return self._core.actions_of(np.asarray(candidates))[0]

    def _masks(self) -> NDArray[np.bool_]:
        return self._core.masks()

    def _pictures(self, cores: Sequence[EnvCore]) -> tuple[NDArray[np.uint8], ...] | None:
        """One for each game, if there is a render mode."""
        if self.render_mode is None:
            return None
        from ..render.frames import render_frame

        return tuple(render_frame(core.batch, i) for core in cores for i in range(core.batch.n))


def as_json(value: Any) -> Any:
    """Return plain data as JSON gives it back, a configuration as settings, a path as text, and all else unchanged."""
    if isinstance(value, Config):
        value = value.as_settings()
    if isinstance(value, os.PathLike):
        value = os.fspath(value)
    if isinstance(value, Mapping):
        return {key: as_json(one) for key, one in value.items()}
    if isinstance(value, (np.ndarray, np.generic)):
        value = value.tolist()
    return [as_json(one) for one in value] if isinstance(value, (list, tuple)) else value
