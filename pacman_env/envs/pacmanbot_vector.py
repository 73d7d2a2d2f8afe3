"""The native vector environment: a batch of many games behind Gymnasium's VectorEnv."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from ..game.execution import RUNNING
from ..render.display import RENDER_FPS
from ..sim.observation.robot_features import Observation
from .arguments import EnvArguments, takes_env_arguments
from .core import CoreEnv
from .reset_options import ResetOptions

_NOTHING_WANTED = ResetOptions()


class PacManBotVectorEnv(CoreEnv, gym.vector.VectorEnv[Observation, NDArray[Any], NDArray[Any]]):
    """Many games of :class:`~pacman_env.envs.pacmanbot.PacManBotEnv` at once.

    They share one map, or with ``map="generated"`` each is in a house of its own.

    ```python
    gymnasium.make_vec("pacman_env/PacManBot-v0", num_envs=64, vectorization_mode="vector_entry_point")
    ```

    Spaces, rewards and arguments are those of the single environment; game i with seed s equals a single environment
    with seed s, bit for bit. ``autoreset_mode`` is one of Gymnasium's three; with ``DISABLED`` pass
    ``options={"reset_mask": mask}`` to ``reset``. Episodes are truncated after ``max_episode_steps`` decisions.
    """

    metadata: dict[str, Any] = {  # noqa: RUF012
        "render_modes": ["rgb_array"],
        "render_fps": RENDER_FPS,
        "autoreset_mode": AutoresetMode.NEXT_STEP,
    }
    single_action_space: spaces.Discrete | spaces.Box

    @takes_env_arguments
    def __init__(
        self,
        num_envs: int = 64,
        *,
        arguments: EnvArguments,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        max_episode_steps: int | None = None,
    ) -> None:
        """See the single environment; raises ConfigError or MapError for arguments that cannot be played."""
        if not isinstance(num_envs, (int, np.integer)) or isinstance(num_envs, bool) or num_envs < 1:
            raise ValueError(f"num_envs = {num_envs!r}: must be a whole number of at least 1")
        num_envs = int(num_envs)
        steps = max_episode_steps
        if steps is not None and (not isinstance(steps, (int, np.integer)) or isinstance(steps, bool) or steps < 1):
            raise ValueError(f"max_episode_steps = {steps!r}: must be a whole number of at least 1, or None")
        self._most_steps = steps
        self._make_core(num_envs, arguments)
        self.num_envs = num_envs
        self.autoreset_mode = AutoresetMode(autoreset_mode)
        self.metadata = {**self.metadata, "autoreset_mode": self.autoreset_mode}
        self.single_observation_space = self._core.observation_space()
        self.single_action_space = self._core.action_space()
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._generators: list[np.random.Generator | None] = [None] * num_envs
        self._all = np.arange(num_envs)
        self._steps = np.zeros(num_envs, dtype=np.int64)  # of each episode
        self._cut = np.zeros(num_envs, dtype=np.bool_)  # by max_episode_steps, and not reset since

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[Observation, dict[str, Any]]:
        """Start new rounds, in all games or those of ``options["reset_mask"]``.

        Args:
            seed: one seed s (game i gets s + i), one per game, or None: the generators go on.
            options: may hold ``reset_mask``, bool (N,), and what the single environment's may: ``round_seed`` and
                ``level``, one for all games or one for each, for the episodes that begin now; ``settings``, for all
                games and until the next reset of all.

        Raises:
            ValueError: the seeds, the mask or other options do not fit the games.
            ResetNeeded: the first reset is not of all games.
        """
        wanted = ResetOptions.of(options, self.num_envs, "reset_mask")
        index = self._reset_index(options)
        levels = wanted.levels(self.batch.source, index)
        if seed is None or isinstance(seed, (int, np.integer)):
            seed = [None if seed is None else int(seed) + i for i in range(self.num_envs)]
        if not isinstance(seed, (Sequence, np.ndarray)) or isinstance(seed, str):
            raise ValueError(f"seed = {seed!r}: must be a whole number, one for each game, or None")
        if len(seed) != self.num_envs:
            raise ValueError(f"{len(seed)} seeds for {self.num_envs} games")
        if len(index) == self.num_envs:
            self._play_by(wanted.settings)
        elif wanted.settings:
            raise ValueError("options['settings'] are for all games, which are not all reset")
        for i in index.tolist():
            if seed[i] is not None or self._generators[i] is None:
                self._generators[i], _ = gym.utils.seeding.np_random(seed[i])
        self._new_rounds(index, wanted, levels)
        return self._core.observe(), self._infos(index)

    def step(
        self, actions: NDArray[np.int64]
    ) -> tuple[Observation, NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]:
        """One decision in every game.

        Raises:
            ValueError: the actions are not N integers of the action space.
            ResetNeeded: before the first reset.
        """
        core = self._core
        over = (self.batch.games["end"] != RUNNING) | self._cut
        reward, terminated, truncated = core.step(self._checked(actions))
        self._cut_long_episodes(terminated, truncated)
        final: dict[str, Any] = {}
        if self.autoreset_mode == AutoresetMode.NEXT_STEP and over.any():
            self._new_rounds(np.flatnonzero(over))
            terminated[over] = truncated[over] = False
            reward[over] = 0.0
        if self.autoreset_mode == AutoresetMode.SAME_STEP:
            ended = np.flatnonzero(terminated | truncated)
            if len(ended):
                final = self._final(ended)
                self._new_rounds(ended)
        return core.observe(), reward, terminated, truncated, {**final, **self._infos(self._all)}

    def _cut_long_episodes(self, terminated: NDArray[np.bool_], truncated: NDArray[np.bool_]) -> None:
        """What Gymnasium's ``TimeLimit`` does for one environment."""
        self._steps += 1
        if self._most_steps is not None:
            long = self._steps >= self._most_steps
            self._cut = long & ~terminated & ~truncated
            truncated |= long

    def render(self) -> tuple[NDArray[np.uint8], ...] | None:
        """One picture per game."""
        if self.render_mode is None:
            return None
        from ..render.frames import render_frame

        return tuple(render_frame(self.batch, i) for i in range(self.num_envs))

    def _checked(self, actions: NDArray[Any]) -> NDArray[Any]:
        actions = np.asarray(actions)
        if self.config.action == "velocity":
            if actions.shape != (self.num_envs, 2) or actions.dtype.kind not in "fiu":
                got = f"{actions.dtype} of shape {actions.shape}"
                raise ValueError(f"actions must be {self.num_envs} pairs of v and omega, got {got}")
            return actions.astype(np.float64)
        if actions.shape != (self.num_envs,) or actions.dtype.kind not in "iu":
            raise ValueError(f"actions must be {self.num_envs} integers, got {actions.dtype} of shape {actions.shape}")
        return actions.astype(np.int64, copy=False)

    def _reset_index(self, options: dict[str, Any] | None) -> NDArray[np.int64]:
        if not options or "reset_mask" not in options:
            return self._all
        mask = options["reset_mask"]
        if not isinstance(mask, np.ndarray) or mask.shape != (self.num_envs,) or mask.dtype != np.bool_:
            raise ValueError(f"options['reset_mask'] must be a bool array of shape ({self.num_envs},)")
        if not mask.any():
            raise ValueError("options['reset_mask'] must have at least one True value")
        if not self._core.started and not mask.all():
            raise gym.error.ResetNeeded("the first reset() must be of all games")
        return np.flatnonzero(mask)

    def _new_rounds(
        self,
        index: NDArray[np.int64],
        wanted: ResetOptions = _NOTHING_WANTED,
        levels: NDArray[np.int64] | None = None,
    ) -> None:
        self._core.reset(index, wanted.seeds(index, self._generators), levels)
        self._steps[index] = 0
        self._cut[index] = False

    def _infos(self, index: NDArray[np.int64]) -> dict[str, Any]:
        """Gymnasium's layout: an array per key and a mask of the games that have it."""
        present = np.zeros(self.num_envs, dtype=np.bool_)
        present[index] = True
        result: dict[str, Any] = {}
        for key, array in self._core.infos().items():
            if len(index) < self.num_envs:
                array[~present] = None if array.dtype == object else 0
            result[key], result[f"_{key}"] = array, present.copy()
        return result

    def _final(self, ended: NDArray[np.int64]) -> dict[str, Any]:
        """Last observation and info of the games that have just ended."""
        last = self._core.observe()
        final_obs = np.full(self.num_envs, None, dtype=object)
        for i in ended.tolist():
            final_obs[i] = copy.deepcopy(self._core.of_game(last, i))  # of an array that another step may write to
        present = np.zeros(self.num_envs, dtype=np.bool_)
        present[ended] = True
        return {
            "final_obs": final_obs,
            "_final_obs": present,
            "final_info": self._infos(ended),
            "_final_info": present.copy(),
        }
