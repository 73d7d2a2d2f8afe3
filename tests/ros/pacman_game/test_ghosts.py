"""Clyde on the real map: where it begins, how it moves, what is seen of it."""

import math
from collections.abc import Callable
from functools import cache, partial
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from pacman_env.config import make_config
from pacman_env.game.ghosts import POLICY
from pacman_env.levels.assets import map_assets
from pacman_env.levels.ghost_cells import ClydeCells
from pacman_env.ros import topics
from pacman_env.ros.configured_node import ConfiguredNode
from pacman_env.ros.game_nodes import GAME
from pacman_env.ros.message_conversion import points_of, pose_of, seconds_of
from pacman_env.ros.node import BaseNode
from pacman_env.ros.pacman_game.ghosts import GameGhosts
from pacman_env.sim.ghost_state import MapGhosts
from tests.ros.nodes.test_contract import click, pose
from tests.ros.session import Session
from tests.shared import shared_path

MAP = "loop"
CONFIG = make_config("robot", **{"clyde.speed_mps": 1.0})
PERIOD = CONFIG.clyde.update_period_s


@cache
def cells() -> ClydeCells:
    return map_assets(MAP, CONFIG).clyde


def up(nodes: Session, **parameters: Any) -> None:
    nodes.record(topics.CLYDE_POSE, topics.CLYDE_MARKER, topics.CLYDE_OBSTACLE)
    nodes.start(GAME, map_yaml=MAP, seed=7, selector="none", **parameters)
    nodes.wait_for(lambda: nodes.messages(topics.CLYDE_OBSTACLE), what="Clyde")


def ghosts(nodes: Session) -> GameGhosts:
    ghosts: GameGhosts = nodes.node(GAME).ghosts
    return ghosts


def at(nodes: Session) -> tuple[float, float]:
    return pose_of(nodes.last(topics.CLYDE_POSE))[:2]


def next_pose(nodes: Session, count: int = 1) -> tuple[float, float]:
    nodes.advance(count * PERIOD)
    return at(nodes)


def walked(nodes: Session, seconds: float) -> Any:
    nodes.clear()
    nodes.advance(seconds)
    poses = np.array([pose_of(m)[:2] for m in nodes.messages(topics.CLYDE_POSE)])
    return np.hypot(*np.diff(poses, axis=0).T)


def robot(nodes: Session, x: float, y: float) -> None:
    nodes.publish(topics.AMCL_POSE, pose(x, y))


def obstacle(nodes: Session) -> int:
    """Of how many points it is one now."""
    return len(points_of(nodes.last(topics.CLYDE_OBSTACLE)))


# What it is


def test_ghost_is_shown_five_times_a_second(nodes: Session) -> None:
    up(nodes)
    nodes.clear()
    nodes.advance(2.0)
    assert all(len(nodes.messages(t)) == 10 for t in (topics.CLYDE_POSE, topics.CLYDE_MARKER, topics.CLYDE_OBSTACLE))
    stamps = [seconds_of(message.header.stamp) for message in nodes.messages(topics.CLYDE_POSE)]
    assert np.diff(stamps) == pytest.approx(PERIOD)
    here = at(nodes)
    assert cells().nearest(*here)[1] < 1e-6
    marker = nodes.last(topics.CLYDE_MARKER)
    assert (marker.ns, marker.pose.position.x, marker.pose.position.y) == ("ghosts", *here)
    points = points_of(nodes.last(topics.CLYDE_OBSTACLE))
    assert len(points) == 9
    distance = np.hypot(*(points - here).T)
    assert distance.max() == pytest.approx(0.05, abs=1e-4)


def test_ghost_moves_at_its_speed_while_game_runs(nodes: Session) -> None:
    up(nodes)
    for state in ("menu", "returning_home", "starting", "dying", "complete"):
        here = at(nodes)
        ghosts(nodes).on_state(state)
        assert next_pose(nodes, 10) == here, state
    ghosts(nodes).set_speed(0.8)
    ghosts(nodes).on_state("running")
    start = at(nodes)
    nodes.wait_for(lambda: math.dist(at(nodes), start) > 0.5, what="it to walk")
    steps = walked(nodes, 2.0)
    assert steps.max() == pytest.approx(0.8 * PERIOD, rel=1e-3)
    assert (steps > 0.01).all()
    ghosts(nodes).on_state("dying")
    assert next_pose(nodes) == next_pose(nodes, 10)


