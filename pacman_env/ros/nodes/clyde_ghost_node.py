"""Node ``clyde_ghost_node``: Clyde and the ghosts beside him on the map, as poses, markers and obstacles.

Where they go and how they walk is the simulator's (``sim/core/map_ghosts.py``); here they get a clock and a voice.
Those that a policy moves see what the robot's policy sees.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Iterable, Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pacman_env.config import MAX_SPEED_MPS
from pacman_env.policies.registry import split_ghosts
from pacman_env.sim.core.map_ghosts import MapGhosts
from pacman_env.sim.maps.assets import map_assets
from pacman_env.sim.observation.robot_view import Pellets, RobotView, Seen

from .. import topics
from ..messages import (
    GHOST_OBSTACLE,
    GHOSTS,
    BadMessage,
    Position,
    cloud_message,
    marker_message,
    number_of,
    pellets_of,
    point_of,
    pose_message,
    pose_of,
    word_of,
)
from ..node import GameNode, parameter, run
from .ghost_trail import GhostTrail

NAME = "clyde_ghost_node"
_DIAMETER_M = 0.35  # of the marker; original
#: Of the markers, whose ids count from 1: orange is the original's Clyde.
_COLOURS = ((1.0, 0.31, 0.0), (1.0, 0.0, 0.0), (1.0, 0.6, 0.8), (0.0, 1.0, 1.0))
_OBSTACLE_Z_M = 0.25  # where the costmap looks for him; original
_LISTEN_S = 2.0  # of wall time: so long a new node waits to hear where the robot is
_ANSWER_S = 10.0  # an answer that is not there by then will not come
_CATCH_UP_S = 1.0  # of what a late timer has left out, at most so much is made good
_ALL = np.ones(1, np.bool_)


class ClydeGhostNode(GameNode):
    """The ghosts, who move only while the game is running.

    Raises:
        MapError: the map cannot be read or played on.
        ConfigError: the ghosts find no room on it, or there is no such behaviour.
        ValueError: a ghost's policy cannot be loaded.
    """

    def __init__(self) -> None:
        super().__init__(NAME, with_map=True)
        config = self.config
        seed = parameter(self, "seed", -1, "of all that is random; -1: another one at each start", -1, 2**31 - 1)
        self._clear_s = parameter(
            self,
            "clear_costmap_s",
            0.0,
            "between two clearings of the whole global costmap at least, s; 0: never; the original's Nav2 file needs 5",
            0.0,
            3600.0,
        )
        seed = self.surroundings.new_seed() if seed < 0 else seed
        behaviours, self._policies = split_ghosts(config.clyde.ghosts)
        config = config.with_fields(**{"clyde.ghosts": behaviours})
        assets = map_assets(self.map, config)
        self._view = RobotView(assets, config, seed)
        self._pellets: Pellets | None = None
        self._tick_s, self._decided_s, self._began_round_s = config.execution.tick_s, -math.inf, 0.0
        self._stepped_s: float | None = None  # when the ghosts have moved last in this round
        self._owed_s = 0.0
        self._distance_m = config.clyde.spawn_distance_m
        radius_m = max(config.nav2.clyde_keepout_m - config.robot.inscribed_radius_m, 0.0)
        self._around = radius_m * GHOST_OBSTACLE  # at 0.05 m, original

        self.ghosts = MapGhosts(assets, config, seed)
        self.ghosts.rehearse(self._choices())
        self._state = "menu"
        self._began_s = self.surroundings.monotonic()
        self._home: Position | None = None  # the first pose there is, then where a round starts
        self._robot: Position | None = None
        self._chosen: int | None = None  # Clyde's cell for the coming round, if someone clicked on one
        self._cleared_at = self._places()
        self._cleared_s = -math.inf
        self._clearing: Any = None

        self._poses = [topic.publisher(self) for topic in topics.GHOST_POSES[: len(behaviours)]]
        self._marker = topics.CLYDE_MARKER.publisher(self)
        self._obstacle = topics.CLYDE_OBSTACLE.publisher(self)
        self._trail, self._trail_out = GhostTrail(), topics.CLYDE_TRAIL.publisher(self)
        self._costmap = topics.CLEAR_GLOBAL_COSTMAP.client(self)
        self.listen(topics.GAME_STATE, self._hear_state, "bad state")
        self.listen(topics.CLYDE_SPEED, self._hear_speed, "bad speed")
        self.listen(topics.AMCL_POSE, self._hear_robot, "bad robot pose")
        self.listen(topics.CLICKED_POINT, self._hear_click, "bad click")
        if self._policies:
            self.listen(topics.PELLET_MARKERS, self._hear_pellets, "bad pellets")
        topics.RESET_CLYDE.server(self, self._reset)
        self.create_timer(config.clyde.update_period_s, self._update)
        self.get_logger().info(f"{', '.join(self.config.clyde.ghosts)} on {self.map.name}, seed {seed}")

    def _hear_state(self, message: Any) -> None:
        state = word_of(message, topics.STATE_WORDS)
        if state == "running" != self._state:
            self._chosen = self._stepped_s = None
            self._began_round_s, self._owed_s = self.now_s(), 0.0
            self._view.begin()
            for policy in self._policies.values():
                policy.reset(_ALL)
        if state == "returning_home" != self._state:
            self._clear_costmap()  # they are no danger on the way home and must not be in it
        if state == "starting" != self._state and self._robot is not None:
            self._home = self._robot  # the first pose was no home if this node came in the middle of a game
            self._keep_away()
        self._state = state

    def _hear_speed(self, message: Any) -> None:
        self.ghosts.speed_mps = self._view.clyde_speed_mps = number_of(message, 0.0, MAX_SPEED_MPS)

    def _hear_pellets(self, message: Any) -> None:
        self._pellets = self._view.pellets(pellets_of(message))

    def _hear_robot(self, message: Any) -> None:
        pose = pose_of(message)
        self.ghosts.see_robot(pose)
        self._pose = pose
        first, self._robot = self._robot is None, pose[:2]
        if first:
            self._home = self._robot
            self._keep_away()  # where the robot is was not known before

    def _keep_away(self) -> None:
        """Not beside the robot, unless somebody wanted Clyde there."""
        if self._robot is None:
            return
        beside = [k for k, at in enumerate(self._places()) if math.dist(self._robot, at) < self._distance_m]
        self._respawn([k for k in beside if k > 0 or self._chosen is None])

    def _hear_click(self, message: Any) -> None:
        cell, distance = self.ghosts.cells.nearest(*point_of(message))
        if self._state == "running":
            raise BadMessage("Clyde can be placed only before a round")
        if distance > self.config.clyde.click_distance_m:
            raise BadMessage(f"Clyde cannot be there: {distance:.2f} m from the nearest place wide enough for him")
        self.once.over("bad click")
        self._chosen = cell
        self._respawn([0])

    def _reset(self, request: Any, response: Any) -> Any:
        del request
        self._respawn(range(len(self.ghosts)))
        response.success, response.message = True, "Clyde at ({:.2f}, {:.2f})".format(*self.ghosts.poses[0])
        return response

    def _respawn(self, numbers: Sequence[int]) -> None:
        if not numbers:
            return
        drawn = [k for k in numbers if k > 0 or self._chosen is None]
        self.ghosts.respawn([p for p in (self._home, self._robot) if p is not None], drawn)
        if self._chosen is not None and 0 in numbers:
            self.ghosts.place(0, self._chosen)
        self._show()

    def _places(self) -> list[Position]:
        return [pose[:2] for pose in self.ghosts.poses]

    def _update(self) -> None:
        if self._robot is None and self.surroundings.monotonic() - self._began_s < _LISTEN_S:
            return  # after a start in the middle of a round they would perhaps appear beside the robot
        if self._state == "running":
            now = self.now_s()
            if not 0 <= now - self._decided_s < self._tick_s - 1e-6:
                self._decided_s = now
                self.ghosts.decide(self._choices())
            for _ in range(self._steps_due(now)):
                self.ghosts.step()
            apart = max(map(math.dist, self._cleared_at, self._places()))
            moved = apart >= self.config.nav2.clear_distance_m
            if self._clear_s and moved and not 0 <= now - self._cleared_s < self._clear_s:
                self._clear_costmap()
        self._show()

    def _steps_due(self, now: float) -> int:
        """1, or 2 while there is something to catch up on: a late timer leaves steps out, ghosts keep their speed."""
        period_s, before_s, self._stepped_s = self.config.clyde.update_period_s, self._stepped_s, now
        late_s = 0.0 if before_s is None else max(now - before_s - period_s, 0.0)
        self._owed_s = min(self._owed_s + late_s, _CATCH_UP_S)
        if self._owed_s < period_s / 2:
            return 1
        self._owed_s -= period_s
        return 2

    def _choices(self) -> NDArray[np.int64]:
        """The candidates that policies send their ghosts to, in their order; the last one: wander on."""
        choices = np.full(len(self.config.clyde.ghosts), self._view.hold, dtype=np.int64)
        for number, policy in self._policies.items():
            if self._pellets is None or self._robot is None:
                choices[number] = policy.select(self._view.rehearsal(number))[0]  # compiled or loaded now
                continue
            seen = Seen(self.now_s() - self._began_round_s, self._pose, self._pellets.known)
            choices[number] = policy.select(self._view.situation(seen, number))[0]
        return choices

    def _show(self) -> None:
        now = self.get_clock().now()
        stamp, poses = now.to_msg(), self.ghosts.poses
        for number, (pose, publisher) in enumerate(zip(poses, self._poses, strict=True)):
            self._view.see_ghost(number, *pose[:2], now.nanoseconds)
            publisher.publish(pose_message(*pose, stamp))
            self._marker.publish(marker_message(GHOSTS, number + 1, pose[:2], _DIAMETER_M, _COLOURS[number], stamp))
        around = np.concatenate([self._around + pose[:2] for pose in poses])
        self._obstacle.publish(
            cloud_message(around[: 0 if self._state == "returning_home" else None], stamp, _OBSTACLE_Z_M)
        )
        self._show_trail(self._places(), stamp)

    def _show_trail(self, places: Sequence[Position], stamp: Any) -> None:
        points = self._trail.points(places, self.now_s())
        self._trail_out.publish(cloud_message(points, stamp, _OBSTACLE_Z_M))

    def _clear_costmap(self) -> None:
        """Have the marks that ghosts left behind removed; one request at a time, for a clearing stalls Nav2."""
        unanswered = self._clearing is not None and not self._clearing.done()
        waiting = unanswered and 0 <= self.now_s() - self._cleared_s < _ANSWER_S
        if self._clear_s and not waiting and self._costmap.service_is_ready():
            self._clearing = self._costmap.call_async(topics.CLEAR_GLOBAL_COSTMAP.type.Request())
            self._cleared_at = self._places()
            self._cleared_s = self.now_s()

    def last_messages(self) -> Iterable[Any]:
        """No obstacle is left behind where nobody is any more."""
        stamp = self.get_clock().now().to_msg()
        self._obstacle.publish(cloud_message(GHOST_OBSTACLE[:0], stamp, _OBSTACLE_Z_M))
        self._show_trail((), stamp)
        return ()


main = partial(run, ClydeGhostNode, NAME)

if __name__ == "__main__":
    sys.exit(main())
