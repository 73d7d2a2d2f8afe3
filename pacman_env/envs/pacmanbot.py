"""The single-agent Gymnasium environment: a batch of one game."""

from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from ..game.ends import RUNNING
from ..observations.robot_features import Observation
from ..render.window import RENDER_FPS, Display
from .arguments import EnvArguments, takes_env_arguments
from .base_env import BaseEnv
from .guard import exclusive, shared
from .resets import Options, ResetOptions, Seed, checked_seed
from .spaces import checked_action

_ONE = np.zeros(1, dtype=np.int64)


class PacManBotEnv(BaseEnv, Display, gym.Env[Any, Any]):
    """
    ## Description
    A TurtleBot 4 plays one round of Pac-Man on its map. Virtual pellets lie on the map, and a virtual ghost,
    Clyde, wanders there. At every decision the agent chooses the goal that the robot's navigator drives to. The
    simulator covers physics (pymunk, 20 Hz), navigation (a model of Nav2) and localization (AMCL's pose estimate).
    Choosing the current goal again continues it. Options are up to four ghosts, other kinds of observation and action,
    endless games, and a new house for every episode. `docs/environments/pacmanbot.md` has examples for each.

    ## Action Space
    `Discrete(C)`: the index of a candidate goal. Candidates are, in this order,

    | Index | Candidate |
    |---|---|
    | 0 ... P-1 | the pellets, `P = config.max_pellets` or as many as the map has |
    | P ... C-2 | refuges: the home pose, spread-out places, nooks that Clyde cannot approach |
    | C-1 | hold: stop and stay |

    If the mask forbids the candidate (a collected pellet, a goal that waits after Nav2 aborted it, padding), the robot
    holds. The mask is `observation["action_mask"]`; `action_masks()` returns it as bool.

    With `action="velocity"` the space is `Box(2,)` of float32 instead: v from 0 to 0.306 m/s (`robot.wheel_speed_mps`)
    and omega from -1.9 to 1.9 rad/s, counter-clockwise, held until the next decision; Nav2 is not used. Velocities
    beyond the limits are clipped; if the wheels cannot do both, v is reduced and omega kept. There is no mask. With the
    setting `action_range` `"unit"` both are -1 to 1, as most learners expect: v is 0 at -1 and 0.306 m/s at 1, omega is
    -1.9 rad/s at -1 and 1.9 rad/s at 1, both linear in between.

    ## Observation Space
    `Dict` of float32 arrays (the mask is int8, the grid uint8). Poses are the robot's estimates, not the true poses.

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
    | `candidate_power` | (C, 1) | with power pellets: is a power pellet |
    | `ghost_power` | (G, 4) | with power pellets, of each ghost: is frightened, time until it is not frightened any more (s), is away, time until it starts again (s) |
    | `pellet_power` | (K, 1) | with power pellets, next to `pellet_bearings`: is a power pellet |

    Lengths are capped at 100 m. Rows of forbidden candidates are zero except for their kind. With several ghosts,
    `clyde` is the nearest ghost, and the path length from Clyde is the shortest path of any ghost.

    With power pellets `candidate_power` and `ghost_power` are added to every observation that is not a grid alone. A
    ghost is harmless while it is away, and while it stays frightened for longer than 6.6 s (`power.warning_s`). Then it
    does not count as Clyde: `clyde` is the nearest ghost that is not harmless, and 1 km away (capped) if all are. In the
    grid power pellets are larger, frightened ghosts have the value 128, and ghosts that are away are not drawn.

    The scan is taken from the true pose: `R = 360` rays of 0.15 to 12.0 m with 1 % noise. The lidar sees neither ghosts
    nor pellets, which are virtual. Therefore the bearings are added to a scan, and with velocity actions also to
    features and planner features, which contain path lengths but not where to steer. Bearings are relative to the
    believed pose: the directions of `K = 4` pellets (`observation.nearest_pellets`), of the places 0.5 m ahead on the
    shortest paths to them (the way), and of all ghosts. Rows without a pellet are zero. The grid is centred on the
    believed pose: `S = 64` pixels of 0.1 m, with the robot's heading up.

    ## Power Pellets
    `power.pellets` is the number of power pellets (default 0, with the preset `arcade` 4). They lie far from home and
    from each other. A power pellet frightens all ghosts for 20 s (`power.duration_s`), except ghosts that are away. A
    frightened ghost flees at 67 % of its speed and does not kill. If the robot comes within 0.25
    m of a frightened ghost, the ghost is caught: it is away for 5 s (`power.return_s`) and starts again at its spawn
    place, not frightened. A ghost that a policy controls keeps its policy while it is frightened; its choices have no
    effect while it is away. In an endless game the 20 s become 3.3 s shorter with each round, but not shorter than 6.6 s.

    The score is 1 for each pellet, 5 for a power pellet, and 20, 40, 80 and 160 for the ghosts caught after the same
    power pellet. It does not change the reward.

    ## Rewards
    All are configurable (`config.reward`): +1 for each pellet collected, -0.002 every 0.5 s, -10 when Clyde catches the
    robot, +5 when the round is complete, -5 at the time limit, and with power pellets +2 for each ghost caught
    (`reward.ghost_caught`) and 0 for a power pellet in addition to its +1 (`reward.power`). A decision that lasts longer than 0.5 s gets the sum.
    `reward.progress` (default 0) rewards each metre by which the path to the nearest remaining pellet became shorter,
    as a potential that is 0 after a termination. The best policy stays the best if all episodes end by a termination
    and the learner's discount equals the discount of the potential (`decisions.discount_per_s`, 1). After a truncation the
    potential of the last state remains in the sum of rewards. If a learner's gamma is below 1, each decision costs
    (1 - gamma) times the length of that path.

    ## Starting State
    The robot stands at the home pose. Each ghost stands on a cell drawn uniformly, at least 1.5 m away
    (`clyde.spawn_distance_m`). By default the cell is in the part of the map connected to the robot (`clyde.spawn`).
    All random values follow from the episode's seed, `info["round_seed"]`.

    ## Episode End
    - Termination: the believed pose is within 0.25 m of a ghost that is neither frightened nor away (`caught`).
    - Termination: every pellet is collected (`complete`), or no pellet is left but some were lost (`cleared`, only with
      `execution.rules="as_built"`).
    - Time limit of 600 s (`time_limit_s`): a truncation, or a termination with the setting `timeout="termination"`,
      which `flat=True` uses.

    With the setting `endless` a completed round gives its reward, and the next round starts: at the home pose, with
    all pellets and a new time limit. Clyde is 0.05 m/s faster. The episode ends when the robot is caught, or at the time
    limit of a round.

    ## Information
    | Key | Meaning |
    |---|---|
    | `outcome` | `running`, `caught`, `complete`, `cleared` (no pellet left, but some lost) or `timeout` |
    | `collected`, `lost`, `spawned` | pellets of this round |
    | `aborts` | goals that Nav2 aborted in this round |
    | `elapsed_s` | with decisions by events: duration of the decision (s) |
    | `round_seed` | seed of the episode, drawn from the generator of the environment; it identifies the episode in results |
    | `score`, `ghosts_caught` | points and ghosts caught, over all rounds of an endless game; without power pellets the score is the number of pellets |
    | `level` | number of the generated house, with generated maps |
    | `round` | number of the round from 1, in endless games |
    | `speed_mps`, ... | values that `randomize` drew, by the name of the field |

    ## Arguments
    ```py
    gymnasium.make("pacman_env/PacManBot-v2", map="house", preset="robot", settings={"clyde.speed_mps": 0.35})
    ```
    - `map`: the name of a map in the package, a map_server YAML file, or an `OccupancyMap`. `"generated"` plays one of
      1,000 training houses in each episode, `"generated:test"` one of 200 test houses. `"generated:long"` and
      `"generated:long:test"` are buildings with long corridors. The seed of the episode decides which; all are
      equally likely.
    - `ghosts`: a number of wandering ghosts (1 to 4), or one entry for each: `"wander"` (Algorithm 2), `"chase"`
      (follows the robot), `"arcade"` (chases from afar, turns to its corner within 2.0 m), or a policy (name or
      object), which chooses at every tick.
    - `observation`: one or several of `"features"` (the default), `"scan"`, `"bearings"`, `"grid"`, `"planner"` (the
      default with `flat=True`; see `observations/planner_features.py`), `"power"` (added if there are power
      pellets), or a custom kind (`docs/extending.md`). If `"flat"` is included, all are joined in one array.
    - `action`: `"goal"` (the default) or `"velocity"`.
    - `preset`: `robot` (as measured), `ideal` (perfect localization), `arcade` (power pellets and four ghosts), or a
      custom preset.
    - `settings`: any fields of the configuration by dotted name, or a whole `Config`.
    - `render_mode`: `"rgb_array"`, or `"human"` for a window; `env.unwrapped.theme = "dark"` draws dark pictures.
    - `flat`: use the settings of `pacman_env/PacManBotFlat-v2`; your own settings override them.
    - `defaults`: the settings of an id (`docs/environments/ids.md`), which `settings` override.

    ## Settings
    Every number of the game is a setting (`docs/configuration.md`). A range draws a value uniformly for each episode,
    such as `{"randomize.speed_mps": (0.2, 0.3)}`. Some settings change how the environment is used: when the agent
    decides, which candidates it sees, where the mask is, and how an episode ends at the time limit.
    `docs/environments/pacmanbot.md` describes them in a table. Generated houses have the levels 0 to 999,999 to train and
    1,000,000 to 1,000,999 to test. By default the first 1,000 training houses or the first 200 test houses
    are played; `num_levels=0` plays all.

    ## Reset
    `reset(seed=..., options=...)`: for the next episode, `options` may contain `round_seed` (an `info["round_seed"]`,
    to repeat that episode), `level` (of generated maps) and `settings` (fields of the configuration that leave the
    spaces unchanged: `{"clyde.speed_mps": 0.4}`). Other keys raise an error. A copy by `copy.deepcopy` or `pickle`
    continues exactly like the original. `clone_state()` and `restore_state(state)` do this in one environment.

    ## Threads
    Use one environment per thread. While a thread is in `reset`, `step` or `close`, or copies the environment, the same
    calls in another thread raise RuntimeError; `render` and `action_masks` wait. `batch` is not protected.

    ## Version History
    - v2 (0.25.0): each physics step of a robot at a wall solves its contacts alone and corrects an overlap at once.
      The belief in the planner features recognizes `arcade` ghosts near the distance where they change their target.
    - v1 (0.20.0): with the preset `robot`, the robot starts, turns and changes its goal as slowly as with Nav2.
      `preset="robot_0_15"` is the robot of v0. The planner features have 289 numbers instead of 274. They are part of
      the observation of PacManBotFlat and its variants (except PacManBotFlatVelocity).
    - v0: `pacman_env/PacManBotFlat-v0` came with 0.6.0. In 0.13.0 its observation grew from 179 to 274 numbers.
    """  # noqa: E501

    metadata: dict[str, Any] = {"render_modes": ["rgb_array", "human"], "render_fps": RENDER_FPS}  # noqa: RUF012
    action_space: spaces.Discrete | spaces.Box
    observation_space: spaces.Dict | spaces.Box
    _own_state = ("_np_random", "_np_random_seed")
    render, close = shared(Display.render), exclusive(Display.close)

    @takes_env_arguments
    def __init__(self, *, arguments: EnvArguments) -> None:
        """Create the environment; raises ConfigError or MapError for arguments that cannot be played."""
        self._make_runner(1, arguments)
        self.observation_space = self._runner.observation_space
        self.action_space = self._runner.action_space

    @exclusive
    def reset(self, *, seed: Seed = None, options: Options = None) -> tuple[Observation, dict[str, Any]]:
        """Start a new episode; ``seed`` seeds the generator of episode seeds (None: it continues).

        The seed is a whole number of at least 0 of any type, such as ``np.int64``. The class describes ``options``.
        Raises ValueError, without any change, for another seed and for unknown or unplayable options.
        """
        seed = checked_seed(seed)
        request = ResetOptions.of(options, 1)
        runner = self._runner_with(request.settings)
        levels = request.levels(runner.batch.source, _ONE)
        super().reset(seed=seed)
        self._runner = runner
        self._runner.reset(_ONE, request.seeds(_ONE, [self.np_random]), levels)
        if self.render_mode == "human":
            self.render()
        return self._result()

    @exclusive
    def step(self, action: Any) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Drive towards a candidate, or at the given velocities, until the next decision.

        Raises ValueError for an action outside the action space (velocities are clipped instead), and ResetNeeded
        before the first reset or after the end of an episode.
        """
        runner = self._runner
        runner.require_reset()
        if runner.batch.summary[0, 0] != RUNNING:
            raise gym.error.ResetNeeded("the episode is over: call reset()")
        reward, terminated, truncated = runner.step(checked_action(self.action_space, action)[None])
        if self.render_mode == "human":
            self.render()
        observation, info = self._result()
        return observation, float(reward[0]), bool(terminated[0]), bool(truncated[0]), info

    @shared
    def _masks(self) -> NDArray[np.bool_]:
        self._runner.require_reset()
        return self._runner.observer.allowed[0] != 0

    def _result(self) -> tuple[Observation, dict[str, Any]]:
        runner = self._runner
        return runner.observation(first=True), runner.infos.of_first(runner.observer.allowed)
