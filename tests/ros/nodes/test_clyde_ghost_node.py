"""Clyde on the real map: where he begins, how he moves, what is seen of him."""

from __future__ import annotations

import math
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

pytest.importorskip("rclpy")

from geometry_msgs.msg import Point, PointStamped, PoseWithCovarianceStamped
from std_msgs.msg import Header

from pacman_env.config import make_config
from pacman_env.ros import topics
from pacman_env.ros.messages import points_of, pose_of, seconds_of
from pacman_env.sim.core.map_ghosts import MapGhosts
from pacman_env.sim.maps.assets import map_assets
from pacman_env.sim.maps.ghost_cells import ClydeCells
from tests.ros.clock import SimulatedClock
from tests.shared import shared_path

if TYPE_CHECKING:
    from tests.ros.system import Probe, Process, System

NODE = "pacman_env.ros.nodes.clyde_ghost_node"
MAP = "loop"
CONFIG = make_config("robot", **{"clyde.speed_mps": 1.0})
PERIOD = CONFIG.clyde.update_period_s


@cache
def cells() -> ClydeCells:
    return map_assets(MAP, CONFIG).clyde


def fast_ghost(seed: int) -> MapGhosts:
    return MapGhosts(map_assets(MAP, CONFIG), CONFIG, seed)


def up(probe: Probe, system: System, **parameters: Any) -> Process:
    process = system.start(NODE, map_yaml=MAP, seed=7, **parameters)
    probe.record(topics.CLYDE_POSE, topics.CLYDE_MARKER, topics.CLYDE_OBSTACLE)
    probe.wait_for(lambda: probe.heard(topics.CLYDE_OBSTACLE), what="Clyde")
    return process


def up_at_rest(probe: Probe, system: System, **parameters: Any) -> SimulatedClock:
    """Clyde, in a time that stands still."""
    system.start(NODE, map_yaml=MAP, seed=7, use_sim_time=True, **parameters)
    probe.record(topics.CLYDE_POSE, topics.CLYDE_MARKER, topics.CLYDE_OBSTACLE)
    clock = SimulatedClock(probe, "clyde_ghost_node")

    def seen() -> bool:
        clock.advance(PERIOD, PERIOD)
        return bool(probe.heard(topics.CLYDE_OBSTACLE))

    probe.wait_for(seen, what="Clyde")
    return clock


def at(probe: Probe) -> tuple[float, float]:
    return pose_of(probe.messages(topics.CLYDE_POSE)[-1])[:2]


def next_pose(probe: Probe, count: int = 1) -> tuple[float, float]:
    before = len(probe.heard(topics.CLYDE_POSE))
    probe.wait_for(lambda: len(probe.heard(topics.CLYDE_POSE)) >= before + count, what="his pose")
    return at(probe)


def robot(probe: Probe, x: float, y: float, frame: str = "map") -> None:
    message = PoseWithCovarianceStamped(header=Header(frame_id=frame))
    message.pose.pose.position.x, message.pose.pose.position.y = x, y
    message.pose.pose.orientation.w = 1.0
    probe.publish(topics.AMCL_POSE, message)
    probe.publisher(topics.AMCL_POSE).wait_for_all_acked()  # only the latest is kept for him


def click(probe: Probe, x: float, y: float, frame: str = "map") -> None:
    probe.publish(topics.CLICKED_POINT, PointStamped(header=Header(frame_id=frame), point=Point(x=x, y=y)))


def apart(a: tuple[float, float], b: tuple[float, float]) -> float:
    return math.dist(a, b)


# Who he is


def test_he_is_seen_five_times_a_second_as_pose_marker_and_nine_obstacle_points(probe: Probe, system: System) -> None:
    clock = up_at_rest(probe, system)
    probe.forget()
    clock.advance(2.0)
    shown = (topics.CLYDE_POSE, topics.CLYDE_MARKER, topics.CLYDE_OBSTACLE)
    probe.wait_for(lambda: min(len(probe.heard(topic)) for topic in shown) >= 10, what="two seconds of him")
    stamps = [seconds_of(message.header.stamp) for message in probe.messages(topics.CLYDE_POSE)]
    assert np.diff(stamps) == pytest.approx(PERIOD)
    assert len(stamps) == 10
    here = at(probe)
    assert cells().nearest(*here)[1] < 1e-6
    marker = probe.messages(topics.CLYDE_MARKER)[-1]
    assert (marker.ns, marker.pose.position.x, marker.pose.position.y) == ("ghosts", *here)
    points = points_of(probe.messages(topics.CLYDE_OBSTACLE)[-1])
    assert len(points) == 9
    distance = np.hypot(*(points - here).T)
    assert distance.max() == pytest.approx(0.05, abs=1e-4)


