"""The native vector environment as a Stable-Baselines3 ``VecEnv``, and its models as policies (extra ``train``)."""

import io
import os
import time
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import torch
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.policies import BasePolicy
from stable_baselines3.common.vec_env import VecCheckNan, VecEnv, VecEnvWrapper, VecMonitor, VecNormalize
from stable_baselines3.common.vec_env.base_vec_env import VecEnvIndices

from ._version import __version__
from .config import Config
from .config.validation import require
from .envs.arguments import check_render_mode
from .envs.guard import Guarded, exclusive
from .envs.pacmanbot_vector import PacManBotVectorEnv
from .envs.resets import Seed, checked_seed
from .files import commit, prepare, replaced
from .observations.planner_features import VERSION
from .observations.robot_features import Observation
from .policies.flat import GROUPS, KEY, FlatMetadata, FlatPolicy
from .policies.metadata import dump

__all__ = ["PacManBotVecEnv", "export"]

_FINAL = ("final_obs", "final_info")
_METHODS = ("action_masks", "render")  # methods that a single environment also has
_SPACES = {"observation_space": "single_observation_space", "action_space": "single_action_space"}


class PacManBotVecEnv(Guarded, VecEnv):
    """Many games at once for Stable-Baselines3 and sb3-contrib.

    ```python
    env = PacManBotVecEnv(8, flat=True, map="generated", settings={"clyde.speed_mps": 0.35})
    model = sb3_contrib.MaskablePPO("MlpPolicy", env)
    ```

    Equals ``DummyVecEnv`` of single environments in ``Monitor``, step by step. ``infos[i]`` contains the single
    environment's info and ``TimeLimit.truncated``. At the end of an episode it also contains ``terminal_observation``
    and ``episode``: ``r`` (sum of rewards), ``l`` (decisions), ``t`` (s since this object was created); set ``monitor``
    to False to use SB3's ``VecMonitor`` instead. Attributes are shared by all games and can only be set for all.

    Use one environment per thread; calls from another thread wait or are refused as in ``PacManBotVectorEnv``.

    With ``observation.infos="ends"``, which saves time, ``infos[i]`` is empty except at the end of an episode, and
    ``terminal_observation`` is missing.
    """

    def __init__(self, env: PacManBotVectorEnv | int = 64, *, monitor: bool = True, **arguments: Any) -> None:
        """Wrap a vector environment, or create one of ``env`` games with the arguments of ``PacManBotVectorEnv``.

        Raises TypeError if ``env`` has another type, or if arguments are given with an existing environment. Raises
        ValueError if the autoreset mode is not ``SAME_STEP`` or an argument is invalid.
        """
        if isinstance(env, (int, np.integer)) and not isinstance(env, bool):
            env = PacManBotVectorEnv(int(env), **{"autoreset_mode": AutoresetMode.SAME_STEP, **arguments})
        elif not isinstance(env, PacManBotVectorEnv):
            raise TypeError(f"env = {env!r}: must be a number of games or a PacManBotVectorEnv")
        elif arguments:
            raise TypeError(f"{sorted(arguments)} must not be given with an existing environment")
        if env.autoreset_mode != AutoresetMode.SAME_STEP:
            raise ValueError(f"autoreset_mode = {env.autoreset_mode}: Stable-Baselines3 needs AutoresetMode.SAME_STEP")
        self.env = env
        super().__init__(env.num_envs, env.single_observation_space, env.single_action_space)
        self._monitor = monitor
        self._start = time.time()
        self._returns = np.zeros(self.num_envs)
        self._lengths = np.zeros(self.num_envs, dtype=np.int64)
        self._actions: Any = None

    def seed(self, seed: Seed = None) -> Sequence[int | None]:
        """Set the seeds of the next reset, ``seed + i`` for game i; raises ValueError for an invalid seed."""
        return super().seed(checked_seed(seed))

    @exclusive
    def reset(self) -> Observation:
        """Start new rounds in all games with the seeds and options of ``seed`` and ``set_options``.

        Raises ValueError if the options differ between games or select some games only.
        """
        options = self._options[0]
        if any(other != options for other in self._options) or "reset_mask" in options:
            raise ValueError("options must be the same for all games, and all games are reset")
        observations, infos = self.env.reset(seed=self._seeds, options=options or None)
        self._reset_seeds()
        self._reset_options()
        self._returns[:] = 0.0
        self._lengths[:] = 0
        self.reset_infos = _rows(infos)
        return observations

    def step_async(self, actions: NDArray[Any]) -> None:
        """Store the actions for ``step_wait``."""
        self._actions = actions

    @exclusive
    def step_wait(self) -> Any:
        """Play one decision in every game; after the end of a round, return the first observation of the next one.

        Rewards and dones are (N,). Raises ValueError for invalid actions, and ResetNeeded before the first reset.
        """
        return self._play(self._actions)

    @exclusive
    def step(self, actions: NDArray[Any]) -> Any:
        """Play one decision; unlike ``step_async`` and ``step_wait``, it cannot be interrupted by another thread."""
        return self._play(actions)

    def _play(self, actions: Any) -> tuple[Observation, NDArray[np.float32], NDArray[np.bool_], list[dict[str, Any]]]:
        observations, rewards, terminated, truncated, infos = self.env.step(actions)
        dones = terminated | truncated
        self._returns += rewards
        self._lengths += 1
        cut = truncated & ~terminated
        rows = _rows(infos, **{"TimeLimit.truncated": cut}) if self.env.reports_all else [{} for _ in dones]
        if dones.any():
            self._end_episodes(np.flatnonzero(dones).tolist(), rows, infos, cut)
        return observations, rewards.astype(np.float32), dones, rows

    def _end_episodes(
        self, ended: list[int], rows: list[dict[str, Any]], infos: dict[str, Any], cut: NDArray[np.bool_]
    ) -> None:
        """Put the last info of each game in ``ended`` in place of its new round's first info, and reset its sums.

        ``rows`` are the infos of all games, ``infos`` the infos of the vector environment, and ``cut`` (N,) the
        truncations. The first infos are stored in ``reset_infos``.
        """
        final = _rows(infos["final_info"], **{"TimeLimit.truncated": cut})
        elapsed = round(time.time() - self._start, 6)
        for i in ended:
            row = rows[i]
            self.reset_infos[i] = {key: row[key] for key in row if key != "TimeLimit.truncated"}
            row.update(final[i])
            if self.env.reports_all:
                row["terminal_observation"] = infos["final_obs"][i]
            if self._monitor:
                row["episode"] = {"r": round(float(self._returns[i]), 6), "l": int(self._lengths[i]), "t": elapsed}
        self._returns[ended] = 0.0
        self._lengths[ended] = 0

    @exclusive
    def close(self) -> None:
        """Close the vector environment."""
        self.env.close()

    def get_images(self) -> Sequence[NDArray[np.uint8] | None]:
        """Return one picture (H, W, 3) per game, or None, with a warning, if ``render_mode`` is None."""
        if self.env.render_mode is None:
            warnings.warn("the render mode is None, pass render_mode='rgb_array' to get pictures", stacklevel=2)
        return self._of_games("render")

    def get_attr(self, attr_name: str, indices: VecEnvIndices = None) -> list[Any]:
        """Return the values that an attribute would have in single environments; raises AttributeError if unknown."""
        chosen = self._indices(indices)
        if attr_name in _METHODS:
            getattr(self.env, attr_name)  # velocity actions have no masks
            return [lambda i=i: self._of_games(attr_name)[i] for i in chosen]
        value = getattr(self.env, _SPACES.get(attr_name, attr_name))
        if attr_name == "situation":
            return [value.rows(np.array([i])) for i in chosen]
        return [value] * len(chosen)

    def set_attr(self, attr_name: str, value: Any, indices: VecEnvIndices = None) -> None:
        """Set an attribute for all games; raises ValueError for a selection of games or an unknown render mode."""
        if set(self._indices(indices)) != set(range(self.num_envs)):
            raise ValueError(f"{attr_name}: must be set for all games, which share it")
        if attr_name == "render_mode":
            check_render_mode(value, self.env.metadata["render_modes"])
            self.render_mode = value
            self.metadata = {"render_modes": ["human", value] if value else []}
        setattr(self.env, _SPACES.get(attr_name, attr_name), value)

    def env_method(
        self, method_name: str, *method_args: Any, indices: VecEnvIndices = None, **method_kwargs: Any
    ) -> list[Any]:
        """Call ``action_masks`` or ``render`` for games; raises AttributeError for another method."""
        if method_name not in _METHODS:
            raise AttributeError(f"games of a batch have no method {method_name!r}, only {sorted(_METHODS)}")
        results = self._of_games(method_name, *method_args, **method_kwargs)
        return [results[i] for i in self._indices(indices)]

    def env_is_wrapped(self, wrapper_class: type, indices: VecEnvIndices = None) -> list[bool]:
        """Return for each game True if ``wrapper_class`` is ``Monitor`` and this class does the work of ``Monitor``."""
        return [self._monitor and wrapper_class is Monitor] * len(self._indices(indices))

    def _of_games(self, method: str, *arguments: Any, **named: Any) -> Sequence[Any]:
        results = getattr(self.env, method)(*arguments, **named)
        return [None] * self.num_envs if results is None else results

    def _indices(self, indices: VecEnvIndices) -> list[int]:
        chosen = np.arange(self.num_envs)
        return (chosen if indices is None else chosen[np.atleast_1d(np.asarray(indices, dtype=np.int64))]).tolist()


