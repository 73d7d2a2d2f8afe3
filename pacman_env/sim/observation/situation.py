"""What a policy sees at a decision: N situations at once, as arrays.

The same structure is filled from the simulator and from a robot's messages. Poses are *believed* poses in the map
frame (m, rad). Candidates are laid out as pellets (padded), refuges (padded), hold.

Of several ghosts the one nearest to the believed pose is called Clyde here, and ``path_clyde`` is the shortest path of
all. A policy that plays a ghost sees the same arrays with that one as Clyde: the candidates are then the places that it
can be sent to, and the last one is to wander on.
"""

from __future__ import annotations

from collections import namedtuple
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, get_args, get_origin, get_type_hints

import numpy as np
from numpy.typing import NDArray

from ...engine.arrays import Array, Layout
from ...engine.jit import kernel
from ...engine.threads import ALONE, Threads
from ...game.behaviour_belief import BELIEVED

if TYPE_CHECKING:
    from ..maps.level_slots import LevelSlots

PELLET, REFUGE, HOLD = 0, 1, 2
_BELIEF = f"N G {len(BELIEVED)}"  # by name, as Sphinx reads no f-string in an annotation


@dataclass(frozen=True)
class Situation:
    """N situations with C candidates and G ghosts each; m, rad and s in the map frame.

    Arrays are (N,) per situation, (N, C) per candidate: ``kind``, ``mask``, ``path_robot``, ``path_clyde``, ``goal``;
    ``position`` is (N, C, 2), ``robot`` (N, 3), velocities and ``clyde`` (N, 2), ``ghosts`` (N, G, 5), ``belief``
    (N, G, 4): probabilities of wandering, ``arcade``, ``chase`` and anything else.
    """

    time_s: Annotated[NDArray[np.float64], "N"]  # since the round began
    robot: Annotated[NDArray[np.float64], "N 3"]  # x, y, heading as believed
    robot_velocity: Annotated[NDArray[np.float64], "N 2"]  # v in m/s, omega in rad/s
    pose_age_s: Annotated[NDArray[np.float64], "N"]  # since the believed pose was measured
    clyde: Annotated[NDArray[np.float64], "N 2"]  # x, y
    clyde_velocity: Annotated[NDArray[np.float64], "N 2"]  # m/s, of the last move
    clyde_speed: Annotated[NDArray[np.float64], "N"]  # m/s, the speed in this round
    closing_speed: Annotated[NDArray[np.float64], "N"]  # m/s, positive: the straight distance shrinks (Algorithm 3)
    kind: Annotated[NDArray[np.int8], "N C"]  # PELLET, REFUGE or HOLD
    position: Annotated[NDArray[np.float64], "N C 2"]  # m; HOLD and padding: the robot's own position
    mask: Annotated[NDArray[np.bool_], "N C"]  # may be chosen now
    path_robot: Annotated[NDArray[np.float64], "N C"]  # m, path length robot-candidate; inf if unreachable
    path_clyde: Annotated[NDArray[np.float64], "N C"]  # m, path length Clyde-candidate; inf if unreachable
    current: Annotated[NDArray[np.int64], "N"]  # candidate pursued now, -1: none
    seed: Annotated[NDArray[np.uint64], "N"]  # the round's seed, for policies that draw
    tick: Annotated[NDArray[np.int64], "N"]  # ticks of this round before this one
    pellets_left: Annotated[NDArray[np.int64], "N"]  # still on the map, those that may not be chosen now included
    ghosts: Annotated[NDArray[np.float64], "N G 5"]  # x, y, vx, vy, speed of every ghost; Clyde is the nearest of them
    belief: Annotated[NDArray[np.float64], _BELIEF]  # what each ghost does (game/behaviour_belief.py)
    goal: Annotated[NDArray[np.int32], "N C"]  # number of the candidate among the map's goals, -1: none
    level: Annotated[NDArray[np.int32], "N"]  # slot of the map in ``maps``
    maps: LevelSlots | None = None  # the maps themselves, for policies that plan on them; None if unknown
    threads: Threads = ALONE  # that may work on what is made of the situations

    def __len__(self) -> int:
        return len(self.time_s)

    def __getattr__(self, name: str) -> NDArray[Any]:
        """An array of the block that is asked for the first time: to make all costs as much as a step."""
        block = self.__dict__.get("_block")
        if block is None or name not in LAYOUT.fields:
            raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")
        array = self.__dict__[name] = LAYOUT.view(block[0], name, *block[1:])
        return array

    def __getstate__(self) -> dict[str, Any]:
        """A copy's arrays lie elsewhere: they would not be those of its block any more."""
        arrays = dict(zip(LAYOUT.fields, self.arrays(), strict=True))
        return {**arrays, "maps": self.maps, "threads": self.threads}

    def arrays(self) -> tuple[NDArray[Any], ...]:
        """The arrays in the order of the fields."""
        return tuple(getattr(self, name) for name in LAYOUT.fields)

    def rows(self, index: slice | NDArray[np.int64]) -> Situation:
        """The situations at ``index`` as a smaller batch."""
        arrays = {name: getattr(self, name)[index] for name in LAYOUT.fields}
        return Situation(**arrays, maps=self.maps, threads=self.threads)

    def copy(self) -> Situation:
        """Return the same in arrays of its own."""
        block, *lengths = self.block()
        copied = type(self).__new__(type(self))
        copied.__dict__.update(_block=(block.copy(), *lengths), maps=self.maps, threads=self.threads)
        return copied

    def block(self) -> tuple[NDArray[np.uint8], int, int, int]:
        """The block of memory that the arrays are in, and what it is for: situations, candidates, ghosts.

        Arrays that lie elsewhere are copied into a new one.
        """
        if "_block" in self.__dict__:
            return self.__dict__["_block"]
        lengths = len(self), self.mask.shape[1], self.ghosts.shape[1]
        block = LAYOUT.new(*lengths)
        for name, view in LAYOUT.views(block, *lengths).items():
            view[:] = getattr(self, name)
        return block, *lengths

    @classmethod
    def empty(
        cls, n: int, candidates: int, ghosts: int = 1, maps: LevelSlots | None = None, threads: Threads = ALONE
    ) -> Situation:
        """Arrays for n situations, not yet filled."""
        situation = cls.__new__(cls)
        lengths = n, candidates, ghosts
        # The fields of a frozen dataclass; the arrays follow when they are asked for.
        situation.__dict__.update(_block=(LAYOUT.new(*lengths), *lengths), maps=maps, threads=threads)
        return situation


