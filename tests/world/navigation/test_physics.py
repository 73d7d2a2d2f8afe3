from __future__ import annotations

import numpy as np
import pytest

from pacman_env.config import RobotConfig
from pacman_env.world.navigation.physics import GAMES_PER_SPACE, PhysicsWorld

ROBOT = RobotConfig()
STEP_S = 0.05
#: A square room of 4 m around the origin with a corner that juts in.
CORNERS = np.array([(-2, -2), (2, -2), (2, 2), (0.5, 2), (0.5, 0.5), (0, 0.5), (0, 2), (-2, 2)], dtype=np.float64)
WALLS = np.concatenate([CORNERS, np.roll(CORNERS, -1, axis=0)], axis=1)


def world(n: int, walls: np.ndarray = WALLS) -> PhysicsWorld:
    return PhysicsWorld(walls, n, radius_m=ROBOT.radius_m, mass_kg=ROBOT.mass_kg, step_s=STEP_S)


def drive(physics: PhysicsWorld, velocity: np.ndarray) -> None:
    """The force that gives each body the velocity wished for, as the navigator computes it."""
    physics.force[physics.row] = ROBOT.mass_kg * (velocity - physics.state[physics.row, 2:]) / STEP_S
    physics.step()


def depth(points: np.ndarray) -> float:
    a, b = WALLS[:, :2], WALLS[:, 2:]
    ab = b - a
    t = np.clip(((points[:, None] - a) * ab).sum(axis=2) / (ab**2).sum(axis=1), 0.0, 1.0)
    return ROBOT.radius_m - float(np.hypot(*np.moveaxis(points[:, None] - a - t[..., None] * ab, 2, 0)).min())


def test_a_robot_that_pushes_against_a_wall_for_2_s_never_enters_it_by_more_than_a_centimetre() -> None:
    physics = world(10)
    gap = 0.002 * np.arange(10)
    for i in range(10):
        physics.place(i, -2 + ROBOT.radius_m + gap[i], -1.0)
    deepest = 0.0
    for _ in range(40):
        physics.force[physics.row] = (-ROBOT.mass_kg * ROBOT.wheel_acceleration_mps2, 0.0)
        physics.step()
        deepest = max(deepest, depth(physics.state[physics.row, :2]), physics.deepest_contact())
    assert 0.0 < deepest <= 0.01
    assert (np.abs(physics.state[physics.row, 2]) < 0.05).all()


@pytest.mark.parametrize("speed", [0.256, 0.306, 0.46])
def test_a_robot_that_drives_into_a_wall_enters_it_by_a_steps_way_at_most_and_is_pushed_out(speed: float) -> None:
    physics = world(20)
    angle = np.linspace(-0.8, 0.8, 20)
    velocity = -speed * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    for i in range(20):
        physics.place(i, -1.6 + 0.003 * i, 0.0)
    depths = []
    for _ in range(70):
        drive(physics, velocity)
        depths.append(depth(physics.state[physics.row, :2]))
        assert physics.deepest_contact() == pytest.approx(max(depths[-1], 0.0), abs=1e-9)
    assert 0.0 < max(depths) <= speed * STEP_S + 0.002
    assert max(depths[-20:]) <= 0.002  # 1 mm is what the solver tolerates


def test_a_robot_slides_along_a_wall_it_meets_at_an_angle() -> None:
    physics = world(1)
    physics.place(0, -1.5, -1.0)
    for _ in range(100):
        drive(physics, np.array([[-0.2, 0.2]]))
    x, y, _, vy = physics.state[0]
    assert x == pytest.approx(-2 + ROBOT.radius_m, abs=0.01)
    assert y > -0.3
    assert vy == pytest.approx(0.2, abs=1e-6)


def test_a_force_gives_the_velocity_that_the_next_step_drives_with() -> None:
    physics = world(1)
    physics.place(0, -1.0, -1.0)
    drive(physics, np.array([[0.1, -0.2]]))
    np.testing.assert_allclose(physics.state[0], [-1.0, -1.0, 0.1, -0.2], atol=1e-12)
    drive(physics, np.array([[0.1, -0.2]]))
    np.testing.assert_allclose(physics.state[0], [-1.0 + 0.1 * STEP_S, -1.0 - 0.2 * STEP_S, 0.1, -0.2], atol=1e-12)


def test_robots_do_not_touch_one_another() -> None:
    together, alone = world(3), world(1)
    starts, velocity = (
        np.array([[-1.0, 0.0], [-0.8, 0.0], [-1.0, 0.0]]),
        np.array([[0.2, 0.0], [-0.2, 0.0], [0.0, 0.1]]),
    )
    for i, (x, y) in enumerate(starts.tolist()):
        together.place(i, x, y)
    alone.place(0, -1.0, 0.0)
    for _ in range(20):
        drive(together, velocity)
        drive(alone, velocity[:1])
    np.testing.assert_array_equal(together.state[0], alone.state[0])
    np.testing.assert_allclose(together.state[:3, :2], starts + velocity * 19 * STEP_S, atol=1e-9)
    assert together.deepest_contact() == 0.0


@pytest.mark.parametrize("n", [1, GAMES_PER_SPACE, GAMES_PER_SPACE + 1, 130])
def test_every_robot_owns_its_row_whatever_space_it_is_in(n: int) -> None:
    physics = world(n)
    assert len(set(physics.row.tolist())) == n
    rng = np.random.default_rng(n)
    start, velocity = rng.uniform(-1.5, -0.5, (n, 2)), rng.uniform(-0.2, 0.2, (n, 2))
    for i, (x, y) in enumerate(start.tolist()):
        physics.place(i, x, y)
    np.testing.assert_array_equal(physics.state[physics.row, :2], start)
    for _ in range(11):
        drive(physics, velocity)
    expected = np.concatenate([start + velocity * 10 * STEP_S, velocity], axis=1)
    np.testing.assert_allclose(physics.state[physics.row], expected, atol=1e-9)


def test_placing_a_robot_stops_it_and_leaves_the_others_alone() -> None:
    physics = world(70)
    velocity = np.full((70, 2), 0.1)
    for i in range(70):
        physics.place(i, -1.0, -1.0)
    for _ in range(5):
        drive(physics, velocity)
    before = physics.state[physics.row].copy()
    physics.place(66, -1.5, -1.5)
    physics.force[:] = 0.0
    physics.step()
    after = physics.state[physics.row]
    assert after[66].tolist() == [-1.5, -1.5, 0.0, 0.0]
    others = np.arange(70) != 66
    np.testing.assert_allclose(after[others, :2], before[others, :2] + 0.1 * STEP_S, atol=1e-12)


def test_bare_steps_keep_the_bodies_moving_inside_the_walls() -> None:
    physics = world(66)
    for i in range(66):
        physics.place(i, -1.0, -1.0)
    physics.bare_steps(200, 0.3)
    physics.force[:] = 0.0
    physics.step()
    x, y, vx, vy = physics.state[physics.row].T
    assert (np.abs(x) < 2).all()
    assert (np.abs(y) < 2).all()
    assert (np.hypot(vx, vy) > 0.2).mean() > 0.9
    assert np.ptp(x) > 1.0


def test_a_world_without_robots_is_refused() -> None:
    with pytest.raises(ValueError, match=r"n = 0: a world holds at least one robot"):
        world(0)