def _rows(infos: dict[str, Any], **more: NDArray[Any]) -> list[dict[str, Any]]:
    """Convert Gymnasium's info arrays, and ``more`` arrays by name, to one dict of Python numbers per game.

    Masks (``_key``) and final values are left out.
    """
    columns = {key: value for key, value in infos.items() if key[0] != "_" and key not in _FINAL} | more
    names = tuple(columns)
    values = [list(v) if v.ndim > 1 else v.tolist() for v in columns.values()]
    return [dict(zip(names, row, strict=True)) for row in zip(*values, strict=True)]


#: Policies that can be exported; their subclasses, such as recurrent ones, compute something else.
_POLICIES = {"ActorCriticPolicy", "MaskableActorCriticPolicy", "DQNPolicy"}
_KINDS = {"planner", "features", "power", "bearings"}  # kinds that are computed from a situation alone
_TOLERANCE = 1e-4  # largest difference between the scores of torch and of the file


class _Scores(torch.nn.Module):
    """The scores (1, A) of a policy's actions for an observation (1, F) that ``normalizers`` have not seen."""

    def __init__(self, policy: BasePolicy, normalizers: Sequence[VecNormalize]) -> None:
        super().__init__()
        self.policy, self._normalizers = policy, normalizers

    def forward(self, observation: torch.Tensor) -> torch.Tensor:
        one: Any
        for one in self._normalizers:
            numbers = one.obs_rms.mean, np.sqrt(one.obs_rms.var + one.epsilon)
            mean, divisor = (torch.from_numpy(array).to(observation.device) for array in numbers)
            observation = ((observation.double() - mean) / divisor).clamp(-one.clip_obs, one.clip_obs).float()
        policy: Any = self.policy
        if hasattr(policy, "q_net"):
            return policy.q_net(observation)
        features = BasePolicy.extract_features(policy, observation, policy.pi_features_extractor)
        return policy.action_net(policy.mlp_extractor.forward_actor(features))


