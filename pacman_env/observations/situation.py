"""Input of a policy at a decision: N situations at once, as arrays.

The simulator and a robot's messages fill the same structure. Poses are *believed* poses in the map frame (m, rad).
Candidates are pellets (padded), refuges (padded) and hold, in this order.

With several ghosts, Clyde is the ghost nearest to the believed pose, and ``path_clyde`` is the shortest path of any
ghost. Harmless ghosts do not count: if all are, Clyde is 1 km away. The policy of a ghost gets the
same arrays with its ghost as Clyde; its candidates are the places where the ghost can go; the last one means
to wander.
"""

from __future__ import annotations

import functools
import operator
from collections import namedtuple
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, get_args, get_origin, get_type_hints

import numpy as np
from numpy.typing import NDArray

from ..engine.arrays import Array, Table, arrays_by_address, zeros
from ..engine.threads import ALONE, Threads
from ..game.behaviour_belief import BELIEVED

if TYPE_CHECKING:
    from ..levels.level_slots import LevelSlots

PELLET, REFUGE, HOLD = 0, 1, 2
#: Columns of ``Situation.fright``: for how long a ghost stays frightened and is away, s; 1 if it is harmless for longer
#: than ``power.warning_s``, so that it need not be avoided.
FRIGHTENED_S, AWAY_S, HARMLESS = 0, 1, 2
_BELIEF = f"N G {len(BELIEVED)}"  # a name, because Sphinx cannot read f-strings in annotations