def test_he_moves_only_while_the_game_is_running_and_then_at_his_speed(probe: Probe, system: System) -> None:
    up(probe, system)
    for state in ("menu", "returning_home", "starting", "dying", "complete", "paused"):
        here = at(probe)
        probe.publish(topics.GAME_STATE, state)
        assert next_pose(probe, 3) == here, state
    probe.publish(topics.CLYDE_SPEED, 0.8)
    probe.publish(topics.GAME_STATE, "running")
    start = at(probe)
    probe.wait_for(lambda: apart(at(probe), start) > 0.5, what="him to walk")
    probe.publish(topics.CLYDE_SPEED, math.nan)
    probe.publish(topics.CLYDE_SPEED, -1.0)
    probe.publish(topics.CLYDE_SPEED, math.inf)
    next_pose(probe, 5)
    poses = np.array([pose_of(m)[:2] for m in probe.messages(topics.CLYDE_POSE)])
    steps = np.hypot(*np.diff(poses, axis=0).T)
    step = 0.8 * CONFIG.clyde.update_period_s
    assert 0.99 * step <= steps.max() <= 2 * step + 1e-6  # two steps at once where the machine was late
    assert (steps[-4:] > 0.01).all()
    probe.publish(topics.GAME_STATE, "dying")
    next_pose(probe, 3)
    assert next_pose(probe, 2) == at(probe)


def test_he_keeps_his_speed_where_his_timer_is_late(probe: Probe, system: System) -> None:
    clock = up_at_rest(probe, system)
    probe.publish(topics.CLYDE_SPEED, 0.8)
    probe.publish(topics.GAME_STATE, "running")
    for topic in (topics.CLYDE_SPEED, topics.GAME_STATE):
        probe.taken_in(topic, "clyde_ghost_node")
    clock.advance(1.0)
    walked = []
    for late_s in (PERIOD, 2 * PERIOD):
        probe.forget()
        clock.advance(8 * PERIOD, late_s)
        probe.wait_for(lambda n=8 * PERIOD / late_s: len(probe.heard(topics.CLYDE_POSE)) >= n - 1.5, what="his poses")
        poses = np.array([pose_of(m)[:2] for m in probe.messages(topics.CLYDE_POSE)])
        walked.append(float(np.median(np.hypot(*np.diff(poses, axis=0).T))))  # two steps of the clock may come as one
    assert walked[0] == pytest.approx(0.8 * PERIOD, rel=0.01)
    assert walked[1] == pytest.approx(2 * 0.8 * PERIOD, rel=0.3)


def test_he_is_no_obstacle_on_the_way_home_and_after_his_end(probe: Probe, system: System) -> None:
    process = up(probe, system)

    def points() -> int:
        return len(points_of(probe.messages(topics.CLYDE_OBSTACLE)[-1]))

    probe.publish(topics.GAME_STATE, "returning_home")
    probe.wait_for(lambda: points() == 0, what="no obstacle")
    probe.publish(topics.GAME_STATE, "starting")
    probe.wait_for(lambda: points() == 9, what="the obstacle again")
    process.send(2)
    probe.wait_for(lambda: points() == 0, what="no obstacle after the end")
    assert process.wait() == 0


def test_his_trail_covers_where_he_was_shown_and_is_told_in_every_state(probe: Probe, system: System) -> None:
    process = up(probe, system)
    probe.record(topics.CLYDE_TRAIL)

    def covers(place: tuple[float, float]) -> bool:
        if not probe.heard(topics.CLYDE_TRAIL):
            return False
        points = points_of(probe.messages(topics.CLYDE_TRAIL)[-1])
        near = points[np.hypot(*(points - place).T) <= 0.15]
        return len(near) >= 30

    before = at(probe)
    probe.wait_for(lambda: covers(before), what="his place")
    other = tuple(max(cells().position.tolist(), key=lambda place: apart(tuple(place), before)))
    click(probe, *other)
    probe.wait_for(lambda: apart(at(probe), other) < 0.1, what="him at another place")
    probe.wait_for(lambda: covers(at(probe)) and covers(before), what="both places")
    probe.publish(topics.GAME_STATE, "returning_home")
    probe.wait_for(lambda: not covers(before), what="the old place to be forgotten")
    assert covers(at(probe))
    process.send(2)
    assert process.wait() == 0


# Fault 11


