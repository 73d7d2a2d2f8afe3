"""What a policy sees at a decision: N situations at once, as arrays.

The same structure is filled from the simulator and from a robot's messages. Poses are *believed* poses in the map
frame (m, rad). Candidates are laid out as pellets (padded), refuges (padded), hold.

Of several ghosts the one nearest to the believed pose is called Clyde here, and ``path_clyde`` is the shortest of all
their ways. A policy that plays a ghost sees the same arrays with him as Clyde: the candidates are then the places he
can be sent to, and the last one is to wander on.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from ..maps.level_stack import LevelStack

PELLET, REFUGE, HOLD = 0, 1, 2


@dataclass(frozen=True)
class Situation:
    """N situations with C candidates each."""

    time_s: NDArray[np.float64]  # (N,) since the round began
    robot: NDArray[np.float64]  # (N, 3) x, y, heading as believed
    robot_velocity: NDArray[np.float64]  # (N, 2) v in m/s, omega in rad/s
    pose_age_s: NDArray[np.float64]  # (N,) since the believed pose was measured
    clyde: NDArray[np.float64]  # (N, 2) x, y
    clyde_velocity: NDArray[np.float64]  # (N, 2) m/s, of his last move
    clyde_speed: NDArray[np.float64]  # (N,) m/s, his speed in this round
    closing_speed: NDArray[np.float64]  # (N,) m/s, positive: the straight distance shrinks (Algorithm 3)
    kind: NDArray[np.int8]  # (N, C) PELLET, REFUGE or HOLD
    position: NDArray[np.float64]  # (N, C, 2) m; HOLD and padding: the robot's own position
    mask: NDArray[np.bool_]  # (N, C) may be chosen now
    path_robot: NDArray[np.float64]  # (N, C) m, path length robot-candidate; inf: no way
    path_clyde: NDArray[np.float64]  # (N, C) m, path length Clyde-candidate; inf: no way
    current: NDArray[np.int64]  # (N,) candidate pursued now, -1: none
    seed: NDArray[np.uint64]  # (N,) the round's seed, for policies that draw
    tick: NDArray[np.int64]  # (N,) ticks of this round before this one
    pellets_left: NDArray[np.int64]  # (N,) still on the map, those that may not be chosen now included
    ghosts: NDArray[np.float64]  # (N, G, 5) x, y, vx, vy, speed of every ghost; Clyde is the nearest of them
    goal: NDArray[np.int32]  # (N, C) number of the candidate among the map's goals, -1: none
    level: NDArray[np.int32]  # (N,) slot of the map in ``maps``
    maps: LevelStack | None = None  # the maps themselves, for policies that plan on them; None: not known

    def __len__(self) -> int:
        return len(self.time_s)

    def arrays(self) -> tuple[NDArray, ...]:
        """The arrays in the order of the fields."""
        return tuple(self.__dict__.values())[:-1]

    def rows(self, index: slice | NDArray[np.int64]) -> Situation:
        """The situations at ``index`` as a smaller batch."""
        arrays = {name: array[index] for name, array in self.__dict__.items() if name != "maps"}
        return Situation(**arrays, maps=self.maps)

    @classmethod
    def empty(cls, n: int, candidates: int, ghosts: int = 1, maps: LevelStack | None = None) -> Situation:
        """Arrays for n situations, not yet filled."""
        c = candidates
        situation = cls.__new__(cls)  # a frozen dataclass sets its fields one by one, slowly
        situation.__dict__.update(
            time_s=np.empty(n),
            robot=np.empty((n, 3)),
            robot_velocity=np.empty((n, 2)),
            pose_age_s=np.empty(n),
            clyde=np.empty((n, 2)),
            clyde_velocity=np.empty((n, 2)),
            clyde_speed=np.empty(n),
            closing_speed=np.empty(n),
            kind=np.empty((n, c), dtype=np.int8),
            position=np.empty((n, c, 2)),
            mask=np.empty((n, c), dtype=np.bool_),
            path_robot=np.empty((n, c)),
            path_clyde=np.empty((n, c)),
            current=np.empty(n, dtype=np.int64),
            seed=np.empty(n, dtype=np.uint64),
            tick=np.empty(n, dtype=np.int64),
            pellets_left=np.empty(n, dtype=np.int64),
            ghosts=np.empty((n, ghosts, 5)),
            goal=np.empty((n, c), dtype=np.int32),
            level=np.empty(n, dtype=np.int32),
            maps=maps,
        )
        return situation
