"""Simulate robots among walls with pymunk, using one space for each robot that is about to touch a wall.

No other module uses pymunk. Robots only touch walls. If a robot cannot reach a wall in a step, Chipmunk's step is two
lines of arithmetic, which :func:`move` does itself with the same bits. Near a wall the robot is in its own space with
all walls of its map, and stays there until the solver has forgotten the contact. Bodies are driven by forces, never by
setting velocities: Chipmunk integrates positions first, and overwriting the solver's velocity would push a body into
the wall that it touches. ``affine`` (6,) maps m to cells, and ``calls`` (4,) are addresses of Chipmunk's functions.
"""

import atexit
import math
import weakref
from typing import Any

import numpy as np
import pymunk
import pymunk.batch
from numpy.typing import NDArray
from pymunk._chipmunk_cffi import ffi, lib

from ...engine.jit import kernel
from ...engine.native import call_each, call_step, load, replace, store, store_int
from .grid import cell_of
from .localization import record_fields

BODY_FIELDS = [
    *record_fields(np.float64, "body_x body_y body_vx body_vy"),  # after the last step, m, m/s
    *record_fields(np.float64, "force_x force_y"),  # force for the next step, N
    *record_fields(np.int32, "touch"),  # remaining steps in a space
]
_GIVEN, _TAKEN = 6, 4  # numbers per body: position, velocity, force for Chipmunk; position, velocity from it
_HANDLE, _GIVE, _GIVE_COUNT, _TAKE, _TAKE_COUNT = range(5)  # columns of the space table
_EACH, _STEP, _GIVE_FUNCTION, _TAKE_FUNCTION = range(4)  # addresses of Chipmunk's functions, named below
_CALLED = "cpSpaceEachBody", "cpSpaceStep", "pmSpaceBodySetIteratorFuncBatched", "pmSpaceBodyGetIteratorFuncBatched"
_REMEMBERS = 5  # steps in a space after a contact, more than Chipmunk keeps it (collision_persistence, 3)
_FAR_M = 1e6
_NONE = _FREE = -1  # instead of the number of a space or a robot
_PLACE = pymunk.batch.BodyFields.POSITION | pymunk.batch.BodyFields.VELOCITY
_SPARE_M = 0.001  # margin that exceeds rounding errors
_COLLISION_SLOP_M = 0.001  # overlap that the solver tolerates; Chipmunk's default of 0.1 is for pixels


def clear_cells(
    walls: NDArray[np.float64], affine: NDArray[np.float64], shape: tuple[int, int], resolution: float, radius_m: float
) -> NDArray[np.bool_]:
    """Return the cells (H, W), without border cells, in which a disc of ``radius_m`` touches no wall (S, 4), m."""
    clear = np.ones(shape, dtype=np.bool_)
    clear[[0, -1]] = False
    clear[:, [0, -1]] = False
    _mark(clear, walls, affine, (radius_m + _SPARE_M) / resolution + math.sqrt(0.5))
    return clear


@kernel
def _mark(clear, walls, affine, reach):  # type: ignore[no-untyped-def]
    """Set ``clear`` (H, W) to False for cells with a centre within ``reach`` cells of a wall (S, 4)."""
    rows, columns = clear.shape
    for x0, y0, x1, y1 in walls:
        ax = affine[0] * x0 + affine[1] * y0 + affine[2]
        ay = affine[3] * x0 + affine[4] * y0 + affine[5]
        dx = affine[0] * x1 + affine[1] * y1 + affine[2] - ax
        dy = affine[3] * x1 + affine[4] * y1 + affine[5] - ay
        length2 = max(dx * dx + dy * dy, 1e-12)
        first, last = int(max(min(ay, ay + dy) - reach, 0.0)), int(min(max(ay, ay + dy) + reach + 1.0, rows))
        left, right = int(max(min(ax, ax + dx) - reach, 0.0)), int(min(max(ax, ax + dx) + reach + 1.0, columns))
        for row in range(first, last):
            for column in range(left, right):
                px, py = column + 0.5 - ax, row + 0.5 - ay
                along = min(max((px * dx + py * dy) / length2, 0.0), 1.0)
                px, py = px - along * dx, py - along * dy
                if px * px + py * py <= reach * reach:
                    clear[row, column] = False


def overlap_m(walls: NDArray[np.float64], places: NDArray[np.float64], radius_m: float) -> NDArray[np.float64]:
    """Return by how much, m (N,), a disc at each place (N, 2) overlaps the nearest wall (S, 4); negative: a gap."""
    return radius_m - np.hypot(*np.moveaxis(_from_walls(walls, places), 2, 0)).min(axis=1)


def touched(walls: NDArray[np.float64], x: float, y: float, reach_m: float) -> list[float]:
    """Return the directions, rad, of walls (S, 4) within ``reach_m`` of a place (x, y), m."""
    from_wall = _from_walls(walls, np.array([[x, y]]))[0]
    near = from_wall[np.hypot(*from_wall.T) <= reach_m]
    return [float(angle) for angle in np.arctan2(-near[:, 1], -near[:, 0])]


