"""The pymunk world: walls as static segments, robots as circle bodies, N games stepped together.

The only module that knows pymunk. Robots of one space touch walls but not one another, so that many games share a
space; beyond ``GAMES_PER_SPACE`` robots that start at one place the broad phase turns quadratic, so further games
get further spaces. Bodies are driven by forces, never by setting velocities: Chipmunk integrates positions first,
and a velocity written over the solver's result would push a body into the wall it touches.
"""

from __future__ import annotations

import weakref
from typing import Any

import numpy as np
import pymunk
import pymunk.batch
from numpy.typing import NDArray
from pymunk._chipmunk_cffi import ffi, lib

GAMES_PER_SPACE = 64
STATE_FIELDS = 4  # x, y, vx, vy
FORCE_FIELDS = 2  # fx, fy

_STATE = pymunk.batch.BodyFields.POSITION | pymunk.batch.BodyFields.VELOCITY
_FORCE = pymunk.batch.BodyFields.FORCE

#: Overlap that the solver tolerates, m. Chipmunk's default of 0.1 is made for pixels.
_COLLISION_SLOP_M = 0.001


class PhysicsWorld:
    """N robots among one set of walls.

    Robot i owns row ``row[i]`` of ``state`` (4 columns: x, y in m, vx, vy in m/s after the last step) and of
    ``force`` (2 columns: fx, fy in N for the next one), both float64. Headings are not physics' business: a disc
    without friction gets no torque from a wall, so its wheels alone turn it.
    """

    def __init__(
        self,
        walls: NDArray[np.float64],
        n: int,
        *,
        radius_m: float,
        mass_kg: float,
        step_s: float,
        shared: bool = True,
    ) -> None:
        """Build the spaces.

        Args:
            walls: (S, 4): x0, y0, x1, y1 in m.
            n: number of robots.
            radius_m: of each robot.
            mass_kg: of each robot.
            step_s: length of a step.
            shared: all robots keep these walls; False: each has a space and, by :meth:`place`, walls of its own.
        """
        if n < 1:
            raise ValueError(f"n = {n}: a world holds at least one robot")
        self.n = n
        self.step_s = step_s
        self._robot = radius_m, mass_kg
        self._shared = shared
        self._per_space = GAMES_PER_SPACE if shared else 1
        # pymunk.batch counts each space's static body as its last row: one spare row per space.
        self.row = np.arange(n) + np.arange(n) // self._per_space
        rows = int(self.row[-1]) + 3  # one more at the end: see _Space
        self.state = np.zeros((rows, STATE_FIELDS))
        self.force = np.zeros((rows, FORCE_FIELDS))
        self._spaces = [self._space(first, walls) for first in range(0, n, self._per_space)]

    def _space(self, first: int, walls: NDArray[np.float64]) -> _Space:
        """The space of the robots from ``first`` on."""
        count = min(self._per_space, self.n - first)
        rows = slice(self.row[first], self.row[first] + count + 1)
        return _Space(walls, count, self.state[rows], self.force[rows], *self._robot)

    def place(self, index: int, x: float, y: float, walls: NDArray[np.float64] | None = None) -> None:
        """Put one robot somewhere, at rest; where walls are not shared, among other walls if they are given."""
        number, place = divmod(index, self._per_space)
        if not self._shared and walls is not None and walls is not self._spaces[number].walls:
            self._spaces[number] = self._space(index, walls)
        body = self._spaces[number].bodies[place]
        body.velocity = (0.0, 0.0)
        # Moves by, and so forgets, what the solver has left over to push the body out of a wall it touched.
        pymunk.Body.update_position(body, self.step_s)
        body.position = (x, y)
        self.state[self.row[index]] = (x, y, 0.0, 0.0)
        self.force[self.row[index]] = 0.0

    def step(self) -> None:
        """Apply ``force``, advance by one step, write ``state``."""
        for space in self._spaces:
            space.step(self.step_s)

    def step_some(self, awake: NDArray[np.bool_]) -> None:
        """A step of the robots ``awake`` (N,) alone; only where walls are not shared."""
        for k in np.flatnonzero(awake).tolist():
            self._spaces[k].step(self.step_s)

    def deepest_contact(self) -> float:
        """Depth of the deepest overlap of a robot with a wall now, m (0: none)."""
        return max(space.deepest_contact() for space in self._spaces)

    def bare_steps(self, count: int, speed_mps: float) -> None:
        """Step every space ``count`` times and do nothing else: the benchmark's yardstick.

        The bodies start from where they are, in directions all round, and bounce, so that they keep moving.
        """
        for i, body in enumerate(body for space in self._spaces for body in space.bodies):
            body.velocity = pymunk.Vec2d(speed_mps, 0.0).rotated(2.399963 * i)  # golden angle
        for space in self._spaces:
            space.bounce()
        for _ in range(count):
            for space in self._spaces:
                space.space.step(self.step_s)


