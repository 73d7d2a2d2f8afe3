import math
import os
import platform
import subprocess
import sys
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pymunk
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pacman_env.config import Config
from pacman_env.sim.parameters import GAME, batch_parameters
from pacman_env.world.navigation.physics import Contacts, copy_touched, move, place
from pacman_env.world.navigation.walls import clear_cells, overlap_m

CONFIG = Config()
ROBOT, STEP_S = CONFIG.robot, CONFIG.physics_step_s
#: A square room of 4 m around the origin with a corner that juts in.
CORNERS = np.array([(-2, -2), (2, -2), (2, 2), (0.5, 2), (0.5, 0.5), (0, 0.5), (0, 2), (-2, 2)], dtype=np.float64)
WALLS = np.concatenate([CORNERS, np.roll(CORNERS, -1, axis=0)], axis=1)
AFFINE = np.array([20.0, 0.0, 50.0, 0.0, 20.0, 50.0])  # cells of 5 cm, 100 x 100 of them
BODY = {"radius_m": ROBOT.radius_m, "mass_kg": ROBOT.mass_kg, "step_s": STEP_S}


class Room(NamedTuple):
    """What ``move`` reads of a level."""

    affine: np.ndarray
    clear: np.ndarray
    walls: np.ndarray


ROOM = Room(AFFINE, clear_cells(WALLS, AFFINE, (100, 100), 0.05, ROBOT.radius_m), WALLS)


class Robots:
    """N robots among the walls of the room."""

    def __init__(self, *starts: Any) -> None:
        self.games = np.zeros(len(starts), dtype=GAME)
        self.contacts = Contacts(**BODY)
        self.parameters = batch_parameters(CONFIG, 0.05, 1, 0)[0]
        for i, (x, y) in enumerate(starts):
            self.place(i, x, y)

    def place(self, i: int, x: float, y: float) -> None:
        place(self.games[i], x, y)

    def step(self) -> None:
        for g in self.games:
            move(g, ROOM, self.parameters, self.contacts.solver[0])

    def push(self, force: Any) -> None:
        self.games["force_x"], self.games["force_y"] = np.broadcast_to(force, (len(self.games), 2)).T
        self.step()

    def drive(self, velocity: Any) -> None:
        """The force that gives each body the velocity wished for, as the controller computes it."""
        self.push(ROBOT.mass_kg * (np.asarray(velocity) - self.state[:, 2:]) / STEP_S)

    @property
    def state(self) -> np.ndarray:
        return np.stack([self.games[name] for name in ("body_x", "body_y", "body_vx", "body_vy")], axis=1)

    def depth(self) -> float:
        return float(overlap_m(WALLS, self.state[:, :2], ROBOT.radius_m).max())


def test_pushing_robot_enters_a_wall_by_a_centimetre() -> None:
    robots = Robots(*((-2 + ROBOT.radius_m + 0.002 * i, -1.0) for i in range(4)))
    deepest = 0.0
    for _ in range(40):
        robots.push((-ROBOT.mass_kg * ROBOT.wheel_acceleration_mps2, 0.0))
        deepest = max(deepest, robots.depth())
    assert 0.0 < deepest <= 0.01
    assert (np.abs(robots.state[:, 2]) < 0.05).all()


def test_wall_stops_and_pushes_out_a_robot() -> None:
    speed = 0.46
    robots = Robots(*((-1.6 + 0.003 * i, 0.0) for i in range(20)))
    angle = np.linspace(-0.8, 0.8, 20)
    depths = []
    for _ in range(70):
        robots.drive(-speed * np.stack([np.cos(angle), np.sin(angle)], axis=1))
        depths.append(robots.depth())
    assert 0.0 < max(depths) <= speed * STEP_S + 0.002
    assert max(depths[-20:]) <= 0.002  # 1 mm is what the solver tolerates