@dataclass(frozen=True)
class Situation:
    """N situations with C candidates and G ghosts each; m, rad and s in the map frame.

    Arrays are (N,) per situation, (N, C) per candidate: ``kind``, ``mask``, ``path_robot``, ``path_clyde``, ``goal``,
    ``is_power``; ``position`` is (N, C, 2), ``robot`` (N, 3), velocities and ``clyde`` (N, 2), ``ghosts`` (N, G, 5),
    ``fright`` (N, G, 3), ``belief`` (N, G, 4): probabilities of wandering, ``arcade``, ``chase`` and anything else.
    ``frightened_s``, ``away_s`` and ``harmless`` (N, G) are the columns of ``fright``.
    """

    time_s: Annotated[NDArray[np.float64], "N"]  # time since the round began
    robot: Annotated[NDArray[np.float64], "N 3"]  # believed x, y, heading
    robot_velocity: Annotated[NDArray[np.float64], "N 2"]  # v in m/s, omega in rad/s
    pose_age_s: Annotated[NDArray[np.float64], "N"]  # age of the believed pose
    clyde: Annotated[NDArray[np.float64], "N 2"]  # x, y
    clyde_velocity: Annotated[NDArray[np.float64], "N 2"]  # m/s, velocity of the last move
    clyde_speed: Annotated[NDArray[np.float64], "N"]  # m/s, the speed in this round
    closing_speed: Annotated[NDArray[np.float64], "N"]  # m/s, positive: the straight distance shrinks (Algorithm 3)
    kind: Annotated[NDArray[np.int8], "N C"]  # PELLET, REFUGE or HOLD
    position: Annotated[NDArray[np.float64], "N C 2"]  # m; for HOLD and padding the robot's position
    mask: Annotated[NDArray[np.bool_], "N C"]  # allowed candidates
    path_robot: Annotated[NDArray[np.float64], "N C"]  # m, path length robot-candidate; inf if unreachable
    path_clyde: Annotated[NDArray[np.float64], "N C"]  # m, path length Clyde-candidate; inf if unreachable
    current: Annotated[NDArray[np.int64], "N"]  # current candidate, -1: none
    seed: Annotated[NDArray[np.uint64], "N"]  # seed of the round, for policies that draw random numbers
    tick: Annotated[NDArray[np.int64], "N"]  # number of this tick in the round, from 0
    pellets_left: Annotated[NDArray[np.int64], "N"]  # pellets on the map, including forbidden ones
    ghosts: Annotated[NDArray[np.float64], "N G 5"]  # x, y, vx, vy, speed of each ghost
    fright: Annotated[NDArray[np.float64], "N G 3"]  # FRIGHTENED_S, AWAY_S and HARMLESS of each ghost
    is_power: Annotated[NDArray[np.bool_], "N C"]  # candidates that are power pellets
    belief: Annotated[NDArray[np.float64], _BELIEF]  # probabilities of behaviours (game/behaviour_belief.py)
    goal: Annotated[NDArray[np.int32], "N C"]  # goal number of each candidate on its map, -1: none
    level: Annotated[NDArray[np.int32], "N"]  # slot of the map in ``maps``
    maps: LevelSlots | None = None  # maps, for policies that plan on them; None if unknown
    threads: Threads = ALONE  # threads for computations on the situations

    def __len__(self) -> int:
        return len(self.time_s)

    @property
    def frightened_s(self) -> NDArray[np.float64]:
        """Return the time for which each ghost stays frightened, (N, G), s; 0 if it is not frightened."""
        return self.fright[:, :, FRIGHTENED_S]

    @property
    def away_s(self) -> NDArray[np.float64]:
        """Return the time until each caught ghost starts again, (N, G), s; 0 if it is not away."""
        return self.fright[:, :, AWAY_S]

    @property
    def harmless(self) -> NDArray[np.bool_]:
        """Return a mask (N, G) of the ghosts that stay harmless for longer than ``power.warning_s``."""
        return self.fright[:, :, HARMLESS] > 0.0

    @functools.cached_property
    def table(self) -> Table:
        """Addresses of the arrays for kernels, see ``situation_arrays``."""
        return Table(SituationArrays, **dict(zip(_NAMES, map(np.ascontiguousarray, self.arrays()), strict=True)))

    def __getstate__(self) -> dict[str, Any]:
        """Return the state without the table, because the arrays of a copy have other addresses."""
        return {name: value for name, value in self.__dict__.items() if name != "table"}

    def arrays(self) -> tuple[NDArray[Any], ...]:
        """Return the arrays in the order of the fields."""
        return _values(self)

    def rows(self, index: slice | NDArray[np.int64]) -> Situation:
        """Return the situations at ``index`` (M,), or in a slice, as a smaller batch."""
        arrays = {name: array[index] for name, array in zip(_NAMES, self.arrays(), strict=True)}
        return Situation(**arrays, maps=self.maps, threads=self.threads)

    def copy(self) -> Situation:
        """Return a copy with its own arrays."""
        arrays = {name: array.copy() for name, array in zip(_NAMES, self.arrays(), strict=True)}
        return Situation(**arrays, maps=self.maps, threads=self.threads)

    @classmethod
    def empty(
        cls, n: int, candidates: int, ghosts: int = 1, maps: LevelSlots | None = None, threads: Threads = ALONE
    ) -> Situation:
        """Return n situations with arrays that are not yet filled."""
        arrays = zeros(SituationArrays, _NAMES, N=n, C=candidates, G=ghosts)
        return cls(**arrays, maps=maps, threads=threads)


def _declared() -> dict[str, Array]:
    hints = get_type_hints(Situation, localns={"LevelSlots": object}, include_extras=True)
    shapes = {name: hint for name, hint in hints.items() if get_origin(hint) is Annotated}
    return {name: Array(_scalar(hint.__origin__), *hint.__metadata__) for name, hint in shapes.items()}


def _scalar(hint: Any) -> Any:
    """Return ``scalar`` of ``NDArray[scalar]``, which up to NumPy 2.4 is ``ndarray[shape, dtype[scalar]]``."""
    last = get_args(hint)[-1]
    return get_args(last)[0] if get_args(last) else last


#: The arrays of a situation for kernels.
SituationArrays: Any = namedtuple("SituationArrays", _declared(), defaults=_declared().values())  # type: ignore[misc]
_NAMES: tuple[str, ...] = SituationArrays._fields
_values: Callable[[Any], tuple[NDArray[Any], ...]] = operator.attrgetter(*_NAMES)
#: Returns the arrays of a :attr:`Situation.table` by its address.
situation_arrays = arrays_by_address(SituationArrays)


def maps_of(situation: Situation) -> LevelSlots:
    """Return the maps of a situation; raise ValueError if it contains none."""
    if situation.maps is None:
        raise ValueError("the situation has no maps to plan on")
    return situation.maps
