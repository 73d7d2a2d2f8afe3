"""Native vector environment: a batch of games with the interface of Gymnasium's VectorEnv."""

from copy import deepcopy
from typing import Any

import numpy as np
from gymnasium import spaces
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from ..game.execution import RUNNING
from ..policies.base import Flags
from ..render.window import RENDER_FPS
from ..sim.core.batch import check_velocities
from ..sim.observation.robot_features import Observation
from .arguments import EnvArguments, checked_games, is_count, takes_env_arguments
from .resets import ManyGames, Options, Seeds
from .sub_batches import Step, SubBatches


class PacManBotVectorEnv(ManyGames, VectorEnv[Observation, NDArray[Any], NDArray[Any]]):
    """Many games of :class:`~pacman_env.envs.pacmanbot.PacManBotEnv` at once.

    All games share one map, or with ``map="generated"`` each has its own house.

    ```python
    gymnasium.make_vec("pacman_env/PacManBot-v1", num_envs=64, vectorization_mode="vector_entry_point")
    ```

    Spaces, rewards and arguments are as in the single environment, with arrays (N,) and (N, ...). Game i with seed s
    equals a single environment with seed s, bit for bit. ``autoreset_mode`` is one of Gymnasium's three; with
    ``DISABLED`` pass ``options={"reset_mask": mask}`` to ``reset``. Episodes are truncated after ``max_episode_steps``
    decisions. ``num_threads`` threads play the games (0: one per runner); the results do not depend on it.

    A ``batch_size`` below the number of games divides the games into sub-batches of this size. While one is stepped in
    the background the network chooses for another, with EnvPool's methods (``async_reset``, ``recv``, ``send``) and the
    same games. Each sub-batch has its own copies of ghost policies that are given as objects. ``batch``, ``situation``
    and ``action_masks()`` then refer to the sub-batch received last; after ``reset`` and ``step`` the masks cover all
    games.

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
        batch_size: int | None = None,
        copy: bool = True,
    ) -> None:
        """Create the games; raises ConfigError, MapError or ValueError for arguments that cannot be played."""
        self.num_envs = num_envs = checked_games(num_envs)
        steps, size = max_episode_steps, num_envs if batch_size is None else batch_size
        if steps is not None and not is_count(steps):
            raise ValueError(f"max_episode_steps = {steps!r}: must be a whole number of at least 1, or None")
        if not is_count(size) or num_envs % size:
            raise ValueError(f"batch_size = {batch_size!r}: must be a whole number that divides num_envs = {num_envs}")
        self._sub_batches: SubBatches | None = None
        self._whole: SubBatches | None = None  # all games as one sub-batch, for the asynchronous methods
        more: dict[str, Any] = {"num_threads": num_threads, "copy": copy, "max_episode_steps": steps}
        if size == num_envs:
            self._make_runner(num_envs, arguments, **more)
        else:
            more |= {"autoreset_mode": autoreset_mode, **vars(arguments)}
            ghosts = [deepcopy(arguments.ghosts) for _ in range(num_envs // size)]  # policies keep state by game number
            self._sub_batches = SubBatches([PacManBotVectorEnv(int(size), **{**more, "ghosts": one}) for one in ghosts])
            self._runner, self.render_mode = self._sub_batches.envs[0]._runner, arguments.render_mode
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

    def reset(self, *, seed: Seeds = None, options: Options = None) -> tuple[Observation, dict[str, Any]]:
        """Start new rounds in all games, or in the games of ``options["reset_mask"]``, bool (N,).

        ``seed`` is one seed s (game i gets s + i), one seed per game, or None (the generators continue). Other options
        are as in the single environment: ``round_seed`` and ``level``, one value for all games or one per game, and
        ``settings`` for all games until the next reset of all. Raises ValueError for invalid arguments, and ResetNeeded
        if the first reset does not include all games. A running step is awaited and dropped.
        """
        if self._sub_batches is not None:
            self.async_reset(seed=seed, options=options)
            observations, _, _, _, infos = self._receive_all()
            return observations, infos
        if self._whole is not None:
            self._whole.close()
        mask = None
        if isinstance(options, dict) and "reset_mask" in options:
            mask = () if options["reset_mask"] is None else options["reset_mask"]
        index = self._reset_games(seed, options, mask, "options['reset_mask']", "reset_mask")
        return self._runner.observe(), self._infos(index)

    def step(self, actions: NDArray[Any]) -> Step:
        """Play one decision in every game, actions (N,) or (N, 2); return observations, rewards, ends and infos.

        Rewards, terminated and truncated are (N,). Raises ValueError for actions outside the space or while a sent step
        has not been received, and ResetNeeded before the first reset.
        """
        if self._sub_batches is not None:
            actions = np.asarray(actions)
            if len(actions.shape) == 0 or len(actions) != self.num_envs:
                raise ValueError(f"actions of shape {actions.shape}: must be of {self.num_envs} games")
            self._sub_batches.send_all(actions)
            return self._receive_all()
        if self._whole is not None:
            self._whole.require_received()
        return self._step_games(self.check(actions))

    def _step_games(self, actions: NDArray[Any]) -> Step:
        runner = self._runner
        over = (self.batch.summary[0] != RUNNING) | runner.cut
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
        return runner.observe(), reward, terminated, truncated, infos

    def async_reset(self, *, seed: Seeds = None, options: Options = None) -> None:
        """Start new rounds in all sub-batches; :meth:`recv` returns their first observations, with rewards of 0.

        ``seed`` and ``options`` are as in :meth:`reset`. Raises ValueError, without any change, for invalid
        arguments or a ``reset_mask``.
        """
        if options and "reset_mask" in options:
            raise ValueError("options['reset_mask']: all sub-batches are reset")
        self._in_sub_batches().reset(seed, options)
        self._show_last()

    def send(self, actions: NDArray[Any], env_id: NDArray[np.int64] | None = None) -> None:
        """Step a sub-batch in the background: the one with the games ``env_id``, by default the one received last.

        Raises, without any step, ValueError for an invalid action or a sub-batch that is still being stepped, and
        ResetNeeded before :meth:`async_reset`.
        """
        self._in_sub_batches().send(actions, env_id)

    def recv(self) -> Step:
        """Return the result of :meth:`step` for the sub-batch sent first, with its games in ``info["env_id"]``.

        Raises ValueError if no step was sent.
        """
        result = self._in_sub_batches().receive()
        self._show_last()
        return result

    def _receive_all(self) -> Step:
        assert self._sub_batches is not None
        result = self._sub_batches.received()
        self._show_last()
        return result

    def _show_last(self) -> None:
        """Let the properties of this environment refer to the sub-batch received last."""
        if self._sub_batches is not None:
            self._runner = self._sub_batches.envs[self._sub_batches.last]._runner

    def _masks(self) -> Flags:
        if self._sub_batches is None or not self._sub_batches.received_all:
            return self._runner.masks()
        return np.concatenate([env._runner.masks() for env in self._sub_batches.envs])

    def _in_sub_batches(self) -> SubBatches:
        if self._sub_batches is not None:
            return self._sub_batches
        if self._whole is None:
            self._whole = SubBatches([self])
        return self._whole

    def render(self) -> tuple[NDArray[np.uint8], ...] | None:
        """Return one picture (H, W, 3) per game, or None without a render mode."""
        envs = [self] if self._sub_batches is None else self._sub_batches.envs
        return self._pictures([env._runner for env in envs])

    def check(self, actions: NDArray[Any]) -> NDArray[Any]:
        """Convert actions to int64 (N,) or float64 (N, 2); raises ValueError for an invalid shape, dtype or value."""
        actions = np.asarray(actions)
        if self.config.action == "velocity":
            if actions.shape != (self.num_envs, 2) or actions.dtype.kind not in "fiu":
                raise ValueError(f"actions must be {self.num_envs} pairs of v and omega, {_got(actions)}")
            check_velocities(actions)
            return actions.astype(np.float64)
        if actions.shape != (self.num_envs,) or actions.dtype.kind not in "iu":
            raise ValueError(f"actions must be {self.num_envs} integers, {_got(actions)}")
        if actions.min() < 0 or actions.max() >= self._runner.candidates:
            game = int(np.flatnonzero((actions < 0) | (actions >= self._runner.candidates))[0])
            raise ValueError(
                f"choice {actions[game]} of game {game}: candidates are 0 to {self._runner.candidates - 1}"
            )
        return actions.astype(np.int64, copy=False)

    def close_extras(self, **_: Any) -> None:
        """Wait for sub-batches that are still being stepped."""
        for sub_batches in (self._sub_batches, self._whole):
            if sub_batches is not None:
                sub_batches.close()

    def _infos(self, index: NDArray[np.int64] | None = None) -> dict[str, Any]:
        """Return infos in Gymnasium's layout: an array per key, and a mask of the games ``index`` (None: all)."""
        present = np.ones(self.num_envs, dtype=np.bool_) if index is None else self._mask(index)
        result: dict[str, Any] = {}
        for key, array in self._runner.infos().items():
            if index is not None:
                array[~present] = None if array.dtype == object else 0
            result[key], result[f"_{key}"] = array, present.copy()
        return result

    def _final(self, ended: NDArray[np.int64]) -> dict[str, Any]:
        """Return the last observations and infos of games that have just ended."""
        if not self.reports_all:
            return {"final_info": self._infos(ended)}
        final = {"final_obs": self._last_of(ended, self._runner.observe(copy=False)), "final_info": self._infos(ended)}
        return final | {f"_{name}": self._mask(ended) for name in final}


def _got(actions: NDArray[Any]) -> str:
    return f"got {actions.dtype} of shape {actions.shape}"
