"""Node ``clyde_ghost_node``: Clyde on the real map, as pose, marker and obstacle (Algorithm 2).

His cells, ways and walk are the rules of ``sim/maps/ghost_cells.py`` and ``game/ghosts.py``; here he gets a clock and a voice.
"""

from __future__ import annotations

import math
import secrets
import sys
from collections.abc import Iterable, Sequence
from time import monotonic
from typing import Any

import numpy as np

from pacman_env.config import MAX_SPEED_MPS, ClydeConfig, PelletConfig
from pacman_env.game import ghosts as rule
from pacman_env.rng import below
from pacman_env.sim.maps.ghost_cells import ClydeCells, clyde_cells, search_memory
from pacman_env.world.maps.occupancy import load_map

from .. import topics
from ..messages import (
    GHOSTS,
    BadMessage,
    Pose,
    Position,
    cloud_message,
    marker_message,
    number_of,
    point_of,
    pose_message,
    pose_of,
    word_of,
)
from ..node import GameNode, parameter, run

NAME = "clyde_ghost_node"
_MARKER_ID = 1  # original
_DIAMETER_M = 0.35  # of the marker; original
_ORANGE = (1.0, 0.31, 0.0)  # original
_OBSTACLE_Z_M = 0.25  # where the costmap looks for him; original
#: He and eight points around him: what Nav2's costmap sees of him, at 0.05 m (original).
_OBSTACLE = 0.05 * np.array(
    [(0.0, 0.0), *((math.cos(k * math.pi / 4), math.sin(k * math.pi / 4)) for k in range(8))], dtype=np.float64
)
_CLICK_M = 0.25  # a click this far from where Clyde can be is still meant for the nearest of his cells
_LISTEN_S = 2.0  # of wall time: so long a new node waits to hear where the robot is
_CLEAR_DISTANCE_M = 0.5  # a costmap is not cleared before he has moved this far
_ANSWER_S = 10.0  # an answer that is not there by then will not come


class Wanderer:
    """Clyde on the cells of one map, standing until ``step`` is called; the same seed walks the same way."""

    def __init__(self, cells: ClydeCells, seed: int, speed_mps: float, period_s: float) -> None:
        self.cells = cells
        self.period_s = period_s
        self.heading = 0.0
        self._ghost = np.zeros(1, dtype=np.dtype(rule.GHOST_FIELDS, align=True))
        self._ghost["stream"] = rule.ghost_stream(seed, 0)
        self._ghost["speed"] = speed_mps
        self._path = np.zeros(cells.longest, dtype=np.int32)
        self._memory = search_memory(len(cells.position), cells.longest)
        self._ways = (cells.graph, cells.part, cells.part_start, cells.part_cells)

    @property
    def pose(self) -> Pose:
        """Where he is and where he last went."""
        return float(self._ghost["x"][0]), float(self._ghost["y"][0]), self.heading

    def set_speed(self, speed_mps: float) -> None:
        """From the next step on."""
        self._ghost["speed"] = speed_mps

    def place(self, cell: int) -> None:
        """Put him on a cell; the way he was on is forgotten."""
        rule.spawn(self._ghost[0], cell, self._path, self.cells.position)

    def respawn(self, away_from: Sequence[Position], distance_m: float) -> None:
        """Put him on a random cell of the robot's area, far from these places; the first is in that area."""
        part = int(self.cells.part[self.cells.nearest(*away_from[0])[0]]) if away_from else 0
        allowed = self.cells.away_from(part, away_from, distance_m)
        self._ghost["stream"], pick = below(self._ghost["stream"][0], len(allowed))
        self.place(int(allowed[pick]))

    def step(self) -> None:
        """One period along his way; at its end he chooses the next."""
        ghost = self._ghost[0]
        rule.walk(ghost, self._path, self.cells.position, self.period_s)
        if ghost["vx"] or ghost["vy"]:
            self.heading = math.atan2(ghost["vy"], ghost["vx"])
        if rule.at_target(ghost):
            rule.wander(ghost, self._path, self._ways, *self._memory)