def test_he_never_respawns_beside_the_robot_or_its_home_fault_11(probe: Probe, system: System) -> None:
    process = up(probe, system)
    area = cells().position[cells().cells_in(0)]
    home, away = tuple(area[100]), tuple(area[len(area) // 2])
    robot(probe, *home)
    probe.wait_for(lambda: apart(at(probe), home) >= 1.5, what="him to leave the robot alone")
    for bad in ((math.nan, 0.0, "map"), (*at(probe), "odom")):
        robot(probe, *bad)
        probe.wait_for(lambda: "amcl_pose: " in process.output, what="the complaint")
    robot(probe, *away)
    probe.taken_in(topics.AMCL_POSE, "clyde_ghost_node")
    places = set()
    for _ in range(25):
        assert probe.call(topics.RESET_CLYDE).success
        here = next_pose(probe)
        assert min(apart(here, home), apart(here, away)) >= 1.5
        places.add(here)
    assert len(places) > 15


def test_a_first_pose_beside_him_makes_him_go_elsewhere_fault_11(probe: Probe, system: System) -> None:
    up(probe, system)
    here = at(probe)
    robot(probe, *here)
    probe.wait_for(lambda: apart(at(probe), here) >= 1.5, what="him to be elsewhere")


def test_planning_does_not_stall_his_pose_on_a_large_map_fault_11() -> None:
    config = make_config("robot", **{"clyde.speed_mps": 5.0, "pellets.spacing_m": 20.0})
    large = map_assets(shared_path("maps/mit_stata_basement"), config)
    clyde = MapGhosts(large, config, seed=1)
    settled = clyde._table.arrays[17][:, 3]  # the search that settled each cell (ghost_kernels.TABLE)
    ways = 0
    for _ in range(400):
        before = int(settled.max())
        clyde.step()
        searches = int(settled.max()) - before
        assert searches <= 1  # one way in a step, and no cell of it is looked at twice
        ways += searches
        assert np.count_nonzero(settled == settled.max()) <= len(large.clyde.cells_in(large.clyde_part))
    assert ways > 5


def test_the_costmap_is_cleared_seldom_and_only_after_a_way_fault_11(probe: Probe, system: System) -> None:
    cleared: list[float] = []

    def clear(request: Any, response: Any) -> Any:
        cleared.append(clock.now_s)
        return response

    topics.CLEAR_GLOBAL_COSTMAP.server(probe.node, clear)
    clock = up_at_rest(probe, system, clear_costmap_s=1.5, settings=["clyde.speed_mps=2.0"])
    clock.advance(1.0)
    assert cleared == []

    def say(topic: topics.Topic, value: Any) -> None:
        probe.publish(topic, value)
        probe.taken_in(topic, "clyde_ghost_node")

    say(topics.GAME_STATE, "running")

    def cleared_again() -> bool:
        clock.advance(PERIOD)
        return len(cleared) >= 4

    probe.wait_for(cleared_again, what="the costmap to be cleared")
    assert np.diff(cleared).min() > 1.5 - PERIOD
    say(topics.CLYDE_SPEED, 0.0)
    clock.advance(2.5)
    count = len(cleared)
    clock.advance(2.5)
    assert len(cleared) == count
    probe.publish(topics.GAME_STATE, "returning_home")
    probe.wait_for(lambda: len(cleared) == count + 1, what="his marks to be removed before the way home")


# Placing him


def test_a_click_places_him_for_the_coming_round_and_no_longer(probe: Probe, system: System) -> None:
    up(probe, system)
    place = tuple(cells().position[200])
    click(probe, place[0] + 0.03, place[1])
    probe.wait_for(lambda: apart(at(probe), place) <= 0.06, what="Clyde at the click")
    chosen = at(probe)
    probe.call(topics.RESET_CLYDE)
    assert next_pose(probe) == chosen
    probe.publish(topics.GAME_STATE, "running")
    probe.wait_for(lambda: at(probe) != chosen, what="him to walk")
    probe.publish(topics.GAME_STATE, "menu")
    places = set()
    for _ in range(5):
        probe.call(topics.RESET_CLYDE)
        places.add(next_pose(probe))
    assert len(places) > 2


def test_clicks_that_make_no_sense_are_ignored_and_said_once(probe: Probe, system: System) -> None:
    process = up(probe, system)
    here = at(probe)
    x, y = cells().position[200]
    click(probe, math.nan, y)
    click(probe, x, math.inf)
    click(probe, 500.0, 500.0)
    click(probe, x, y, frame="base_link")
    probe.publish(topics.GAME_STATE, "starting")
    assert next_pose(probe, 3) == here
    assert process.output.count("clicked_point: ") == 1


# The same walk


def test_the_same_seed_walks_the_same_way_and_another_another() -> None:
    def walk(seed: int) -> list[tuple[float, float, float]]:
        clyde = fast_ghost(seed)
        poses = []
        for _ in range(100):
            clyde.step()
            poses.append(clyde.poses[0])
        return poses

    assert walk(3) == walk(3)
    assert walk(3) != walk(4)


def test_he_looks_where_he_goes() -> None:
    clyde = fast_ghost(5)
    for _ in range(50):
        x, y, _ = clyde.poses[0]
        clyde.step()
        nx, ny, heading = clyde.poses[0]
        if (nx, ny) != (x, y):
            assert heading == pytest.approx(math.atan2(ny - y, nx - x))
