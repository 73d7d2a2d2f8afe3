"""Run the games of an environment: policies of ghosts, decisions and observations."""

import copy
import functools
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from ..config import ConfigError
from ..engine.pipeline import Stage
from ..episodes.decisions import ghost_choices, play_until_due
from ..observations.kinds import FLAT, MASK
from ..observations.observer import Observer
from ..policies.base import Indices
from ..sim import compile_ahead
from ..sim.batch import ALL_TICKS, GameBatch, choice_stage
from .arguments import EnvArguments
from .infos import GameInfos
from .rewards import Ends, StepRewards
from .spaces import OBSERVATION, action_space, observation_space, velocities


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
        config, self.policies = arguments.make_config(several=ghost_agents)
        self.config = config = config.with_fields(**self.settings)
        behaviours = enumerate(config.clyde.ghosts)
        self.ghost_agents = [k for k, name in behaviours if name == "policy" and k not in self.policies]
        if self.ghost_agents and not ghost_agents:
            raise ConfigError(f"clyde.ghosts[{self.ghost_agents[0]}] = 'policy': give the policy object in ghosts")
        self.batch = GameBatch(arguments.make_source(config), config, n, num_threads)
        self._observers = [Observer(self.batch) for _ in range(1 if copy else 2)]  # in turn
        self.observer = self._observers[0]  # with the current observation
        features = replace(config.observation, kinds=("features",))  # in the layout of the robot's observation
        self.ghost_observers = {k: Observer(self.batch, features, ghost=True) for k in self.ghost_agents}
        self._copies = copy
        mask = config.observation.mask
        if mask in ("beside", "info") and config.action != "goal":
            raise ConfigError(f"observation.mask = {mask!r}: velocities have no mask")
        nearest = self.observer.nearest
        self.candidates = self.batch.candidates if nearest is None else nearest.count
        self._mask_beside = mask == "beside"
        self.observation_space = self.space_of(self.observer)  # of the robot's agent
        self.action_space = action_space(self.batch, self.candidates)
        self.infos = GameInfos(self.batch)
        self.rewards = StepRewards(self.batch, bool(self.ghost_agents), max_episode_steps)
        self.begun = False  # True after the first reset
        self._by_event = config.decisions.when == "event"
        self._by_python = bool(self.policies or self.ghost_agents or config.endless)
        self._finishes = self.observer.by_python
        self._drives = config.action == "velocity"
        self._actions = np.zeros(n, dtype=np.int64)  # input of the choice stage

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        if self.begun:
            self._observe_maps(np.arange(self.batch.n))
            self._observe()

    def state(self) -> dict[str, Any]:
        """Return copies of everything that decides how the games continue."""
        more = {"policies": self.policies, "counters": self.rewards.counters}
        return {"games": self.batch.read_games(np.arange(self.batch.n)), **copy.deepcopy(more)}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Continue from a ``state`` of a runner with the same arguments and settings, and observe."""
        every = np.arange(self.batch.n)
        self.batch.write_games(every, state["games"])
        self.policies = copy.deepcopy(state["policies"])
        vars(self.rewards).update(copy.deepcopy(state["counters"]))
        self._observe_maps(every)
        self._take_turns()
        self._observe()
        self.begun = True

    def space_of(self, observer: Observer) -> spaces.Dict | spaces.Box:
        """Return the observation space of one game for ``observer``."""
        return observation_space(observer.parts, self.candidates if self._mask_beside else None)

    def require_reset(self) -> None:
        """Raise ResetNeeded before the first reset."""
        if not self.begun:
            raise gym.error.ResetNeeded("call reset() first")

    def reset(
        self, index: Indices, seeds: NDArray[np.uint64], levels: Indices | None = None, *, in_step: bool = False
    ) -> None:
        """Start episodes in the games ``index`` (M,) with their seeds (M,) and levels (M,) (None: by seed).

        With ``in_step`` the present observation of these games is overwritten.
        """
        self.batch.reset(index, seeds, levels)
        self.batch.elapsed_s[index] = 0.0
        for policy in self.policies.values():
            policy.reset(np.isin(np.arange(self.batch.n), index), self.config)
        self._observe_maps(index)
        if not in_step:
            self._take_turns()
        self._observe(index if in_step else None)
        self.rewards.begin_episodes(index, self.observer.situation)
        self.begun = True

    def _observe_maps(self, index: Indices) -> None:
        for observer in self._observers:
            observer.maps_changed(index)

    def _observe(self, index: Indices | None = None) -> None:
        """Observe the games ``index`` (M,) (None: all) as the robot and as each ghost agent."""
        self.observer.observe(index=index)
        for number, observer in self.ghost_observers.items():
            observer.observe(number, index)

    def _take_turns(self) -> None:
        """Switch to the other set of arrays for the next observation, if there are two."""
        self._observers.reverse()
        self.observer = self._observers[0]

    def step(self, actions: NDArray[Any], ghost_actions: Sequence[Indices] = ()) -> Ends:
        """Play one decision with checked actions, (N,) or (N, 2), observe, and return rewards and ends; see ``Ends``.

        Games that were over before the decision get no reward. ``ghost_actions`` are the actions (N,) of each of
        ``ghost_agents``; policy objects choose for the other ghosts.
        """
        batch, rewards = self.batch, self.rewards
        if not rewards.plain:
            rewards.begin_step()
        if self._drives:
            actions = velocities(actions, self.config)
        if self._by_python:
            self._play_by_steps(actions, ghost_actions)
        else:
            inputs = batch.arrays["velocities"] if self._drives else self._actions
            inputs[:] = actions
            self._play_in_one_call()
        if rewards.plain:
            return batch.reward.copy(), batch.terminated.copy(), batch.truncated.copy()
        return rewards.end_step(self.observer.situation)

    def _play_by_steps(self, actions: NDArray[Any], ghost_actions: Sequence[Indices]) -> None:
        """Play one decision with Python code between ticks, for policies of ghosts and endless games."""
        if self._by_event:
            choices, forbidden = self.observer.chosen(actions)
        else:
            choices, forbidden = _choices(self.observer, actions), None  # the rules replace a forbidden one by hold
        agents = zip(self.ghost_observers.items(), ghost_actions, strict=True)
        sent = {number: _choices(observer, given) for (number, observer), given in agents}
        ask = None
        if self.policies or sent:  # unlike in commands, exceptions of a ghost's policy reach the caller unchanged
            ask = functools.partial(ghost_choices, self.batch, self.policies, sent, lambda one, seen: one.select(seen))
        plays = ~self.rewards.cut if sent else None
        play_until_due(self.batch, choices, forbidden, ask, plays)
        self._take_turns()
        self._observe()

    def _play_in_one_call(self) -> None:
        batch = self.batch
        batch.begin_decisions(ALL_TICKS if self._by_event else 1)
        self._take_turns()
        result = self.observer.pipeline(before=self._stages).run(batch.n)
        if result < 0:
            batch.raise_error_of_ghost(result)
        if self._finishes:
            self.observer.finish()

    def _stages(self) -> list[Stage]:
        """Return the stages that play a decision; actions refer to candidates as the last observation lists them."""
        batch, last = self.batch, self._observers[-1]
        choose = [] if self._drives else [choice_stage(batch, self._actions, last.situation.mask, last.order)]
        return [*choose, batch.tick_stage()]

    def observation(self, observer: Observer | None = None, *, first: bool = False, copy: bool | None = None) -> Any:
        """Return the present observation of ``observer`` (None: the robot's), of all games or of the ``first`` one.

        It is one array (N, ...) per key, or one array if observations are flat. Without ``copy`` (None: the setting of
        the environment), a later step overwrites the arrays.
        """
        observer = observer or self.observer
        arrays, allowed = observer.first_game if first else (observer.result, observer.allowed)
        if self._copies if copy is None else copy:
            arrays = {key: array.copy() for key, array in arrays.items()}
        observation = arrays.get(FLAT, arrays)
        return {OBSERVATION: observation, MASK: allowed.copy()} if self._mask_beside else observation


def _choices(observer: Observer, actions: NDArray[Any]) -> NDArray[Any]:
    """Return the candidates (N,) that actions mean, or velocities (N, 2) unchanged."""
    return actions if observer.listed is None else observer.chosen(actions)[0]
