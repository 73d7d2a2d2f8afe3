"""The native vector environment: a batch of many games behind Gymnasium's VectorEnv."""

from __future__ import annotations

from collections.abc import Sequence
from copy import deepcopy
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
from .arguments import EnvArguments, checked_games, takes_env_arguments
from .core import CoreEnv
from .episode_seeds import EpisodeSeeds, one_for_each
from .reset_options import ResetOptions, chosen_games
from .sub_batches import SubBatches

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

    ``num_threads`` share the games (0: one for each core); nothing else depends on it.

    With a ``batch_size`` below the number of games, these are in sub-batches of that size, and while one is stepped
    in the background the network chooses for another, with EnvPool's methods and the same games:

    ```python
    env.async_reset(seed=0)
    while learning:
        observations, rewards, terminated, truncated, info = env.recv()
        env.send(choose(observations), info["env_id"])
    ```

    ``batch``, ``situation`` and ``action_masks()`` are then those of the sub-batch received last.

    ``copy=False``: the arrays of an observation are written anew by the step after the next one, instead of being new
    at each step; whoever keeps one for longer has to copy it.

    The setting ``observation.infos`` ``"ends"`` (``SAME_STEP`` only) saves time: a step returns ``final_info`` of the
    games that ended, no more.
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
        num_threads: int = 1,
        batch_size: int | None = None,
        copy: bool = True,
    ) -> None:
        """See the single environment; raises ConfigError or MapError for arguments that cannot be played."""
        num_envs = checked_games(num_envs)
        steps = max_episode_steps
        if steps is not None and (not isinstance(steps, (int, np.integer)) or isinstance(steps, bool) or steps < 1):
            raise ValueError(f"max_episode_steps = {steps!r}: must be a whole number of at least 1, or None")
        self._most_steps = steps
        self._sub_batches: SubBatches | None = None
        size = num_envs if batch_size is None else batch_size
        if not isinstance(size, (int, np.integer)) or isinstance(size, bool) or size < 1 or num_envs % size:
            raise ValueError(f"batch_size = {batch_size!r}: must be a whole number that divides num_envs = {num_envs}")
        games = int(size)
        self._whole: SubBatches | None = None  # all games as one sub-batch
        more = {"num_threads": num_threads, "copy": copy}
        if games == num_envs:
            self._make_core(games, arguments, **more)
        else:
            given: dict[str, Any] = {"autoreset_mode": autoreset_mode, "max_episode_steps": steps, **more}
            shared = vars(arguments)
            count = num_envs // games
            self._sub_batches = SubBatches([PacManBotVectorEnv(games, **given, **shared) for _ in range(count)])
            self._core, self.render_mode = self._sub_batches.envs[0]._core, arguments.render_mode
        self.num_envs = num_envs
        self.autoreset_mode = AutoresetMode(autoreset_mode)
        self.reports_all = self.config.observation.infos == "all"
        if not self.reports_all and self.autoreset_mode != AutoresetMode.SAME_STEP:
            raise ValueError("observation.infos = 'ends': is for AutoresetMode.SAME_STEP")
        self.metadata = {**self.metadata, "autoreset_mode": self.autoreset_mode}
        self.single_observation_space = self._core.observation_space()
        self.single_action_space = self._core.action_space()
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._seeds = EpisodeSeeds(num_envs)
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
        if self._sub_batches is not None:
            self.async_reset(seed=seed, options=options)
            observations, _, _, _, infos = self._sub_batches.received()
            return observations, infos
        wanted = ResetOptions.of(options, self.num_envs, "reset_mask")
        index = self._reset_index(options)
        levels = wanted.levels(self.batch.source, index)
        generators = self._seeds.generators(seed, index)
        if len(index) == self.num_envs:
            self._play_by(wanted.settings)
        elif wanted.settings:
            raise ValueError("options['settings'] are for all games, which are not all reset")
        self._seeds.take(generators)
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
        if self._sub_batches is not None:
            actions = np.asarray(actions)
            if len(actions.shape) == 0 or len(actions) != self.num_envs:
                raise ValueError(f"actions of shape {actions.shape}: must be of {self.num_envs} games")
            return self._sub_batches.all(actions)
        core = self._core
        over = (self.batch.summary[0] != RUNNING) | self._cut
        reward, terminated, truncated = core.step(self._checked(actions))
        self._cut_long_episodes(terminated, truncated)
        final: dict[str, Any] = {}
        if self.autoreset_mode == AutoresetMode.NEXT_STEP and over.any():
            self._new_rounds(np.flatnonzero(over), in_step=True)
            terminated[over] = truncated[over] = False
            reward[over] = 0.0
        if self.autoreset_mode == AutoresetMode.SAME_STEP:
            ended = np.flatnonzero(terminated | truncated)
            if len(ended):
                final = self._final(ended)
                self._new_rounds(ended, in_step=True)
        infos = {**final, **self._infos(self._all)} if self.reports_all else final
        return core.observe(), reward, terminated, truncated, infos

    def async_reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> None:
        """Begin new rounds in all sub-batches; :meth:`recv` gives their first observations, with rewards of 0.

        Args:
            seed: as in :meth:`reset`.
            options: ``settings``, or one ``round_seed`` or ``level`` for all games.

        Raises:
            ValueError: the options hold ``reset_mask``.
        """
        if options and "reset_mask" in options:
            raise ValueError("options['reset_mask']: all sub-batches are reset")
        self._in_sub_batches().reset(one_for_each(seed, self.num_envs), options)

    def send(self, actions: NDArray[Any], env_id: NDArray[np.int64] | None = None) -> None:
        """Step a sub-batch in the background: that with the games ``env_id``, by default the one received last.

        Raises:
            ValueError: an action is none, or the sub-batch is being stepped; nothing is stepped then.
            ResetNeeded: before :meth:`async_reset`.
        """
        self._in_sub_batches().send(actions, env_id)

    def recv(self) -> tuple[Observation, NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]:
        """What :meth:`step` returns, of the sub-batch that was sent first; ``info["env_id"]`` numbers its games.

        Raises:
            ValueError: nothing was sent.
        """
        sub_batches = self._in_sub_batches()
        result = sub_batches.receive()
        self._core = sub_batches.envs[sub_batches.last]._core
        return result

    def _in_sub_batches(self) -> SubBatches:
        if self._sub_batches is not None:
            return self._sub_batches
        if self._whole is None:
            self._whole = SubBatches([self])
        return self._whole

    def _cut_long_episodes(self, terminated: NDArray[np.bool_], truncated: NDArray[np.bool_]) -> None:
        """What Gymnasium's ``TimeLimit`` does for one environment."""
        self._steps += 1
        if self._most_steps is not None:
            long = self._steps >= self._most_steps
            self._cut = long & ~terminated & ~truncated
            truncated |= long

    def render(self) -> tuple[NDArray[np.uint8], ...] | None:
        """One picture per game."""
        envs = [self] if self._sub_batches is None else self._sub_batches.envs
        return self._pictures([env._core for env in envs])

    def check(self, actions: NDArray[Any]) -> NDArray[Any]:
        """Actions as the games take them.

        Raises:
            ValueError: their shape, dtype or, of candidates, range is another.
        """
        actions = self._checked(actions)
        if isinstance(self.single_action_space, spaces.Discrete):
            most = int(self.single_action_space.n) - 1
            for game in np.flatnonzero((actions < 0) | (actions > most))[:1].tolist():
                raise ValueError(f"choice {actions[game]} of game {game}: candidates are 0 to {most}")
        return actions

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
        index = chosen_games(options["reset_mask"], self.num_envs, "options['reset_mask']")
        if not self._core.started and len(index) < self.num_envs:
            raise gym.error.ResetNeeded("the first reset() must be of all games")
        return index

    def _new_rounds(
        self,
        index: NDArray[np.int64],
        wanted: ResetOptions = _NOTHING_WANTED,
        levels: NDArray[np.int64] | None = None,
        in_step: bool = False,
    ) -> None:
        self._core.reset(index, self._seeds.of(index, wanted, self.batch), levels, in_step=in_step)
        self._steps[index] = 0
        self._cut[index] = False

    def close_extras(self, **_: Any) -> None:
        """Wait for sub-batches that are being stepped."""
        for sub_batches in (self._sub_batches, self._whole):
            if sub_batches is not None:
                sub_batches.close()

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
        if not self.reports_all:
            return {"final_info": self._infos(ended)}
        last = self._core.observe()
        final_obs = np.full(self.num_envs, None, dtype=object)
        for i in ended.tolist():
            final_obs[i] = deepcopy(self._core.of_game(last, i))  # of an array that another step may write to
        present = np.zeros(self.num_envs, dtype=np.bool_)
        present[ended] = True
        return {
            "final_obs": final_obs,
            "_final_obs": present,
            "final_info": self._infos(ended),
            "_final_info": present.copy(),
        }
