"""The single-agent Gymnasium environment: a batch of one game."""

from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from ..render.window import RENDER_FPS, Display
from ..sim.observation.robot_features import Observation
from .arguments import EnvArguments, takes_env_arguments
from .base_env import CoreEnv
from .resets import Options, ResetOptions
from .spaces import checked_action

_ONE = np.zeros(1, dtype=np.int64)


class PacManBotEnv(CoreEnv, Display, gym.Env[Any, Any]):
    """
    ## Description
    A TurtleBot 4 plays one round of Pac-Man on its SLAM map. Virtual pellets lie on the map, a virtual ghost, Clyde,
    wanders there. At every decision (0.5 s) the agent names the goal that the robot's navigator drives to; physics
    (pymunk, 20 Hz), navigation (a stand-in for Nav2) and localization (AMCL's belief) do the rest. Naming the goal
    already pursued continues it. There can be up to four ghosts, other kinds of observation and action, rounds
    without end, and another house for every episode: see the arguments. `docs/environments/pacmanbot.md` has examples.

    ## Action Space
    `Discrete(C)`: the index of a candidate goal. Candidates are, in this order,

    | Index | Candidate |
    |---|---|
    | 0 ... P-1 | the pellets, `P = config.max_pellets` or as many as the map has |
    | P ... C-2 | refuges: the home pose, spread-out places, nooks that Clyde cannot come near |
    | C-1 | hold: stop and stay |

    A candidate that the mask forbids (a pellet collected, a goal that waits after Nav2 aborted it, padding) makes
    the robot hold. The mask is `observation["action_mask"]`, `action_masks()` gives it as bool.

    With `action="velocity"` it is `Box(2,)` of float32 instead: v from 0 to 0.306 m/s (`robot.wheel_speed_mps`) and
    omega from -1.9 to 1.9 rad/s, counter-clockwise, held until the next decision; Nav2 has no part in it. Velocities
    beyond the limits are cut to them, and v to what the wheels have left: turning keeps its share. There is no mask.
    With the setting `action_range` `"unit"` both are -1 to 1, as most learners expect: v is 0 at -1 and 0.306 m/s at 1, omega is
    -1.9 rad/s at -1 and 1.9 rad/s at 1, both linear in between.

    ## Observation Space
    `Dict` of float32 arrays (the mask is int8, the grid uint8). Poses are those the robot believes, not the true ones.

    | Key | Shape | Columns |
    |---|---|---|
    | `robot` | (7,) | x, y (m), cos and sin of the heading, v (m/s), omega (rad/s), age of the pose (s) |
    | `clyde` | (7,) | forward, left (m, robot frame), velocity forward, left (m/s), straight distance (m), closing speed (m/s), its speed in this round (m/s) |
    | `candidates` | (C, 10) | is pellet, is refuge, is hold, is current, forward, left (m, robot frame), straight distance (m), path length from the robot (m), straight distance from Clyde (m), path length from Clyde (m) |
    | `round` | (2,) | time (s), pellets left |
    | `ghosts` | (G, 6) | with several ghosts, of each: forward, left (m, robot frame), velocity forward, left (m/s), straight distance (m), its speed in this round (m/s) |
    | `action_mask` | (C,) | 1: may be chosen; not with velocities |
    | `scan` | (R,) | with `observation="scan"`: the lidar's ranges (m), ray 0 ahead, the others counter-clockwise |
    | `pellet_bearings` | (K, 7) | with a scan and with velocities, of each of the nearest pellets by path length: is pellet, cos and sin of the bearing, straight distance (m), path length from the robot (m), cos and sin of the way |
    | `ghost_bearings` | (G, 5) | with a scan and with velocities, of each ghost: cos and sin of the bearing, straight distance (m), velocity forward, left (m/s, robot frame) |
    | `grid` | (S, S, 4) | with `observation="grid"`: 0 or 255 in the channels walls, pellets, ghosts, robot |

    Lengths are capped at 100 m; rows of forbidden candidates are zero but for their kind. With several ghosts `clyde`
    is the nearest of them, and the path length from Clyde is the shortest of all their paths.

    The scan is taken where the robot truly is: `R = 360` rays of 0.15 to 12.0 m with 1 % noise. Ghosts are virtual,
    no ray ends at them, and none shows a pellet. So the bearings come with it, and with features and planner features
    where actions are velocities: these have path lengths, not where to steer. Seen from the believed pose, they
    are the directions of `K = 4` pellets (`observation.nearest_pellets`), and of the places 0.5 m on along the shortest
    paths to them, and of all ghosts. Rows without a pellet are zero. The grid is drawn around the believed pose:
    `S = 64` pixels of 0.1 m, the robot in the middle, its heading up.

    ## Rewards
    All are configurable (`config.reward`): +1 for each pellet collected, -0.002 every 0.5 s, -10 when Clyde catches the
    robot, +5 when the round is complete, -5 at the time limit. A decision that lasts longer than 0.5 s gets the sum.
    With `reward.progress` (0: none) each metre by which the path to the nearest pellet left has become shorter is
    rewarded, as a potential that is 0 after a termination. The best policy stays the best if all episodes end by a
    termination and the learner's discount is that of the potential (`decisions.discount_per_s`, 1). After a truncation
    the potential of the last state remains in the sum of rewards, and under a learner's gamma below 1 each decision
    costs (1 - gamma) times the length of that path.

    ## Starting State
    The robot stands at the home pose; Clyde stands on a cell drawn uniformly from its cells, at least 1.5 m away
    (`clyde.spawn_distance_m`), by default where the map connects to the robot's place (`clyde.spawn`). So does
    every other ghost. All that is drawn follows from the episode's seed, `info["round_seed"]`.

    ## Episode End
    - Termination: the believed pose is within 0.25 m of Clyde or another ghost (`caught`); every pellet is collected
      (`complete`); no pellet is left but some were lost (`cleared`, only with `execution.rules="as_built"`).
    - Time limit of 600 s (`time_limit_s`, `timeout`): a truncation with the setting `timeout="truncation"`, the default,
      a termination with `timeout="termination"`, the default with `flat=True`.

    With the setting `endless` a completed round gives its reward and is followed by the next: from the home pose, with
    all pellets and a time limit of its own, Clyde 0.05 m/s faster. The episode ends when the robot is caught, or at the
    time limit of a round.

    ## Information
    `outcome` (`running`, `caught`, `complete`, `cleared`, `timeout`), `collected`, `lost`, `spawned`, `aborts`
    (goals that Nav2 aborted), `round_seed` (drawn from the environment's generator; it names the episode in results).
    On generated maps `level`. In endless games `round` (from 1) and `score` (pellets of all rounds). What
    `randomize` has drawn, by the field's name (`speed_mps`).

    ## Arguments
    ```python
    gymnasium.make("pacman_env/PacManBot-v0", map="house", preset="robot",
                   settings={"clyde.speed_mps": 0.35}, render_mode="rgb_array")
    ```
    - `map`: a shipped map's name, a map_server YAML file, an `OccupancyMap`; `"generated"` or `"generated:test"`: one of
      1,000 or 200 generated houses for each episode, its level drawn uniformly from the episode's seed.
    - `ghosts`: how many wander (1 to 4), or one for each: `"wander"` (Algorithm 2), `"chase"` (the robot), `"arcade"`
      (chases from afar, turns to its corner within 2.0 m), or a policy, its name or the object, asked at every tick.
    - `observation`: one or several of `"features"` (the default), `"scan"`, `"bearings"`, `"grid"`, `"planner"` (the
      default with `flat=True`; the numbers of `sim/observation/planner_features.py`), or a kind of your own (`docs/extending.md`).
      With `"flat"` among them all are one array.
    - `action`: `"goal"` (the default) or `"velocity"`.
    - `preset`: `robot` (as measured), `ideal` (perfect localization), or one of your own.
    - `settings`: any fields of the configuration by dotted name, or a whole `Config`.
    - `render_mode`: `"rgb_array"`, or `"human"` for a window.
    - `flat`: the settings of `pacman_env/PacManBotFlat-v0`, below your own.
    - `defaults`: settings below your own, by which ids of variants differ (`docs/environments/ids.md`).

    ## Settings
    Every number of the game is one (`docs/configuration.md`). With `{"randomize.speed_mps": (0.2, 0.3)}` and its like a
    value is drawn uniformly for each episode. These change how the environment is used, as a table in
    `docs/environments/pacmanbot.md` describes in detail: `execution.rules` (the original's faults), `decisions.when` (a step
    is a tick, or lasts until something is to be decided), `observation.candidates` (all of the map, or the nearest),
    `observation.normalize`, `observation.mask` (where the mask is), `observation.numeric_info`, `timeout` (truncation
    or termination), `action_range`, `endless`, `start_level` and `num_levels` (which of the
    generated houses: 0 to 999,999 to train, 1,000,000 to 1,000,999 to test; by default the first 1,000 and 200 of
    them, with `num_levels` 0 all), `home`.

    ## Reset
    `reset(seed=..., options=...)`: `options` may hold, for the episode that begins, `round_seed` (as in
    `info["round_seed"]`: the same episode once more), `level` (of generated maps) and `settings` (fields of the
    configuration that leave the spaces as they are: `{"clyde.speed_mps": 0.4}`). All else in it is an error. A copy by
    `copy.deepcopy` or `pickle` plays the round again from its seed and decisions, and goes on as this environment does.

    ## Version History
    - v0: first version. `pacman_env/PacManBotFlat-v0` is the same game with `flat=True`.
    - 0.13.0 changed the planner features, and with them the observation of PacManBotFlat and of its variants but
      PacManBotFlatVelocity, from 179 to 274 numbers, without a new number in the id: models trained before cannot be
      used. The next change of this kind gets one (`docs/environments/ids.md`).
    - 0.17.0 estimates better what a ghost does, which two planner features and those of ghosts that hunt the robot are
      made of, and `map="generated"` draws from 1,000 houses instead of 1,000,000 (`num_levels=0`: all). Columns, spaces
      and rules are as before; models trained before play as well.
    """  # noqa: E501

    metadata: dict[str, Any] = {"render_modes": ["rgb_array", "human"], "render_fps": RENDER_FPS}  # noqa: RUF012
    action_space: spaces.Discrete | spaces.Box
    observation_space: spaces.Dict | spaces.Box

    @takes_env_arguments
    def __init__(self, *, arguments: EnvArguments) -> None:
        """See the class; raises ConfigError or MapError for arguments that cannot be played."""
        self._make_core(1, arguments)
        self.observation_space = self._core.observation_space
        self.action_space = self._core.action_space

    def reset(self, *, seed: int | None = None, options: Options = None) -> tuple[Observation, dict[str, Any]]:
        """Start a new episode; ``seed`` is of the generator that draws the episode's own, None: it goes on.

        ``options`` are described in the class. Nothing has been changed where it raises: ValueError for those that are
        unknown or cannot be played, Gymnasium's Error for a bad seed.
        """
        wanted = ResetOptions.of(options, 1)
        core = self._core_by(wanted.settings)
        levels = wanted.levels(core.batch.source, _ONE)
        super().reset(seed=seed)
        self._core = core
        self._core.reset(_ONE, wanted.seeds(_ONE, [self.np_random]), levels)
        if self.render_mode == "human":
            self.render()
        return self._observed()

    def step(self, action: Any) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Drive towards a candidate, or at given velocities, until the next decision.

        Raises ValueError for an action that is not in the action space, but velocities are cut to its limits; and
        ResetNeeded before the first reset, or after the end of an episode.
        """
        self._core.require_reset(running=True)
        reward, terminated, truncated = self._core.step(checked_action(self.action_space, action)[None])
        if self.render_mode == "human":
            self.render()
        observation, info = self._observed()
        return observation, float(reward[0]), bool(terminated[0]), bool(truncated[0]), info

    def _masks(self) -> NDArray[np.bool_]:
        return self._core.masks()[0]

    def _observed(self) -> tuple[Observation, dict[str, Any]]:
        return self._core.observe_game(), self._core.info_of_game()
