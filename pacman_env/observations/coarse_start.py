"""Start coarse games from situations, which are the same in the simulator and on a robot."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..config import Config
from ..engine.jit import kernel
from ..levels.coarse_map import CoarseArrays, add_coarse_map
from ..rng import POLICY, stream
from ..sim import coarse_model
from ..sim.coarse_model import GHOST, NOWHERE, ROBOT, Behaviours, Lags, Model, begin, put_ghost, put_robot
from .situation import PELLET, Situation, maps_of

_LEAVE_M = 0.05


class CoarseStart(NamedTuple):
    """A coarse game that starts from a situation."""

    robot: NDArray[Any]  # (1,) with at least the fields of ROBOT
    ghosts: NDArray[Any]  # (G,) records GHOST of the ghosts that are not harmless
    goals: NDArray[np.int64]  # (C,) goal of each candidate; NOWHERE: hold or padding
    model: Model
    pellets: int  # goals below this number are pellets


def start(
    situation: Situation, i: int, config: Config, behaviours: Behaviours, lags: Lags, robot: np.dtype[Any] | None = None
) -> CoarseStart:
    """Return the coarse game of situation ``i``, with a robot of the dtype ``robot`` (None: ROBOT).

    Raises ValueError if the situation has no maps.
    """
    s, level = situation, maps_of(situation).level(int(situation.level[i]))
    bit = np.full(level.facts.pellets + level.facts.refuges, -1, dtype=np.int8)
    pellets = np.flatnonzero(s.mask[i] & (s.kind[i] == PELLET) & np.isfinite(s.path_robot[i]) & (s.goal[i] >= 0))
    pellets = pellets[np.argsort(s.path_robot[i, pellets], kind="stable")][: coarse_model.MOST_PELLETS]
    bit[s.goal[i, pellets]] = np.arange(len(pellets))
    numbers = coarse_model.rules(config, lags)
    # A ghost within the margin has not caught the robot yet.
    numbers_of_ghosts = np.flatnonzero(~s.harmless[i])
    seen = s.ghosts[i, numbers_of_ghosts]
    apart = float(np.hypot(*(seen[:, :2] - s.robot[i, :2]).T).min(initial=np.inf))
    numbers["death_m"] = max(config.execution.death_radius_m, min(float(numbers["death_m"][0]), apart - _LEAVE_M))
    model = Model(CoarseArrays(**add_coarse_map(level).arrays), numbers, behaviours.table.address, bit)
    own, ghosts = np.zeros(1, dtype=ROBOT if robot is None else robot), np.zeros(len(seen), dtype=GHOST)
    own["time_s"] = s.time_s[i]
    own["pellets"] = (1 << len(pellets)) - 1
    goals = s.goal[i].astype(np.int64)  # candidates without a goal have -1, NOWHERE
    goal, left_m = NOWHERE, 0.0
    current = int(s.current[i])
    if current >= 0 and s.mask[i, current] and np.isfinite(s.path_robot[i, current]):
        goal, left_m = int(goals[current]), float(s.path_robot[i, current])
    _put(own, ghosts, model, s.robot[i], (numbers_of_ghosts, seen), np.int64(goal), left_m)
    return CoarseStart(own, ghosts, goals, model, level.facts.pellets)


def draw_futures(ghosts: NDArray[Any], seed: int, tick: int, number: int) -> None:
    """Seed the streams of the wandering ghosts from the round's seed, the tick and the number of the future."""
    for k in range(len(ghosts)):
        purpose = np.uint64((((tick + 1) << 12) + (number << 4) + k) * 16 + POLICY)
        ghosts["stream"][k] = _stream(np.uint64(seed), purpose)
    ghosts["target"] = -1


@kernel
def _put(robot, ghosts, model, pose, others, goal, left_m):  # type: ignore[no-untyped-def]
    """Place the robot (1,) at ``pose`` (3,), and the ghosts (G,); ``left_m`` is the path length to the robot's goal.

    ``others`` are the ghosts' numbers (G,) and rows (G, 5) of the situation.
    """
    number, seen = others
    put_robot(robot[0], model, pose[0], pose[1], pose[2])
    for k in range(len(ghosts)):
        put_ghost(ghosts[k], number[k], model, seen[k])
    if goal >= 0:
        begin(robot[0], goal, left_m, model)


_stream = kernel(stream)