def _batched(function: str, fields: pymunk.batch.BodyFields, buffer: pymunk.batch.Buffer) -> tuple[Any, Any, Any]:
    """The arguments that ``pymunk.batch.get_space_bodies`` or ``set_space_bodies`` makes at each call, made once.

    Returns:
        The C function that visits a body, its data, and the array whose counter says where the data begin.
    """
    data = ffi.new("pmBatchedData *")
    data.fields = fields.value
    array = data.floatArray = buffer._float_arr
    data.intArray = buffer._int_arr
    return ffi.addressof(lib, function), data, array


def _add_walls(space: pymunk.Space, walls: NDArray[np.float64]) -> list[Any]:
    """Static segments as pymunk makes them, without an object of Python's for each: they are never asked for."""
    body, handle = space.static_body._body, space._space
    shapes = [lib.cpSegmentShapeNew(body, (x0, y0), (x1, y1), 0.0) for x0, y0, x1, y1 in walls.tolist()]
    for shape in shapes:
        lib.cpSpaceAddShape(handle, shape)
    return shapes


def _remove_walls(space: pymunk.Space, shapes: list[Any]) -> None:
    """Give the segments' memory back, before their space goes."""
    for shape in shapes:
        lib.cpSpaceRemoveShape(space._space, shape)
        lib.cpShapeFree(shape)


class _Space:
    """One pymunk space with up to ``GAMES_PER_SPACE`` robots; reads and writes its rows of the world's arrays."""

    def __init__(
        self,
        walls: NDArray[np.float64],
        count: int,
        state: NDArray[np.float64],
        force: NDArray[np.float64],
        radius_m: float,
        mass_kg: float,
    ) -> None:
        self.walls = walls
        space = pymunk.Space()
        space.collision_slop = _COLLISION_SLOP_M
        self._walls = _add_walls(space, walls)
        weakref.finalize(self, _remove_walls, space, self._walls)
        self.bodies = []
        only_walls = pymunk.ShapeFilter(group=1)
        for _ in range(count):
            body = pymunk.Body(mass_kg, float("inf"))
            shape = pymunk.Circle(body, radius_m)
            shape.filter = only_walls
            space.add(body, shape)
            self.bodies.append(body)
        self.space = space
        # Both buffers are the world's own arrays, as long as the bodies have numbers: pymunk reads and writes in place.
        self._buffers = pymunk.batch.Buffer(), pymunk.batch.Buffer()
        for buffer, array in zip(self._buffers, (force, state), strict=True):
            buffer.set_float_buf(array)
        set_force, data_in, array_in = _batched("pmSpaceBodySetIteratorFuncBatched", _FORCE, self._buffers[0])
        get_state, data_out, array_out = _batched("pmSpaceBodyGetIteratorFuncBatched", _STATE, self._buffers[1])
        array_out.max += STATE_FIELDS  # pymunk would make room for another body before there is one
        each, advance, handle = lib.cpSpaceEachBody, lib.cpSpaceStep, space._space

        def step(step_s: float) -> None:
            """Apply the forces, advance, write the states: the three C calls of a step with all else made before."""
            array_in.num = 0
            each(handle, set_force, data_in)
            advance(handle, step_s)
            array_out.num = 0
            each(handle, get_state, data_out)

        self.step = step

    def bounce(self) -> None:
        """Make robots and walls elastic."""
        for shape in self.space.shapes:
            shape.elasticity = 1.0
        for wall in self._walls:
            lib.cpShapeSetElasticity(wall, 1.0)

    def deepest_contact(self) -> float:
        data = pymunk.batch.Buffer()
        pymunk.batch.get_space_arbiters(self.space, pymunk.batch.ArbiterFields.DISTANCE_1, data)
        distances = np.frombuffer(data.float_buf(), dtype=np.float64)
        return max(0.0, -float(distances.min())) if len(distances) else 0.0