def test_robot_slides_along_a_wall() -> None:
    robots = Robots((-1.5, -1.0))
    for _ in range(100):
        robots.drive([[-0.2, 0.2]])
    x, y, _, vy = robots.state[0]
    assert x == pytest.approx(-2 + ROBOT.radius_m, abs=0.01)
    assert y > -0.3
    assert vy == pytest.approx(0.2, abs=1e-6)


@pytest.mark.skipif(platform.machine() not in ("x86_64", "AMD64"), reason="other compilers fuse products and sums")
@settings(max_examples=25, deadline=None)
@given(
    start=st.tuples(st.floats(-1.7, -0.3), st.floats(-1.7, 1.7)),
    forces=st.lists(st.tuples(st.floats(-15, 15), st.floats(-15, 15), st.integers(1, 25)), min_size=3, max_size=12),
)
def test_step_far_from_walls_is_chipmunks_own(
    start: tuple[float, float], forces: list[tuple[float, float, int]]
) -> None:
    ours = Robots(start)
    space = pymunk.Space()
    body = pymunk.Body(ROBOT.mass_kg, float("inf"))
    circle = pymunk.Circle(body, ROBOT.radius_m)
    space.add(body, circle)
    body.position = start
    for fx, fy, steps in forces:
        for _ in range(steps):
            ours.push((fx, fy))
            if ours.depth() > -0.05:  # from here on there are walls
                return
            body.force = fx, fy
            space.step(STEP_S)
            assert ours.state[0].tolist() == [*body.position, *body.velocity]


def chipmunk_room(walls: np.ndarray) -> tuple[pymunk.Space, pymunk.Body]:
    """Return pymunk's own space with all walls and a body of the robot."""
    space = pymunk.Space()
    space.collision_slop = 0.001
    body = pymunk.Body(ROBOT.mass_kg, float("inf"))
    space.add(body, pymunk.Circle(body, ROBOT.radius_m))
    space.add(*(pymunk.Segment(space.static_body, (x0, y0), (x1, y1), 0.0) for x0, y0, x1, y1 in walls.tolist()))
    return space, body


@settings(max_examples=30, deadline=None)
@given(
    x=st.floats(-2 + ROBOT.radius_m - 0.01, -2 + ROBOT.radius_m),
    y=st.floats(-2 + ROBOT.radius_m - 0.01, 1.7),
    force=st.tuples(st.floats(-15, 15), st.floats(-15, 15)),
)
def test_velocity_after_a_contact_is_chipmunks_own(x: float, y: float, force: tuple[float, float]) -> None:
    ours = Robots((x, y))
    ours.push(force)
    space, body = chipmunk_room(WALLS)
    body.position, body.force = (x, y), force
    space.step(STEP_S)
    np.testing.assert_allclose(ours.state[0, 2:], body.velocity, atol=1e-12)


def test_long_contact_follows_chipmunks_own() -> None:
    ours = Robots((-1.5, -1.0))
    space, body = chipmunk_room(WALLS)
    body.position = -1.5, -1.0
    for k in range(300):
        wanted = np.array([-0.3 * math.cos(k / 40), 0.3 * math.sin(k / 25)])
        ours.drive(wanted)
        body.force = tuple(ROBOT.mass_kg * (wanted - body.velocity) / STEP_S)
        space.step(STEP_S)
    np.testing.assert_allclose(ours.state[0, :2], body.position, atol=0.005)


