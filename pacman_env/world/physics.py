"""The pymunk world: walls as static segments, robots as circle bodies, N games stepped together.

The only module that knows pymunk. Robots of one space touch walls but not one another, so that many games share a
space; beyond ``GAMES_PER_SPACE`` robots that start at one place the broad phase turns quadratic, so further games
get further spaces. Bodies are driven by forces, never by setting velocities: Chipmunk integrates positions first,
and a velocity written over the solver's result would push a body into the wall it touches.
"""

from __future__ import annotations

import numpy as np
import pymunk
import pymunk.batch
from numpy.typing import NDArray

GAMES_PER_SPACE = 64
STATE_FIELDS = 6  # x, y, angle, vx, vy, omega
FORCE_FIELDS = 3  # fx, fy, torque

_STATE = (
    pymunk.batch.BodyFields.POSITION
    | pymunk.batch.BodyFields.ANGLE
    | pymunk.batch.BodyFields.VELOCITY
    | pymunk.batch.BodyFields.ANGULAR_VELOCITY
)
_FORCE = pymunk.batch.BodyFields.FORCE | pymunk.batch.BodyFields.TORQUE

#: Overlap that the solver tolerates, m. Chipmunk's default of 0.1 is made for pixels.
_COLLISION_SLOP_M = 0.001


def moment_of_inertia(mass_kg: float, radius_m: float) -> float:
    """Of a full disc, kg m2."""
    return 0.5 * mass_kg * radius_m**2


class PhysicsWorld:
    """N robots among one set of walls.

    ``state`` (N, 6) holds x, y (m), angle (rad), vx, vy (m/s), omega (rad/s) after the last step; ``force`` (N, 3)
    holds fx, fy (N) and torque (N m) for the next one. Both are float64 and written in place.
    """

    def __init__(
        self, walls: NDArray[np.float64], n: int, *, radius_m: float, mass_kg: float, step_s: float
    ) -> None:
        """Build the spaces; ``walls`` is (S, 4): x0, y0, x1, y1 in m."""
        if n < 1:
            raise ValueError(f"n = {n}: a world holds at least one robot")
        self.n = n
        self.step_s = step_s
        self.state = np.zeros((n, STATE_FIELDS))
        self.force = np.zeros((n, FORCE_FIELDS))
        self._bodies: list[pymunk.Body] = []
        self._spaces: list[tuple[pymunk.Space, slice, pymunk.batch.Buffer, pymunk.batch.Buffer, NDArray]] = []
        inertia = moment_of_inertia(mass_kg, radius_m)
        only_walls = pymunk.ShapeFilter(group=1)
        for first in range(0, n, GAMES_PER_SPACE):
            last = min(first + GAMES_PER_SPACE, n)
            space = pymunk.Space()
            space.collision_slop = _COLLISION_SLOP_M
            segments = [pymunk.Segment(space.static_body, w[:2], w[2:], 0.0) for w in walls.tolist()]
            if segments:
                space.add(*segments)
            for _ in range(first, last):
                body = pymunk.Body(mass_kg, inertia)
                shape = pymunk.Circle(body, radius_m)
                shape.filter = only_walls
                space.add(body, shape)
                self._bodies.append(body)
            out = pymunk.batch.Buffer()
            forces = np.zeros((last - first + 1, FORCE_FIELDS))  # the static body is the last row
            into = pymunk.batch.Buffer()
            into.set_float_buf(forces)
            self._spaces.append((space, slice(first, last), out, into, forces))

    def place(self, index: int, x: float, y: float, angle: float) -> None:
        """Put one robot somewhere, at rest."""
        body = self._bodies[index]
        body.position = (x, y)
        body.angle = angle
        body.velocity = (0.0, 0.0)
        body.angular_velocity = 0.0
        self.state[index] = (x, y, angle, 0.0, 0.0, 0.0)
        self.force[index] = 0.0

    def step(self) -> None:
        """Apply ``force``, advance by one step, write ``state``."""
        for space, rows, out, into, forces in self._spaces:
            forces[:-1] = self.force[rows]
            pymunk.batch.set_space_bodies(space, _FORCE, into)
            space.step(self.step_s)
            out.clear()
            pymunk.batch.get_space_bodies(space, _STATE, out)
            count = rows.stop - rows.start
            flat = np.frombuffer(out.float_buf(), dtype=np.float64, count=count * STATE_FIELDS)
            self.state[rows] = flat.reshape(count, STATE_FIELDS)

    def deepest_contact(self) -> float:
        """Depth of the deepest overlap of a robot with a wall now, m (0: none)."""
        deepest = 0.0
        for space, *_ in self._spaces:
            data = pymunk.batch.Buffer()
            fields = pymunk.batch.ArbiterFields.CONTACT_COUNT | pymunk.batch.ArbiterFields.DISTANCE_1
            pymunk.batch.get_space_arbiters(space, fields, data)
            distances = np.frombuffer(data.float_buf(), dtype=np.float64)
            if len(distances):
                deepest = max(deepest, -float(distances.min()))
        return deepest

    def bare_steps(self, count: int) -> None:
        """Step every space ``count`` times and do nothing else: the benchmark's yardstick."""
        for _ in range(count):
            for space, *_ in self._spaces:
                space.step(self.step_s)
