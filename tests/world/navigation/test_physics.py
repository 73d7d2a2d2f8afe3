import platform
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pymunk
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pacman_env.config import Config
from pacman_env.sim.core.parameters import GAME, batch_parameters
from pacman_env.world.navigation.physics import Spaces, clear_cells, move, overlap_m, place

CONFIG = Config()
ROBOT, STEP_S = CONFIG.robot, CONFIG.physics_step_s
#: A square room of 4 m around the origin with a corner that juts in.
CORNERS = np.array([(-2, -2), (2, -2), (2, 2), (0.5, 2), (0.5, 0.5), (0, 0.5), (0, 2), (-2, 2)], dtype=np.float64)
WALLS = np.concatenate([CORNERS, np.roll(CORNERS, -1, axis=0)], axis=1)
AFFINE = np.array([20.0, 0.0, 50.0, 0.0, 20.0, 50.0])  # cells of 5 cm, 100 x 100 of them
CLEAR = clear_cells(WALLS, AFFINE, (100, 100), 0.05, ROBOT.radius_m)
BODY = {"radius_m": ROBOT.radius_m, "mass_kg": ROBOT.mass_kg, "step_s": STEP_S}


class Robots:
    """N robots among the walls of the room."""

    def __init__(self, *starts: Any) -> None:
        n = len(starts)
        self.games = np.zeros(n, dtype=GAME)
        self.spaces = Spaces(n, **BODY)
        self.parameters = batch_parameters(CONFIG, 0.05, 1, 0)[0]
        self.chipmunk_steps = 0
        for i, (x, y) in enumerate(starts):
            self.place(i, x, y)

    def place(self, i: int, x: float, y: float) -> None:
        self.spaces.leave(np.array([i]))
        place(self.games[i], x, y)

    def step(self) -> None:
        for i, g in enumerate(self.games):
            while not move(g, i, 0, AFFINE, CLEAR, self.parameters, self.spaces.arrays):
                self.spaces.provide(0, WALLS)
            self.chipmunk_steps += bool(g["touch"])

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
            if ours.games["touch"][0]:  # from here on there are walls
                return
            body.force = fx, fy
            space.step(STEP_S)
            assert ours.state[0].tolist() == [*body.position, *body.velocity]
            assert len(ours.spaces) == 0


@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 10_000))
def test_robot_does_not_depend_on_its_spaces_past(seed: int) -> None:
    rng = np.random.default_rng(seed)
    starts, speeds = rng.uniform(-1.75, -0.25, (5, 2)), rng.uniform(-0.4, 0.4, (12, 5, 2))
    together, fewer = Robots(*starts.tolist()), [Robots(start) for start in starts.tolist()]
    for k, speed in enumerate(speeds):
        for _ in range(20):
            together.drive(speed)
            for i, one in enumerate(fewer):
                one.drive(speed[i])
        if k % 4 == 3:  # somebody begins again, in the middle of a contact perhaps
            i = int(rng.integers(5))
            together.place(i, *starts[i].tolist())
            fewer[i].place(0, *starts[i].tolist())
        np.testing.assert_array_equal(together.state, np.concatenate([one.state for one in fewer]))


def test_fewer_spaces_than_robots_are_handed_on() -> None:
    robots = Robots(*[(-1.0, -1.0)] * 6)
    for i in range(6):  # one after the other goes to the wall and comes back
        for sign in (-1, 1):
            for _ in range(70):
                velocity = np.zeros((6, 2))
                velocity[i, 0] = sign * 0.3
                robots.drive(velocity)
    assert robots.chipmunk_steps > 100
    assert len(robots.spaces) == 1


def test_placing_a_robot_stops_it() -> None:
    robots = Robots((-1.7, -1.0))
    for _ in range(30):
        robots.drive([[-0.3, 0.1]])
    robots.place(0, -1.5, -1.5)
    robots.push((0.0, 0.0))
    assert robots.state[0].tolist() == [-1.5, -1.5, 0.0, 0.0]


@settings(max_examples=20, deadline=None)
@given(x=st.floats(-2.4, 2.4), y=st.floats(-2.4, 2.4))
def test_clear_cells_have_no_wall_in_reach(x: float, y: float) -> None:
    column, row = int(20 * x + 50), int(20 * y + 50)
    if CLEAR[row, column]:
        corners = np.array([((column + dx - 50) / 20, (row + dy - 50) / 20) for dx in (0, 1) for dy in (0, 1)])
        assert (overlap_m(WALLS, np.concatenate([corners, [[x, y]]]), ROBOT.radius_m) < 0).all()


def test_only_cells_near_walls_are_not_clear() -> None:
    centres = np.stack(np.meshgrid((np.arange(100) - 49.5) / 20, (np.arange(100) - 49.5) / 20), axis=-1).reshape(-1, 2)
    away = -overlap_m(WALLS, centres, ROBOT.radius_m).reshape(100, 100)
    inner = np.s_[1:-1, 1:-1]
    assert CLEAR[inner][away[inner] > 0.04].all()
    assert not CLEAR[away < 0.035].any()


#: A kernel of a script keeps the script's globals, and so the spaces, until pymunk's modules have been cleared.
GLOBAL_SPACES = """
import numpy as np
import pacman_env
import numba
from pacman_env.world.navigation.physics import Spaces
kernel = numba.njit(lambda x: x)
kernel(1)
walls = np.array([[-2.0, -2.0, 2.0, -2.0]])
spaces = Spaces(4, levels=4, radius_m=0.17, mass_kg=1.0, step_s=0.05)
for level in range(4):
    spaces.provide(level, walls)
print(len(spaces))
"""


def test_spaces_in_globals_end_silently_with_the_interpreter() -> None:
    root = Path(__file__).resolve().parents[3]
    done = subprocess.run([sys.executable, "-c", GLOBAL_SPACES], cwd=root, capture_output=True, text=True)
    assert (done.returncode, done.stdout, done.stderr) == (0, "4\n", "")
