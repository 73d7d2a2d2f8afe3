"""Simulate a robot among walls with Chipmunk, the engine of pymunk; no other module uses pymunk.

A robot only touches walls. While it touches none, Chipmunk's step is two lines of arithmetic, which :func:`move` does
itself with the same bits. Otherwise :func:`_contact_step` lets Chipmunk do the step in a space that contains the robot
and the walls that it touches. The space keeps nothing for the next step. Bodies are driven by forces, never by setting
velocities, which would push a body into the wall that it touches.
"""

import weakref
from typing import Any, NamedTuple

import numpy as np
from pymunk._chipmunk_cffi import ffi, lib
from pymunk.batch import BodyFields, Buffer

from ...engine.arrays import Array, Table, arrays_by_address
from ...engine.jit import kernel, table_kernel
from ...engine.native import address_of, address_of_kernel, call_pair, call_range, call_segment, call_step, store_int
from .grid import cell_of
from .localization import record_fields

BODY_FIELDS = [
    *record_fields(np.float64, "body_x body_y body_vx body_vy"),  # after the last step, m, m/s
    *record_fields(np.float64, "force_x force_y"),  # force for the next step, N
]
_MOST_TOUCHED = 64  # walls; more only touch a robot that stands in the middle of a wall
_COLLISION_SLOP_M = 0.001  # overlap that the solver tolerates; Chipmunk's default of 0.1 is for pixels
_PLACE = BodyFields.POSITION | BodyFields.VELOCITY
#: Chipmunk's functions by their column in ``ContactArrays.calls``.
_SET_ENDS, _ADD, _REMOVE, _GIVE, _STEP, _TAKE = range(6)
_CALLED = (
    *("cpSegmentShapeSetEndpoints", "cpSpaceAddShape", "cpSpaceRemoveShape"),
    *("pmSpaceBodySetIteratorFuncBatched", "cpSpaceStep", "pmSpaceBodyGetIteratorFuncBatched"),
)
HANDLES = np.dtype(
    [
        *((name, np.int64) for name in ("space", "body", "circle", "given", "given_count", "taken", "taken_count")),
        ("step_s", np.float64),  # length of a step
    ]
)


class ContactArrays(NamedTuple):
    """Arrays of a step with contacts, for one thread."""

    walls: Any = Array(np.float64, f"{_MOST_TOUCHED} 4")  # m, the walls that the robot touches
    # pymunk moves an array to other memory unless there is room for one more body.
    given: Any = Array(np.float64, "12")  # position, velocity and force of the body before the step
    taken: Any = Array(np.float64, "8")  # position and velocity after the step
    handles: Any = Array(HANDLES, "1")  # addresses of Chipmunk's objects, and of the data of pymunk's batches
    segments: Any = Array(np.int64, f"{_MOST_TOUCHED}")  # addresses of Chipmunk's shapes of walls
    calls: Any = Array(np.int64, f"{len(_CALLED)}")  # addresses of Chipmunk's functions


_arrays = arrays_by_address(ContactArrays)
#: A contact solver for :func:`move`: addresses of its kernel ``(table, number of touched walls, 0)`` and its table.
SOLVER = np.dtype([("function", np.int64), ("table", np.int64)])


@kernel
def place(g, x, y):  # type: ignore[no-untyped-def]
    """Place a robot at (x, y), m, at rest."""
    g.body_x, g.body_y, g.body_vx, g.body_vy = x, y, 0.0, 0.0
    g.force_x = g.force_y = 0.0


@kernel
def copy_touched(walls, x, y, radius, copies):  # type: ignore[no-untyped-def]
    """Copy the walls (S, 4) within ``radius`` m of (x, y) to ``copies`` (M, 4), at most M; return their number."""
    count = 0
    for k in range(len(walls)):
        ax, ay, bx, by = walls[k, 0], walls[k, 1], walls[k, 2], walls[k, 3]
        if min(ax, bx) > x + radius or max(ax, bx) < x - radius or min(ay, by) > y + radius or max(ay, by) < y - radius:
            continue
        dx, dy, px, py = bx - ax, by - ay, x - ax, y - ay
        along = min(max((px * dx + py * dy) / max(dx * dx + dy * dy, 1e-12), 0.0), 1.0)
        px, py = px - along * dx, py - along * dy
        if px * px + py * py <= radius * radius and count < len(copies):
            copies[count, 0], copies[count, 1], copies[count, 2], copies[count, 3] = ax, ay, bx, by
            count += 1
    return count


@kernel
def move(g, level, p, solver):  # type: ignore[no-untyped-def]
    """Move the body of robot ``g`` by one physics step under its force.

    ``level`` has ``affine`` (6,), which maps m to cells, ``clear`` (H, W), which is True for cells in which the robot
    touches no wall, and ``walls`` (S, 4), m. ``p`` has ``dt``, ``per_mass`` and ``radius_m``, and ``solver`` is a
    ``SOLVER``.
    """
    # Chipmunk's cpBodyUpdatePosition and cpBodyUpdateVelocity without damping, gravity and contacts.
    x, y = g.body_x + g.body_vx * p.dt, g.body_y + g.body_vy * p.dt
    column, row = cell_of(level.affine, level.clear.shape[0], level.clear.shape[1], x, y)
    if not level.clear[row, column]:
        contact = _arrays(solver.table)
        touched = copy_touched(level.walls, x, y, p.radius_m, contact.walls)
        if touched > 0:
            body, result = contact.given, contact.taken
            body[0], body[1], body[2], body[3] = g.body_x, g.body_y, g.body_vx, g.body_vy
            body[4], body[5] = g.force_x, g.force_y
            call_range(solver.function, solver.table, touched, 0)
            g.body_x, g.body_y, g.body_vx, g.body_vy = result[0], result[1], result[2], result[3]
            return
    g.body_x, g.body_y = x, y
    g.body_vx += g.force_x * p.per_mass * p.dt
    g.body_vy += g.force_y * p.per_mass * p.dt