def _declared() -> dict[str, Array]:
    hints = get_type_hints(Situation, localns={"LevelSlots": object}, include_extras=True)
    shapes = {name: hint for name, hint in hints.items() if get_origin(hint) is Annotated}
    return {name: Array(_scalar(hint.__origin__), *hint.__metadata__) for name, hint in shapes.items()}


def _scalar(hint: Any) -> Any:
    """Of ``NDArray[scalar]``: up to NumPy 2.4 an alias of ``ndarray[shape, dtype[scalar]]``, then one of its own."""
    last = get_args(hint)[-1]
    return get_args(last)[0] if get_args(last) else last


#: The arrays of a situation, as kernels see them.
SituationArrays: Any = namedtuple("SituationArrays", _declared(), defaults=_declared().values())  # type: ignore[misc]
#: Where they lie in the block of one that was made by :meth:`Situation.empty`.
LAYOUT = Layout(SituationArrays)


MISSING = -1  # in place of a candidate's number: there are fewer


@dataclass(frozen=True)
class Nearest:
    pellets: int
    refuges: int

    @property
    def count(self) -> int:
        return self.pellets + self.refuges + 1


def nearest_candidates(situation: Situation, nearest: Nearest) -> NDArray[np.int64]:
    """(N, ``nearest.count``) the candidates that may be chosen, by the robot's path length, or ``MISSING``.

    Of equal ones the lower number is first. The one pursued now is listed in any case: last of its kind.
    """
    order = np.empty((len(situation), nearest.count), dtype=np.int64)
    _list(
        situation.kind, situation.mask, situation.path_robot, situation.current, nearest.pellets, nearest.refuges, order
    )
    return order


@kernel
def _list(kind, mask, path, current, pellets, refuges, order):  # type: ignore[no-untyped-def]
    for i in range(len(kind)):
        list_nearest(kind[i], mask[i], path[i], current[i], pellets, refuges, order[i])


@kernel
def insert_nearest(order, first, room, number, length):  # type: ignore[no-untyped-def]
    """Insert a number into the sorted ``order[first : first + room]``, of which ``MISSING`` ones are free.

    ``length`` is by number.
    """
    place = room
    while place > 0:
        other = order[first + place - 1]
        if other != MISSING and length[other] <= length[number]:
            break
        place -= 1
    for k in range(room - 1, place, -1):
        order[first + k] = order[first + k - 1]
    if place < room:
        order[first + place] = number


@kernel
def list_nearest(kind, mask, path, now, pellets, refuges, order):  # type: ignore[no-untyped-def]
    """Fill in the list (K,) of one situation, whose candidates are (C,); ``now``: the one pursued, -1: none."""
    order[:] = MISSING
    for c in range(len(kind)):
        if kind[c] == HOLD:
            order[pellets + refuges] = c
            continue
        if not mask[c]:
            continue
        first, room = (0, pellets) if kind[c] == PELLET else (pellets, refuges)
        insert_nearest(order, first, room, c, path)
    if now >= 0 and mask[now] and kind[now] != HOLD:
        first, room = (0, pellets) if kind[now] == PELLET else (pellets, refuges)
        listed = False
        for k in range(room):
            listed |= order[first + k] == now
        if not listed and room > 0:
            order[first + room - 1] = now


def among(mask: NDArray[np.bool_], listed: NDArray[np.int64]) -> NDArray[np.bool_]:
    """(N, C) which candidates are allowed and listed (N, K)."""
    found = np.zeros_like(mask)
    games, places = np.nonzero(listed != MISSING)
    found[games, listed[games, places]] = True
    return found & mask


def at_places(
    listed: NDArray[np.int64], places: NDArray[Any], hold: int
) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """(N,) the candidate that each situation lists (N, K) at its place, ``hold`` where one is missing; and where."""
    chosen = np.take_along_axis(listed, places[:, None], axis=1)[:, 0]
    missing = chosen == MISSING
    return np.where(missing, hold, chosen), missing
