"""Native vector environment: a batch of games with the interface of Gymnasium's VectorEnv."""

from typing import Any

import numpy as np
from gymnasium import spaces
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from ..game.ends import RUNNING
from ..observations.robot_features import Observation
from ..render.window import RENDER_FPS
from .arguments import EnvArguments, takes_env_arguments
from .guard import exclusive, shared
from .resets import ManyGames, Options, Seeds, whole_number
from .rewards import Step
from .spaces import checked_actions


class PacManBotVectorEnv(ManyGames, VectorEnv[Observation, NDArray[Any], NDArray[Any]]):
    """Many games of :class:`~pacman_env.envs.pacmanbot.PacManBotEnv` at once.

    All games share one map, or with ``map="generated"`` each has its own house.

    ```python
    gymnasium.make_vec("pacman_env/PacManBot-v2", num_envs=64, vectorization_mode="vector_entry_point")
    ```

    Spaces, rewards and arguments are as in the single environment, with arrays (N,) and (N, ...). Game i with seed s
    equals a single environment with seed s, bit for bit. ``autoreset_mode`` is one of Gymnasium's three; with
    ``DISABLED`` pass ``options={"reset_mask": mask}`` to ``reset``. Episodes are truncated after ``max_episode_steps``
    decisions. ``num_threads`` threads play the games (0: one per core); the results do not depend on it.

    Use one environment per thread; calls from another thread wait or are refused as in the single environment.

    With ``copy=False`` the step after the next one overwrites the arrays of an observation; copy them to keep them.

    The setting ``observation.infos`` ``"ends"`` (``SAME_STEP`` only) saves time: infos contain only the ``final_info``
    of games that ended.
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
        copy: bool = True,
    ) -> None:
        """Create the games; raises ConfigError, MapError or ValueError for arguments that cannot be played."""
        self.num_envs = num_envs = whole_number(num_envs, "num_envs", 1)
        if max_episode_steps is not None:
            whole_number(max_episode_steps, "max_episode_steps", 1, more=", or None")
        more: dict[str, Any] = {"num_threads": num_threads, "copy": copy, "max_episode_steps": max_episode_steps}
        self._make_runner(num_envs, arguments, **more)
        self.autoreset_mode = AutoresetMode(autoreset_mode)
        self.reports_all = self.config.observation.infos == "all"
        if not self.reports_all and self.autoreset_mode != AutoresetMode.SAME_STEP:
            raise ValueError("observation.infos = 'ends': is for AutoresetMode.SAME_STEP")
        self.metadata = {**self.metadata, "autoreset_mode": self.autoreset_mode}
        self.single_observation_space = self._runner.observation_space
        self.single_action_space = self._runner.action_space
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._make_generators()

    @exclusive
    def reset(self, *, seed: Seeds = None, options: Options = None) -> tuple[Observation, dict[str, Any]]:
        """Start new rounds in all games, or in the games of ``options["reset_mask"]``, bool (N,).

        ``seed`` is one seed s (game i gets s + i), one seed per game, or None (the generators continue). Other options
        are as in the single environment: ``round_seed`` and ``level``, one value for all games or one per game, and
        ``settings`` for all games until the next reset of all. Raises ValueError for invalid arguments, and ResetNeeded
        if the first reset does not include all games.
        """
        mask = None
        if isinstance(options, dict) and "reset_mask" in options:
            mask = () if options["reset_mask"] is None else options["reset_mask"]
        index = self._reset_games(seed, options, mask, "options['reset_mask']", ("reset_mask",))
        return self._runner.observation(), self._infos(index)

    @exclusive
    def step(self, actions: NDArray[Any]) -> Step:
        """Play one decision in every game, actions (N,) or (N, 2); return observations, rewards, ends and infos.

        Rewards, terminated and truncated are (N,). Raises ValueError for actions outside the space, and ResetNeeded
        before the first reset.
        """
        runner, actions = self._runner, checked_actions(self.single_action_space, actions, self.num_envs)
        runner.require_reset()
        over = (self.batch.summary[0] != RUNNING) | runner.rewards.cut
        reward, terminated, truncated = runner.step(actions)
        final: dict[str, Any] = {}
        if self.autoreset_mode == AutoresetMode.NEXT_STEP and over.any():
            self._follow(np.flatnonzero(over))
            terminated[over] = truncated[over] = False
            reward[over] = 0.0
        if self.autoreset_mode == AutoresetMode.SAME_STEP:
            ended = np.flatnonzero(terminated | truncated)
            if len(ended):
                final = self._final(ended)
                self._follow(ended)
        infos = {**final, **self._infos()} if self.reports_all else final
        return runner.observation(), reward, terminated, truncated, infos

    close = exclusive(VectorEnv.close)

    @shared
    def render(self) -> tuple[NDArray[np.uint8], ...] | None:
        """Return one picture (H, W, 3) per game, or None without a render mode."""
        return self._pictures()

    def _infos(self, index: NDArray[np.int64] | None = None) -> dict[str, Any]:
        """Return infos in Gymnasium's layout: an array (N,) per key, and a mask of the games ``index`` (None: all)."""
        present = np.ones(self.num_envs, dtype=np.bool_) if index is None else self._mask(index)
        result: dict[str, Any] = {}
        for key, array in self._runner.infos.of_all(self._runner.observer.allowed).items():
            if index is not None:
                array[~present] = None if array.dtype == object else 0
            result[key], result[f"_{key}"] = array, present.copy()
        return result

    def _final(self, ended: NDArray[np.int64]) -> dict[str, Any]:
        """Return the last observations and infos of games that have just ended."""
        if not self.reports_all:
            return {"final_info": self._infos(ended)}
        final = {
            "final_obs": self._last_of(ended, self._runner.observation(copy=False)),
            "final_info": self._infos(ended),
        }
        return final | {f"_{name}": self._mask(ended) for name in final}