@table_kernel
def _contact_step(table, touched, unused):  # type: ignore[no-untyped-def]
    """Move the body in ``given`` by one step among the first ``touched`` walls, and write it to ``taken``; return 0."""
    a = _arrays(table)
    handles, calls = a.handles[0], a.calls
    _give(handles, calls)
    # Chipmunk's order of contacts depends on where its shapes were before, so all are added for this step only.
    call_pair(calls[_ADD], handles.space, handles.circle)
    for k in range(touched):
        call_segment(calls[_SET_ENDS], a.segments[k], address_of(a.walls[k]))
        call_pair(calls[_ADD], handles.space, a.segments[k])
    call_step(calls[_STEP], handles.space, handles.step_s)
    for k in range(touched):  # this also removes the contacts
        call_pair(calls[_REMOVE], handles.space, a.segments[k])
    call_pair(calls[_REMOVE], handles.space, handles.circle)
    _take(handles, calls)
    # Chipmunk corrects an overlap at the start of the next step, which this one is for a body at rest.
    vx, vy = a.taken[2], a.taken[3]
    a.given[0], a.given[1] = a.taken[0], a.taken[1]
    for k in range(2, 6):
        a.given[k] = 0.0
    _give(handles, calls)
    call_step(calls[_STEP], handles.space, handles.step_s)
    _take(handles, calls)
    a.taken[2], a.taken[3] = vx, vy
    return 0


@kernel
def _give(handles, calls):  # type: ignore[no-untyped-def]
    """Copy ``given`` to Chipmunk's body."""
    store_int(handles.given_count, 0)
    call_pair(calls[_GIVE], handles.body, handles.given)


@kernel
def _take(handles, calls):  # type: ignore[no-untyped-def]
    """Copy Chipmunk's body to ``taken``."""
    store_int(handles.taken_count, 0)
    call_pair(calls[_TAKE], handles.body, handles.taken)


class Contacts:
    """A Chipmunk space for the contacts of one robot at a time; each thread needs one.

    ``solver`` (1,) of type ``SOLVER`` is for :func:`move` while this object exists.
    """

    def __init__(self, *, radius_m: float, mass_kg: float, step_s: float) -> None:
        space = lib.cpSpaceNew()
        lib.cpSpaceSetCollisionSlop(space, _COLLISION_SLOP_M)
        body = lib.cpSpaceAddBody(space, lib.cpBodyNew(mass_kg, float("inf")))
        circle = lib.cpCircleShapeNew(body, radius_m, (0.0, 0.0))
        still = lib.cpSpaceGetStaticBody(space)
        segments = [lib.cpSegmentShapeNew(still, (0.0, 0.0), (1.0, 0.0), 0.0) for _ in range(_MOST_TOUCHED)]
        # The objects are made without pymunk's classes, whose destructors raise errors at interpreter exit.
        weakref.finalize(self, _free, space, body, [circle, *segments]).atexit = False
        self._table = Table(
            ContactArrays,
            walls=np.zeros((_MOST_TOUCHED, 4)),
            given=np.zeros(12),
            taken=np.zeros(8),
            handles=np.zeros(1, dtype=HANDLES),
            segments=np.array([_address(segment) for segment in segments], dtype=np.int64),
            calls=np.array([_address(ffi.addressof(lib, name)) for name in _CALLED], dtype=np.int64),
        )
        self._kept: list[Any] = []  # objects that Chipmunk refers to by address
        give = self._batched(_PLACE | BodyFields.FORCE, "given")
        take = self._batched(_PLACE, "taken")
        self._table.arrays["handles"][0] = (*map(_address, (space, body, circle)), *give, *take, step_s)
        self.solver = np.array([(address_of_kernel(_contact_step), self._table.address)], dtype=SOLVER)

    def _batched(self, fields: BodyFields, name: str) -> tuple[int, int]:
        """Let a pymunk batch copy ``fields`` to or from an array; return the addresses of its data and counter."""
        buffer = Buffer()
        buffer.set_float_buf(self._table.arrays[name])
        data = ffi.new("pmBatchedData *")
        data.fields = fields.value
        array = data.floatArray = buffer._float_arr
        data.intArray = buffer._int_arr
        self._kept += [buffer, data]
        return _address(data), _address(ffi.addressof(array, "num"))


def _free(space: Any, body: Any, shapes: list[Any]) -> None:
    """Free Chipmunk's objects: first the space, which still changes the body that it contains."""
    lib.cpSpaceFree(space)
    lib.cpBodyFree(body)
    for shape in shapes:
        lib.cpShapeFree(shape)


def _address(pointer: Any) -> int:
    return int(ffi.cast("uintptr_t", pointer))