def test_ghost_keeps_speed_when_timer_is_late(nodes: Session) -> None:
    up(nodes)
    ghosts(nodes).set_speed(0.8)
    ghosts(nodes).on_state("running")
    nodes.advance(1.0)
    assert np.median(walked(nodes, 8 * PERIOD)) == pytest.approx(0.8 * PERIOD, rel=0.01)
    nodes.clear()
    for _ in range(8):  # it gets no core for a while, again and again
        nodes.late.add(GAME)
        nodes.advance(2 * PERIOD - 0.05)
        nodes.late.remove(GAME)
        nodes.advance(0.05)
    poses = np.array([pose_of(m)[:2] for m in nodes.messages(topics.CLYDE_POSE)])
    assert len(poses) == 8
    assert np.median(np.hypot(*np.diff(poses, axis=0).T)) == pytest.approx(2 * 0.8 * PERIOD, rel=0.01)


def test_ghost_is_no_obstacle_on_way_home(nodes: Session) -> None:
    up(nodes)
    ghosts(nodes).on_state("returning_home")
    next_pose(nodes)
    assert obstacle(nodes) == 0
    ghosts(nodes).on_state("starting")
    next_pose(nodes)
    assert obstacle(nodes) == 9
    nodes.stop(GAME)
    assert obstacle(nodes) == 0


def ghost_until(nodes: Session, harmless_s: float, away_s: float = 0.0) -> None:
    """Publish for how long from now the ghost is harmless and away."""
    now = seconds_of(nodes.stamp())
    times = [now + seconds if seconds else 0.0 for seconds in (harmless_s, away_s)]
    ghosts(nodes).set_harmless(np.array([times]))


def test_frightened_ghost_is_slow_blue_and_no_obstacle(nodes: Session) -> None:
    up(nodes, settings=["power.pellets=1"])
    robot(nodes, *at(nodes))
    ghosts(nodes).set_speed(0.8)
    ghosts(nodes).on_state("running")
    nodes.advance(1.0)
    ghost_until(nodes, 30.0)
    nodes.advance(1.0)
    assert obstacle(nodes) == 0
    assert walked(nodes, 5.0).max() == pytest.approx(0.67 * 0.8 * PERIOD, rel=1e-3)
    colour = nodes.last(topics.CLYDE_MARKER).color
    assert colour.b > colour.r
    nodes.advance(25.0)
    assert obstacle(nodes) == 9
    assert nodes.last(topics.CLYDE_MARKER).color.r > 0.9
    ghost_until(nodes, 5.0)
    nodes.clock_ns -= 100 * 10**9  # as after a restart of the simulated robot
    nodes.advance(6.0)
    assert obstacle(nodes) == 9


@pytest.mark.parametrize("away_s", [4.0, -1.0])
def test_caught_ghost_waits_where_it_started_even_if_message_is_late(nodes: Session, away_s: float) -> None:
    up(nodes, settings=["power.pellets=1"])
    start = at(nodes)
    ghosts(nodes).set_speed(0.8)
    ghosts(nodes).on_state("running")
    nodes.wait_for(lambda: math.dist(at(nodes), start) > 0.8, what="it to walk")
    ghost_until(nodes, away_s, away_s)
    nodes.advance(PERIOD)
    assert math.dist(at(nodes), start) <= 0.8 * PERIOD + 1e-6
    nodes.advance(2.0)
    assert (at(nodes) == start) == (away_s > 0)
    nodes.wait_for(lambda: math.dist(at(nodes), start) > 0.5, what="it to start again")


def test_policy_of_ghost_is_asked_in_each_round(nodes: Session) -> None:
    """The policy of the first round is replaced before it has answered."""
    asked: list[int] = []
    process = SimpleNamespace(ready=True, ask=lambda number, situation, begins: asked.append(number))
    policy: Any = SimpleNamespace(process=process, asked=lambda: None)
    node = nodes.start("ghosts", partial(ConfiguredNode, "ghosts", with_map=True), map_yaml=MAP)
    ghosts = GameGhosts(node, CONFIG.with_fields(**{"clyde.ghosts": (POLICY,)}), 0, policy)
    ghosts.on_robot(pose(0.0, 0.0))
    for state in ("menu", "running", "menu", "running"):
        ghosts.on_state(state)
        nodes.advance(1.0)
        ghosts.update()
    assert asked == [0, 0]