@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 10_000))
def test_robot_does_not_depend_on_earlier_contacts(seed: int) -> None:
    rng = np.random.default_rng(seed)
    corner = np.array([0.5 + ROBOT.radius_m, 0.5 + ROBOT.radius_m])  # robots in a narrow corner touch several walls
    starts, speeds = rng.uniform(-1.75, -0.25, (5, 2)), rng.uniform(-0.4, 0.4, (12, 5, 2))
    starts[3:] = corner - [[0.0, 2.0], [2.0, 0.0]]
    together, alone = Robots(*starts.tolist()), [Robots(start) for start in starts.tolist()]
    for speed in speeds:
        for _ in range(20):
            together.drive(speed)
            for i, one in enumerate(alone):
                one.drive(speed[i])
        np.testing.assert_array_equal(together.state, np.concatenate([one.state for one in alone]))


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 10_000))
def test_step_among_many_walls_does_not_depend_on_the_last(seed: int) -> None:
    rng = np.random.default_rng(seed)
    walls = np.concatenate([WALLS, rng.uniform(-1.0, 1.0, (12, 4))])
    room = ROOM._replace(walls=walls, clear=np.zeros_like(ROOM.clear))
    robot = Robots((0.0, 0.0))
    for _ in range(20):
        x, y = rng.uniform(-1.0, 1.0, 2)
        for off in (0.0, 0.003):
            robot.place(0, x + off, y)
            robot.games["body_vx"], robot.games["force_y"] = 0.2, 3.0
            fresh = Robots((x, y))
            fresh.games[:] = robot.games
            for one in (robot, fresh):
                move(one.games[0], room, one.parameters, one.contacts.solver[0])
            np.testing.assert_array_equal(robot.state, fresh.state)


def test_placing_a_robot_stops_it() -> None:
    robots = Robots((-1.7, -1.0))
    for _ in range(30):
        robots.drive([[-0.3, 0.1]])
    robots.place(0, -1.5, -1.5)
    robots.push((0.0, 0.0))
    assert robots.state[0].tolist() == [-1.5, -1.5, 0.0, 0.0]


@settings(max_examples=50, deadline=None)
@given(x=st.floats(-2.4, 2.4), y=st.floats(-2.4, 2.4))
def test_touched_walls_are_those_in_reach(x: float, y: float) -> None:
    copies = np.zeros((len(WALLS), 4))
    count = copy_touched(WALLS, x, y, ROBOT.radius_m, copies)
    reached = [overlap_m(wall[None], np.array([[x, y]]), ROBOT.radius_m)[0] >= 0.0 for wall in WALLS]
    np.testing.assert_array_equal(copies[:count], WALLS[reached])


def test_no_more_walls_are_copied_than_fit() -> None:
    copies = np.zeros((1, 4))
    assert copy_touched(WALLS, -2.0, -2.0, ROBOT.radius_m, copies) == 1
    np.testing.assert_array_equal(copies[0], WALLS[0])


#: Frees many spaces after a contact in each.
FREED_CONTACTS = """
import numpy as np
from tests.world.navigation.test_physics import ROBOT, Robots
for _ in range(200):
    robots = Robots((-2 + ROBOT.radius_m - 0.001, -1.0))
    robots.push((1.0, 0.0))
    del robots
print("freed")
"""
#: A kernel of a script keeps the script's globals until pymunk's modules have been cleared.
GLOBAL_CONTACTS = """
import pacman_env
import numba
from pacman_env.world.navigation.physics import Contacts
kernel = numba.njit(lambda x: x)
kernel(1)
contacts = [Contacts(radius_m=0.17, mass_kg=1.0, step_s=0.05) for _ in range(4)]
print(len(contacts))
"""


def test_freed_contacts_leave_memory_intact() -> None:
    root = Path(__file__).resolve().parents[3]
    environment = {**os.environ, "MALLOC_PERTURB_": "165", "MALLOC_CHECK_": "3"}  # glibc fills and checks freed memory
    done = subprocess.run(
        [sys.executable, "-c", FREED_CONTACTS], cwd=root, env=environment, capture_output=True, text=True
    )
    assert (done.returncode, done.stdout) == (0, "freed\n"), done.stderr


def test_contacts_in_globals_end_silently_with_the_interpreter() -> None:
    root = Path(__file__).resolve().parents[3]
    done = subprocess.run([sys.executable, "-c", GLOBAL_CONTACTS], cwd=root, capture_output=True, text=True)
    assert (done.returncode, done.stdout, done.stderr) == (0, "4\n", "")