def export(model: BaseAlgorithm, path: str | os.PathLike[str]) -> None:
    """Write the policy of a model as an ONNX file, which every command plays: ``export(model, "model.onnx")``.

    The model is PPO, A2C, MaskablePPO or DQN with ``MlpPolicy``, trained with ``flat=True`` or on an id
    ``PacManBotFlat...`` with goals. The file contains the statistics of ``VecNormalize``. Its policy chooses the best
    allowed action, also for models that know no mask.

    Raises ValueError for another model, and keeps an old file, if the results of the new one differ from torch's.
    """
    import onnx

    path = Path(path)
    require(path.suffix.lower() == ".onnx", "path", str(path), "must end in .onnx")
    config, normalizers = _observed_by(model)
    name = type(model.policy).__name__
    require(name in _POLICIES, "policy", name, f"must be one of {', '.join(sorted(_POLICIES))}: 'MlpPolicy'")
    network, file = _Scores(model.policy, normalizers).eval(), io.BytesIO()
    (size,) = model.observation_space.shape or ()
    inputs = np.random.default_rng(0).uniform(-1, 1, (64, size)).astype(np.float32)
    rows = torch.from_numpy(inputs).to(model.device).split(1)
    with warnings.catch_warnings(action="ignore"), torch.no_grad():
        names: Any = {"input_names": ["observation"], "output_names": ["scores"]}
        torch.onnx.export(network, rows[0], file, dynamo=False, opset_version=17, **names)
        expected = torch.cat([network(row) for row in rows]).cpu().numpy()
    graph = onnx.load_from_string(file.getvalue())
    settings = {field: value for field, value in config.as_settings().items() if field.startswith(GROUPS)}
    about = FlatMetadata(1, VERSION, settings, __version__, commit())
    onnx.helper.set_model_props(graph, {KEY: dump(about, path)})
    with replaced(prepare(path)) as new:
        new.write_bytes(graph.SerializeToString())
        worst = np.abs(FlatPolicy(new).run(inputs) - expected).max()
        require(worst <= _TOLERANCE, "difference", worst, f"scores of file and torch differ, must be {_TOLERANCE}")


def _observed_by(model: BaseAlgorithm) -> tuple[Config, list[VecNormalize]]:
    """Return the configuration of a model's games, and what normalizes their observations, the innermost first.

    Raises ConfigError unless the model observes a flat environment and chooses goals.
    """
    env: Any = model.get_env()
    normalizers: list[VecNormalize] = []
    while isinstance(env, VecEnvWrapper):
        known = (VecNormalize, VecMonitor, VecCheckNan)
        require(isinstance(env, known), "env", type(env).__name__, "must not be wrapped, except in VecNormalize")
        normalizers[:0] = [env] if isinstance(env, VecNormalize) and env.norm_obs else []
        env = env.venv
    try:
        config = env.get_attr("config")[0]
        changed = any(map(any, map(env.env_is_wrapped, (gym.ObservationWrapper, gym.ActionWrapper))))
    except AttributeError:
        raise ValueError("env: must be an environment of pacman_env; give env=... to the model's load()") from None
    require(not changed, "env", "wrapped", "must have no ObservationWrapper or ActionWrapper")
    for field, value in (("action", "goal"), ("observation.flat", True), ("observation.candidates", "nearest")):
        require(config.value(field) == value, field, config.value(field), f"must be {value!r}, as in PacManBotFlat")
    kinds, space = config.observation.kinds, model.observation_space
    require(_KINDS.issuperset(kinds), "observation.kinds", kinds, f"must be among {', '.join(sorted(_KINDS))}")
    one_array = isinstance(space, gym.spaces.Box) and len(space.shape) == 1
    require(one_array, "observation_space", space, "must be one array (observation.mask='method')")
    return config, normalizers