def test_trail_covers_where_ghost_was_shown(nodes: Session) -> None:
    nodes.record(topics.CLYDE_TRAIL)
    up(nodes)

    def covers(place: tuple[float, float]) -> bool:
        points = points_of(nodes.last(topics.CLYDE_TRAIL))
        near = points[np.hypot(*(points - place).T) <= 0.15]
        return len(near) >= 30

    before = at(nodes)
    nodes.wait_for(lambda: covers(before), what="its place")
    other = tuple(max(cells().position.tolist(), key=lambda place: math.dist(tuple(place), before)))
    nodes.publish(topics.CLICKED_POINT, click(*other))
    assert math.dist(at(nodes), other) < 0.1
    assert covers(at(nodes))
    assert covers(before)
    ghosts(nodes).on_state("returning_home")
    nodes.wait_for(lambda: not covers(before), what="the old place to be forgotten")
    assert covers(at(nodes))
    nodes.stop(GAME)


# Fault 11


def test_ghost_respawns_away_from_robot_fault_11(nodes: Session) -> None:
    up(nodes)
    area = cells().position[cells().cells_in(0)]
    home, away = at(nodes), tuple(area[len(area) // 2])
    robot(nodes, *home)  # its first pose
    assert math.dist(at(nodes), home) >= 1.5
    robot(nodes, *away)
    places = set()
    for _ in range(25):
        ghosts(nodes).respawn()
        here = next_pose(nodes)
        assert min(math.dist(here, home), math.dist(here, away)) >= 1.5
        places.add(here)
    assert len(places) > 15


def test_ghost_of_resumed_round_stays_beside_robot(nodes: Session) -> None:
    up(nodes)
    ghosts(nodes).on_state("running")
    here = at(nodes)
    robot(nodes, *here)  # only now the node gets its pose
    assert at(nodes) == here


def test_ghost_plans_at_most_once_per_step_fault_11() -> None:
    config = make_config("robot", **{"clyde.speed_mps": 5.0, "pellets.spacing_m": 20.0})
    large = map_assets(shared_path("maps/mit_stata_basement"), config)
    clyde = MapGhosts(large, config, seed=1)
    settled = clyde._table.arrays["search"].nodes[:, 3]  # the search that settled each cell
    ways = 0
    for _ in range(400):
        before = int(settled.max())
        clyde.step()
        searches = int(settled.max()) - before
        assert searches <= 1  # one way in a step, and no cell of it is looked at twice
        ways += searches
        assert np.count_nonzero(settled == settled.max()) <= len(large.clyde.cells_in(large.clyde_part))
    assert ways > 5


class Costmap(BaseNode):
    """Counts when it is cleared."""

    def __init__(self, now_s: Callable[[], float], **options: Any) -> None:
        super().__init__("global_costmap", **options)
        self.cleared: list[float] = []
        self._now_s = now_s
        topics.CLEAR_GLOBAL_COSTMAP.server(self, self._clear)

    def _clear(self, request: Any, response: Any) -> Any:
        self.cleared.append(self._now_s())
        return response


def test_costmap_is_cleared_at_limited_rate_fault_11(nodes: Session) -> None:
    costmap = nodes.start("global_costmap", lambda **options: Costmap(lambda: nodes.now_s, **options))
    up(nodes, clear_costmap_s=1.5, settings=["clyde.speed_mps=2.0"])
    nodes.advance(5.0)
    assert costmap.cleared == []
    ghosts(nodes).on_state("running")
    nodes.wait_for(lambda: len(costmap.cleared) >= 4, what="the costmap to be cleared")
    assert np.diff(costmap.cleared).min() > 1.5 - 1e-6
    ghosts(nodes).set_speed(0.0)
    nodes.advance(2.5)
    count = len(costmap.cleared)
    nodes.advance(20.0)
    assert len(costmap.cleared) == count
    nodes.within(lambda: ghosts(nodes).on_state("returning_home"))
    assert len(costmap.cleared) == count + 1, "its marks are removed before the way home"


# Placing it


def test_click_places_ghost_for_next_round(nodes: Session) -> None:
    up(nodes)
    place = tuple(cells().position[200])
    nodes.publish(topics.CLICKED_POINT, click(place[0] + 0.03, place[1]))
    chosen = at(nodes)
    assert math.dist(chosen, place) <= 0.06
    ghosts(nodes).respawn()
    assert next_pose(nodes) == chosen
    ghosts(nodes).on_state("running")
    nodes.wait_for(lambda: at(nodes) != chosen, what="it to walk")
    ghosts(nodes).on_state("menu")
    places = set()
    for _ in range(5):
        ghosts(nodes).respawn()
        places.add(next_pose(nodes))
    assert len(places) > 2