class ClydeGhostNode(GameNode):
    """Clyde, who moves only while the game is running.

    Raises:
        MapError: the map cannot be read.
        ConfigError: Clyde finds no room on it.
    """

    def __init__(self) -> None:
        super().__init__(NAME)
        config = ClydeConfig()
        map = load_map(parameter(self, "map_yaml", "", "YAML file of the map, or the name of a shipped one"))
        speed = parameter(
            self, "speed_mps", config.speed_mps, "until clyde/speed says another, m/s", 0.0, MAX_SPEED_MPS
        )
        seed = parameter(self, "seed", -1, "of all that is random; -1: another one at each start", -1, 2**31 - 1)
        self._distance_m = parameter(
            self, "spawn_distance_m", config.spawn_distance_m, "from the robot and its home at least, m", 0.0, 100.0
        )
        self._clear_s = parameter(
            self,
            "clear_costmap_s",
            5.0,
            "between two clearings of the global costmap at least, s; 0: never",
            0.0,
            3600.0,
        )
        seed = secrets.randbelow(2**31) if seed < 0 else seed

        self.clyde = Wanderer(clyde_cells(map, config, PelletConfig().free_grey), seed, speed, config.update_period_s)
        self.clyde.respawn([], self._distance_m)
        self.clyde.step()  # compiled now, not while the game waits for his pose
        self.clyde.respawn([], self._distance_m)
        self._state = "menu"
        self._began_s = monotonic()
        self._home: Position | None = None  # the first pose there is, then where a round starts
        self._robot: Position | None = None
        self._chosen: int | None = None  # the cell for the coming round, if someone clicked on one
        self._cleared_at: Position = self.clyde.pose[:2]
        self._cleared_s = -math.inf
        self._clearing: Any = None

        self._pose = topics.CLYDE_POSE.publisher(self)
        self._marker = topics.CLYDE_MARKER.publisher(self)
        self._obstacle = topics.CLYDE_OBSTACLE.publisher(self)
        self._costmap = topics.CLEAR_GLOBAL_COSTMAP.client(self)
        self.listen(topics.GAME_STATE, self._hear_state, "bad state")
        self.listen(topics.CLYDE_SPEED, self._hear_speed, "bad speed")
        self.listen(topics.AMCL_POSE, self._hear_robot, "bad robot pose")
        self.listen(topics.CLICKED_POINT, self._hear_click, "bad click")
        topics.RESET_CLYDE.server(self, self._reset)
        self.create_timer(config.update_period_s, self._update)
        self.get_logger().info(f"Clyde on {map.name}, seed {seed}")

    def _hear_state(self, message: Any) -> None:
        state = word_of(message, topics.STATE_WORDS)
        if state == "running":
            self._chosen = None
        if state == "returning_home" != self._state:
            self._clear_costmap()  # he is no danger on the way home and must not be in it
        if state == "starting" != self._state and self._robot is not None:
            self._home = self._robot  # the first pose was no home if this node came in the middle of a game
            self._keep_away()
        self._state = state

    def _hear_speed(self, message: Any) -> None:
        self.clyde.set_speed(number_of(message, 0.0, MAX_SPEED_MPS))

    def _hear_robot(self, message: Any) -> None:
        x, y, _ = pose_of(message)
        first, self._robot = self._robot is None, (x, y)
        if first:
            self._home = self._robot
            self._keep_away()  # where the robot is was not known before

    def _keep_away(self) -> None:
        """Not beside the robot, unless somebody wanted him there."""
        if self._robot is None or self._chosen is not None:
            return
        if math.dist(self._robot, self.clyde.pose[:2]) < self._distance_m:
            self._respawn()

    def _hear_click(self, message: Any) -> None:
        cell, distance = self.clyde.cells.nearest(*point_of(message))
        if self._state == "running":
            raise BadMessage("Clyde can be placed only before a round")
        if distance > _CLICK_M:
            raise BadMessage(f"Clyde cannot be there: {distance:.2f} m from the nearest place wide enough for him")
        self.once.over("bad click")
        self._chosen = cell
        self._respawn()

    def _reset(self, request: Any, response: Any) -> Any:
        del request
        self._respawn()
        response.success, response.message = True, "Clyde at ({:.2f}, {:.2f})".format(*self.clyde.pose)
        return response

    def _respawn(self) -> None:
        if self._chosen is not None:
            self.clyde.place(self._chosen)
        else:
            self.clyde.respawn([p for p in (self._home, self._robot) if p is not None], self._distance_m)
        self._show()

    def _update(self) -> None:
        if self._robot is None and monotonic() - self._began_s < _LISTEN_S:
            return  # after a start in the middle of a round he would perhaps appear beside the robot
        if self._state == "running":
            self.clyde.step()
            now = self.now_s()
            apart = math.dist(self._cleared_at, self.clyde.pose[:2])
            if self._clear_s and apart >= _CLEAR_DISTANCE_M and not 0 <= now - self._cleared_s < self._clear_s:
                self._clear_costmap()
        self._show()

    def _show(self) -> None:
        stamp = self.get_clock().now().to_msg()
        pose = self.clyde.pose
        self._pose.publish(pose_message(*pose, stamp))
        self._marker.publish(marker_message(GHOSTS, _MARKER_ID, pose[:2], _DIAMETER_M, _ORANGE, stamp))
        points = _OBSTACLE[:0] if self._state == "returning_home" else _OBSTACLE + pose[:2]
        self._obstacle.publish(cloud_message(points, stamp, _OBSTACLE_Z_M))

    def _clear_costmap(self) -> None:
        """Have the marks he left behind removed; one request at a time, for a clearing stalls Nav2."""
        unanswered = self._clearing is not None and not self._clearing.done()
        waiting = unanswered and 0 <= self.now_s() - self._cleared_s < _ANSWER_S
        if self._clear_s and not waiting and self._costmap.service_is_ready():
            self._clearing = self._costmap.call_async(topics.CLEAR_GLOBAL_COSTMAP.type.Request())
            self._cleared_at = self.clyde.pose[:2]
            self._cleared_s = self.now_s()

    def farewell(self) -> Iterable[Any]:
        """No obstacle is left behind where nobody is any more."""
        self._obstacle.publish(cloud_message(_OBSTACLE[:0], self.get_clock().now().to_msg(), _OBSTACLE_Z_M))
        return ()


def main(argv: Sequence[str] | None = None) -> int:
    """Run the node; the exit status."""
    return run(ClydeGhostNode, NAME, argv)


if __name__ == "__main__":
    sys.exit(main())