def _from_walls(walls: NDArray[np.float64], places: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the vectors (N, S, 2) from the nearest point of each wall (S, 4) to each place (N, 2), m."""
    a, along = walls[:, :2], walls[:, 2:] - walls[:, :2]
    off = places[:, None] - a
    share = np.clip((off * along).sum(axis=2) / np.maximum((along**2).sum(axis=1), 1e-12), 0.0, 1.0)
    nearest: NDArray[np.float64] = off - share[..., None] * along
    return nearest


@kernel
def place(g, x, y):  # type: ignore[no-untyped-def]
    """Place a robot that is not in a space at (x, y), at rest."""
    g.body_x, g.body_y, g.body_vx, g.body_vy = x, y, 0.0, 0.0
    g.force_x = g.force_y = 0.0
    g.touch = 0


@kernel
def move(g, i, level, affine, clear, p, spaces):  # type: ignore[no-untyped-def]
    """Move a robot's body by one step under its force; return False, without any change, if it needs a space.

    Near a wall, robot ``i`` enters an unused space of its map ``level``; it leaves when the contact is forgotten.
    ``clear`` (H, W) is True for cells in which a robot touches no wall; ``spaces`` are :attr:`Spaces.arrays`.
    """
    rows, columns = clear.shape
    if g.touch == 0:
        # Chipmunk's cpBodyUpdatePosition and cpBodyUpdateVelocity without damping, gravity and contacts.
        x, y = g.body_x + g.body_vx * p.dt, g.body_y + g.body_vy * p.dt
        column, row = cell_of(affine, rows, columns, x, y)
        if clear[row, column]:
            g.body_x, g.body_y = x, y
            g.body_vx += g.force_x * p.per_mass * p.dt
            g.body_vy += g.force_y * p.per_mass * p.dt
            return True
        if not _enter(i, level, spaces):
            return False
    table, given, taken, calls, owners, _, space_of = spaces
    k = space_of[i]
    body = given[k, :_GIVEN]
    body[0], body[1], body[2], body[3], body[4], body[5] = (
        g.body_x, g.body_y, g.body_vx, g.body_vy, g.force_x, g.force_y,
    )  # fmt: skip
    _step_space(table[k], calls, p.dt)
    store_int(table[k, _TAKE_COUNT], 0)
    call_each(calls[_EACH], table[k, _HANDLE], calls[_TAKE_FUNCTION], table[k, _TAKE])
    g.body_x, g.body_y, g.body_vx, g.body_vy = taken[k, 0], taken[k, 1], taken[k, 2], taken[k, 3]
    column, row = cell_of(affine, rows, columns, g.body_x, g.body_y)
    g.touch = max(g.touch - 1, 0) if clear[row, column] else _REMEMBERS
    if g.touch == 0:
        _empty(table[k], body, calls, p.dt)
        space_of[i] = _NONE
        store(owners, k, _FREE)
    return True


@kernel
def _enter(i, level, spaces):  # type: ignore[no-untyped-def]
    """Let robot i enter an unused space with the walls of a level; return False if there is none."""
    _, _, _, _, owners, levels, space_of = spaces
    count = len(levels)
    for j in range(count):
        k = (level + j) % count  # spaces of a level are created around its own number
        if levels[k] == level and load(owners, k) == _FREE and replace(owners, k, _FREE, i):
            space_of[i] = k
            return True
    return False


@kernel
def _step_space(space, calls, seconds):  # type: ignore[no-untyped-def]
    """Copy the body's numbers to its space, a row of the space table, and step the space by ``seconds``."""
    store_int(space[_GIVE_COUNT], 0)
    call_each(calls[_EACH], space[_HANDLE], calls[_GIVE_FUNCTION], space[_GIVE])
    call_step(calls[_STEP], space[_HANDLE], seconds)


@kernel
def _empty(space, body, calls, seconds):  # type: ignore[no-untyped-def]
    """Move the robot far from all walls, so that the next robot finds the space like a new one.

    Otherwise Chipmunk would process walls in an order that depends on the last robot.
    """
    body[:] = 0.0
    body[0] = body[1] = _FAR_M
    _step_space(space, calls, seconds)


@kernel
def empty(spaces, k, steps, seconds):  # type: ignore[no-untyped-def]
    """Keep the robot far from all walls for ``steps`` steps, so that the space forgets its contacts."""
    table, given, calls = spaces[0], spaces[1], spaces[3]
    for _ in range(steps):
        _empty(table[k], given[k, :_GIVEN], calls, seconds)


class Spaces:
    """Physics spaces with the walls of ``levels`` levels for ``robots`` robots, created on demand.

    One unused space per level is kept in addition to those with robots; ``arrays`` are for :func:`move`.
    """

    def __init__(self, robots: int, levels: int = 1, *, radius_m: float, mass_kg: float, step_s: float) -> None:
        most = robots + levels
        self._robot = radius_m, mass_kg
        self.step_s = step_s
        self._spaces: list[_Space | None] = [None] * most
        table = np.zeros((most, 5), dtype=np.int64)
        # pymunk.batch counts a space's static body as its last one and needs room for one more.
        given, taken = np.zeros((most, 2 * _GIVEN)), np.zeros((most, 3 * _TAKEN))
        self._owners, self._levels = np.full(most, _FREE, dtype=np.int64), np.full(most, _NONE, dtype=np.int64)
        self._space_of = np.full(robots, _NONE, dtype=np.int64)
        calls = np.array([_address(ffi.addressof(lib, name)) for name in _CALLED], dtype=np.int64)
        self.arrays = table, given, taken, calls, self._owners, self._levels, self._space_of

    def __len__(self) -> int:
        return sum(space is not None for space in self._spaces)

    def provide(self, level: int, walls: NDArray[np.float64]) -> None:
        places = (level + np.arange(len(self._levels))) % len(self._levels)
        free = places[self._owners[places] == _FREE]
        k = int(free[(self._levels[free] != _NONE).argmin()])  # the first unused one, otherwise one of another level
        self._levels[k] = _NONE
        self._spaces[k] = None  # free its memory first
        self._spaces[k] = space = _Space(walls, *self._robot)
        table, given, taken = self.arrays[:3]
        table[k] = space.bind(given[k], taken[k])
        empty(self.arrays, k, _REMEMBERS, self.step_s)
        self._levels[k] = level

    def leave(self, robots: NDArray[np.int64]) -> None:
        """Remove robots (M,) from their spaces, without any trace of their contacts."""
        for k in self._space_of[robots].tolist():
            if k != _NONE:
                empty(self.arrays, k, _REMEMBERS, self.step_s)
                self._owners[k] = _FREE
        self._space_of[robots] = _NONE

    def delete_spaces(self, level: int) -> None:
        """Delete the spaces of a level, whose walls will change; no robot may be in them."""
        for k in np.flatnonzero(self._levels == level).tolist():
            self._levels[k], self._spaces[k] = _NONE, None


_open_spaces: weakref.WeakSet[pymunk.Space] = weakref.WeakSet()


@atexit.register
def _disown_open_spaces() -> None:
    """Cancel pymunk's destructors, which raise if they run after pymunk's modules have been cleared.

    Nothing is freed here, because a daemon thread may be in the middle of a step. The memory ends with the process.
    """
    for space in _open_spaces:
        bodies, shapes = [space.static_body, *space.bodies], space.shapes
        for pointer in (space._space, *(body._body for body in bodies), *(shape._shape for shape in shapes)):
            ffi.gc(pointer, None)


class _Space:
    """A pymunk space with walls and one robot, whose state is written to and read from rows of two arrays."""

    def __init__(self, walls: NDArray[np.float64], radius_m: float, mass_kg: float) -> None:
        self.space = space = pymunk.Space()
        space.collision_slop = _COLLISION_SLOP_M
        _open_spaces.add(space)
        # Static segments, created like in pymunk but without Python objects.
        static, handle = space.static_body._body, space._space
        shapes = [lib.cpSegmentShapeNew(static, (x0, y0), (x1, y1), 0.0) for x0, y0, x1, y1 in walls.tolist()]
        for shape in shapes:
            lib.cpSpaceAddShape(handle, shape)
        # Not at interpreter exit, when a daemon thread may be in the middle of a step.
        weakref.finalize(self, _remove_walls, space, shapes).atexit = False
        self._kept: list[Any] = []  # objects that Chipmunk refers to by address
        body = pymunk.Body(mass_kg, float("inf"))
        space.add(body, pymunk.Circle(body, radius_m))

    def bind(self, given: NDArray[np.float64], taken: NDArray[np.float64]) -> tuple[int, ...]:
        """Connect the space to the rows ``given`` (6,) and ``taken`` (4,), and return its row of the space table."""
        give, give_count = self._batched(_PLACE | pymunk.batch.BodyFields.FORCE, given)
        take, take_count = self._batched(_PLACE, taken)
        return _address(self.space._space), give, give_count, take, take_count

    def _batched(self, fields: pymunk.batch.BodyFields, memory: NDArray[np.float64]) -> tuple[int, int]:
        """Let a pymunk batch copy ``fields`` to or from ``memory``; return the addresses of its data and counter."""
        buffer = pymunk.batch.Buffer()
        buffer.set_float_buf(memory)
        data = ffi.new("pmBatchedData *")
        data.fields = fields.value
        array = data.floatArray = buffer._float_arr
        data.intArray = buffer._int_arr
        self._kept += [buffer, data, memory]
        return _address(data), _address(ffi.addressof(array, "num"))


def _remove_walls(space: pymunk.Space, shapes: list[Any]) -> None:
    """Free the segments' memory, before their space is freed."""
    for shape in shapes:
        lib.cpSpaceRemoveShape(space._space, shape)
        lib.cpShapeFree(shape)


def _address(pointer: Any) -> int:
    return int(ffi.cast("uintptr_t", pointer))
