"""The single-agent Gymnasium environment: a batch of one game."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from ..config import Config
from ..sim.assets import MapSource
from ..sim.situation import Situation
from .game import Game
from .rendering import render_frame
from .setup import RENDER_FPS, Ghosts, check_render_mode
from .spaces import action_space, observation_space

Observation = dict[str, NDArray[Any]]

_ONE = np.zeros(1, dtype=np.int64)


class PacManBotEnv(gym.Env[dict[str, Any], Any]):
    """
    ## Description
    A TurtleBot 4 plays one round of Pac-Man on its SLAM map. Virtual pellets lie on the map, a virtual ghost, Clyde,
    wanders there. At every decision (0.5 s) the agent names the goal that the robot's navigator drives to; physics
    (pymunk, 20 Hz), navigation (a stand-in for Nav2) and localization (AMCL's belief) do the rest. Naming the goal
    already pursued means "go on".

    ## Action Space
    `Discrete(C)`: the index of a candidate goal. Candidates are, in this order,

    | Index | Candidate |
    |---|---|
    | 0 ... P-1 | the pellets, `P = config.max_pellets` or as many as the map has |
    | P ... C-2 | refuges: the home pose, spread-out places, nooks that Clyde cannot come near |
    | C-1 | hold: stop and stay |

    A candidate that the mask forbids (a pellet collected, a goal that waits after Nav2 aborted it, padding) makes
    the robot hold. The mask is `observation["action_mask"]`, `action_masks()` gives it as bool.

    ## Observation Space
    `Dict` of float32 arrays (and the int8 mask). Poses are those the robot believes, not the true ones.

    | Key | Shape | Columns |
    |---|---|---|
    | `robot` | (7,) | x, y (m), cos and sin of the heading, v (m/s), omega (rad/s), age of the pose (s) |
    | `clyde` | (7,) | forward, left (m, robot frame), velocity forward, left (m/s), straight distance (m), closing speed (m/s), his speed in this round (m/s) |
    | `candidates` | (C, 10) | is pellet, is refuge, is hold, is current, forward, left (m, robot frame), straight distance (m), path length from the robot (m), straight distance from Clyde (m), path length from Clyde (m) |
    | `round` | (2,) | time (s), pellets left |
    | `action_mask` | (C,) | 1: may be chosen |

    Lengths are capped at 100 m; rows of forbidden candidates are zero but for their kind.

    ## Rewards
    Per decision, all configurable (`config.reward`): +1 for each pellet collected, -0.002 for the time, -10 when
    Clyde catches the robot, +5 when the round is complete, -5 at the time limit.

    ## Starting State
    The robot stands at the home pose; Clyde stands on a cell drawn uniformly from his cells, at least 1.5 m away
    (`clyde.spawn_distance_m`), by default in the part of the map that connects to the robot's (`clyde.spawn`).

    ## Episode End
    - Termination: the believed pose is within 0.25 m of Clyde (`caught`); every pellet is collected (`complete`);
      no pellet is left but some were lost (`cleared`, only with `execution="as_built"`).
    - Truncation: 600 s (`time_limit_s`).

    ## Information
    `outcome` (`running`, `caught`, `complete`, `cleared`, `timeout`), `collected`, `lost`, `spawned`, `aborts`
    (goals that Nav2 aborted), `round_seed` (drawn from the environment's generator; it names the round in results).

    ## Arguments
    ```python
    gymnasium.make("pacman_env/PacManBot-v0", map="house", preset="robot", execution="robust",
                   settings={"clyde.speed_mps": 0.35}, render_mode="rgb_array")
    ```
    - `map`: a shipped map's name, a map_server YAML file, or an `OccupancyMap`.
    - `preset`: `robot` (measured speed, AMCL's cadence and error, Nav2's delays) or `ideal` (perfect localization).
    - `execution`: `robust`, or `as_built` as the original executor was.
    - `settings`: single fields of the configuration by dotted name; or `config`: a whole `Config`.
    - `home`: x, y, heading of the home pose; by default (0, 0, 0) where the robot can stand there, else the roomiest
      place of the largest part.

    ## Version History
    - v0: first version.
    """  # noqa: E501

    metadata: dict[str, Any] = {"render_modes": ["rgb_array", "human"], "render_fps": RENDER_FPS}  # noqa: RUF012
    action_space: spaces.Discrete | spaces.Box
    observation_space: spaces.Dict

    def __init__(
        self,
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
        render_mode: str | None = None,
    ) -> None:
        """See the class; raises ConfigError or MapError for arguments that cannot be played."""
        check_render_mode(render_mode, self.metadata["render_modes"])
        self._game = Game(
            1,
            map,
            preset,
            execution,
            ghosts=ghosts,
            observation=observation,
            action=action,
            endless=endless,
            start_level=start_level,
            num_levels=num_levels,
            settings=settings,
            config=config,
            home=home,
        )
        self.batch = self._game.batch
        self.config = self._game.config
        self.render_mode = render_mode
        self.observation_space = observation_space(self.batch)
        self.action_space = action_space(self.batch)
        self._window: Any = None

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Start a new episode; its own seed is drawn from the environment's generator."""
        super().reset(seed=seed)
        round_seed = self.np_random.integers(2**63, dtype=np.uint64)
        self._game.reset(_ONE, np.array([round_seed], dtype=np.uint64))
        if self.render_mode == "human":
            self.render()
        return self._observation(), self._info()

    def step(self, action: Any) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Drive towards a candidate, or at given velocities, until the next decision.

        Raises:
            ValueError: the action is no element of the action space (a velocity beyond the limits is cut to them).
            ResetNeeded: before the first reset.
        """
        if not self._game.started:
            raise gym.error.ResetNeeded("call reset() before step()")
        reward, terminated, truncated = self._game.step(self._action(action))
        if self.render_mode == "human":
            self.render()
        return (
            self._observation(),
            float(reward[0]),
            bool(terminated[0]),
            bool(truncated[0]),
            self._info(),
        )

    @property
    def action_masks(self) -> Callable[[], NDArray[np.bool_]]:
        """``action_masks()``: (C,) bool, which candidates may be chosen now; the name that sb3-contrib looks for.

        Raises:
            AttributeError: velocities have no mask.
        """
        if self.config.action != "goal":
            raise AttributeError("velocity actions have no masks")
        return self._masks

    def _masks(self) -> NDArray[np.bool_]:
        return self.situation.mask[0].copy()

    @property
    def situation(self) -> Situation:
        """What a policy of this package sees now: one situation."""
        if not self._game.started:
            raise gym.error.ResetNeeded("call reset() first")
        return self._game.situation

    def render(self) -> NDArray[np.uint8] | None:
        """A picture (720, W, 3) uint8 in mode ``rgb_array``; in mode ``human`` it goes to a window."""
        if self.render_mode is None:
            gym.logger.warn("render() without render_mode: pass render_mode='rgb_array' or 'human' to make()")
            return None
        frame = render_frame(self.batch, 0)
        if self.render_mode == "rgb_array":
            return frame
        if self._window is None:
            from .human_window import HumanWindow

            self._window = HumanWindow()
        self._window.show(frame, RENDER_FPS)
        return None

    def close(self) -> None:
        """Close the window, if there is one."""
        if self._window is not None:
            self._window.close()
            self._window = None

    def __getstate__(self) -> dict[str, Any]:
        """Everything but the window: a copy opens its own."""
        return {**self.__dict__, "_window": None}

    def _action(self, action: Any) -> NDArray[Any]:
        if isinstance(self.action_space, spaces.Box):
            velocities = np.asarray(action)
            if velocities.shape != (2,) or velocities.dtype.kind not in "fiu":
                raise ValueError(f"action {action!r}: must be two numbers, v in m/s and omega in rad/s")
            return velocities.astype(np.float64)[None]
        if not self.action_space.contains(action) and not (
            isinstance(action, np.ndarray) and action.shape == () and self.action_space.contains(action[()])
        ):
            raise ValueError(f"action {action!r} is not in {self.action_space}")
        return np.array([action], dtype=np.int64)

    def _observation(self) -> Observation:
        return {key: array[0] for key, array in self._game.observe().items()}

    def _info(self) -> dict[str, Any]:
        return {key: array.tolist()[0] for key, array in self._game.infos().items()}
