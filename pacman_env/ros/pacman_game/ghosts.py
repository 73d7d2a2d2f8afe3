"""Clyde and the other ghosts of a robot's game, shown as poses, markers and obstacles.

Targets and motion of ghosts are the simulator's (``sim/ghost_state.py``); here they get a clock and topics. Policies
that move ghosts get the same situation as the robot's policy.
"""

import math
from collections.abc import Collection, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pacman_env.config import Config
from pacman_env.game.ghosts import GHOSTS, POLICY
from pacman_env.game.power import EYES, frightened_colour
from pacman_env.levels.assets import map_assets
from pacman_env.observations.robot_view import RobotView, Seen
from pacman_env.ros import message_conversion as messages
from pacman_env.ros import topics
from pacman_env.ros.configured_node import ConfiguredNode
from pacman_env.ros.message_conversion import GHOST_OBSTACLE, BadMessage, Pose, Position
from pacman_env.ros.node import parameter
from pacman_env.ros.pacman_game.ghost_trail import CostmapClearing, GhostTrail
from pacman_env.ros.selector.asked_policy import AskedPolicy
from pacman_env.ros.selector.policy_child import Answer
from pacman_env.sim.ghost_state import GHOST_CHOICE, MapGhosts

_DIAMETER_M = 0.35  # diameter of the marker, as in the original
_OBSTACLE_Z_M = 0.25  # height at which the costmap expects a ghost, as in the original
_CATCH_UP_S = 1.0  # longest delay of the timer that is caught up


class GameGhosts:
    """Ghosts that move only while the game is running; ``config`` names ``policy`` for each ghost of a policy.

    ``policy`` drives the ghosts of policies.
    """

    def __init__(self, node: ConfiguredNode, config: Config, seed: int, policy: AskedPolicy | None) -> None:
        self._node, self._config, self._policy = node, config, policy
        text = (
            "shortest time between two clearings of the global costmap, s; 0: never; the original's Nav2 file needs 5"
        )
        clear_s = parameter(node, "clear_costmap_s", 0.0, text, 0.0, 3600.0)
        assets = map_assets(node.map, config)
        self.moved = MapGhosts(assets, config, seed)
        self._players = [number for number, name in enumerate(config.clyde.ghosts) if name == POLICY]
        self._view = RobotView(assets, config, seed) if self._players else None
        self._choices = np.zeros(len(self.moved), dtype=GHOST_CHOICE)  # all wander
        self._asked: set[int] = set()  # ghosts with an open question
        self._begins: set[int] = set()  # ghosts whose policy was not asked in this round
        self.moved.compile_kernels(self._choices)
        self._left: dict[int, Position] = {}
        self._decided_s, self._began_s = -math.inf, 0.0
        self._stepped_s: float | None = None  # time of the last step in this round
        self._owed_s = 0.0
        self._state = "menu"
        self._home: Position | None = None  # the robot's first pose, later its pose at the start of a round
        self._robot: Pose | None = None
        self.harmless = np.zeros((len(self.moved), 2))  # ROS times, s: harmless until, away until
        self._chosen: int | None = None  # Clyde's cell for the next round, set by a click

        self._poses = [topic.publisher(node) for topic in topics.GHOST_POSES[: len(self.moved)]]
        self._marker = topics.CLYDE_MARKER.publisher(node)
        self._obstacle = topics.CLYDE_OBSTACLE.publisher(node)
        self._trail, self._trail_out = GhostTrail(), topics.CLYDE_TRAIL.publisher(node)
        self._costmap = CostmapClearing(node, clear_s, self.places)

    @property
    def places(self) -> list[Position]:
        return [pose[:2] for pose in self.moved.poses]

    def on_state(self, state: str) -> None:
        if state == "running" != self._state:
            self._chosen = self._stepped_s = None
            self._began_s, self._owed_s = self._node.now_s(), 0.0
            self._begins = set(self._players)
            self._asked.clear()  # a policy that was changed in the menu left questions without answers
            if self._view is not None:
                self._view.begin()
        if state == "returning_home" != self._state:
            self._costmap.request(self.places)  # ghosts are harmless on the return home and must not block it
        if state == "starting" != self._state and self._robot is not None:
            self._home = self._robot[:2]  # the first pose is not the home if the game was resumed
            self._keep_away()
        self._state = state

    def set_speed(self, mps: float) -> None:
        self.moved.speed_mps = mps
        if self._view is not None:
            self._view.clyde_speed_mps = mps

    def set_harmless(self, times: NDArray[np.float64]) -> None:
        """Set the ROS times until which each ghost is harmless and away: (G, 2), s."""
        before, self.harmless = self.harmless, times
        self.moved.send_back(np.flatnonzero(times[:, 1] > before[:, 1]).tolist())
        if times.any():
            self._costmap.request(self.places)  # harmless ghosts must not block the way

    def set_pellets(self, left: dict[int, Position], power: Collection[int]) -> None:
        self._left = left
        if self._view is not None:
            self._view.pellets(left, power)

    def on_robot(self, message: Any) -> None:
        pose = messages.pose_of(message)
        first = self._robot is None and self._state != "running"  # ghosts of a resumed round stay where they are
        self.moved.see_robot(pose)
        self._robot = pose
        if first:
            self._home = pose[:2]
            self._keep_away()  # the ghosts were placed without the robot's pose

    def _keep_away(self) -> None:
        """Move ghosts away from the robot, except a Clyde that was placed there by a click."""
        if self._robot is not None:
            least_m, robot = self._config.clyde.spawn_distance_m, self._robot[:2]
            neighbours = [k for k, at in enumerate(self.places) if math.dist(robot, at) < least_m]
            self._respawn([k for k in neighbours if k > 0 or self._chosen is None])

    def on_click(self, message: Any) -> None:
        cell, distance = self.moved.cells.nearest(*messages.point_of(message))
        if self._state == "running":
            raise BadMessage("Clyde can be placed only before a round")
        if distance > self._config.clyde.click_distance_m:
            raise BadMessage(f"Clyde cannot be there: {distance:.2f} m from the nearest place wide enough for a ghost")
        self._node.once.over("bad click")
        self._chosen = cell
        self._respawn([0])

    def respawn(self) -> None:
        self._respawn(range(len(self.moved)))

    def _respawn(self, numbers: Sequence[int]) -> None:
        if not numbers:
            return
        random = [k for k in numbers if k > 0 or self._chosen is None]
        robot = None if self._robot is None else self._robot[:2]
        self.moved.respawn([place for place in (self._home, robot) if place is not None], random)
        if self._chosen is not None and 0 in numbers:
            self.moved.place(0, self._chosen)
        self.show()

    def restore(self, places: Sequence[Sequence[float]]) -> None:
        """Place the ghosts of an earlier process, positions in m."""
        for number, (x, y) in enumerate(places[: len(self.moved)]):
            self.moved.place(number, self.moved.cells.nearest(float(x), float(y))[0])

    def update(self) -> None:
        """Move the ghosts by the time since the last call and show them; called every ``clyde.update_period_s``."""
        if self._state == "running":
            now = self._node.now_s()
            self.moved.see_harmless(np.maximum(self.harmless - now, 0.0))
            if not 0 <= now - self._decided_s < self._config.execution.tick_s - 1e-6:
                self._decided_s = now
                self._ask(now)
                self.moved.decide(self._choices)
            for _ in range(self._steps_due(now)):
                self.moved.step()
            self._costmap.moved(self.places)
        self.show()

    def _steps_due(self, now: float) -> int:
        """Return the steps due at ``now``, s: 1, or 2 to catch up after a late timer, so ghosts keep their speed."""
        period_s, last_s, self._stepped_s = self._config.clyde.update_period_s, self._stepped_s, now
        late_s = 0.0 if last_s is None else max(now - last_s - period_s, 0.0)
        self._owed_s = min(self._owed_s + late_s, _CATCH_UP_S)
        if self._owed_s < period_s / 2:
            return 1
        self._owed_s -= period_s
        return 2

    def _ask(self, now: float) -> None:
        """Ask the policies of ghosts; a late answer counts from the next decision on."""
        if self._view is None or self._robot is None or self._policy is None or not self._policy.process.ready:
            return
        seen = Seen(now - self._began_s, self._robot, self._left, harmless_s=np.maximum(self.harmless - now, 0.0))
        for number in set(self._players) - self._asked:
            self._asked.add(number)
            self._policy.process.ask(number, self._view.situation(seen, number), number in self._begins)
            self._begins.discard(number)
        self._policy.asked()

    def on_answer(self, answer: Answer) -> None:
        if answer.error:  # of any policy: all are asked again when they have been started again
            self._asked.clear()
            self._begins = set(self._players)
            self._choices[:] = 0
        elif answer.player >= 0:
            self._asked.discard(answer.player)
            self._choices[answer.player] = answer.choice

    def show(self) -> None:
        now = self._node.get_clock().now()
        stamp, poses, nav2 = now.to_msg(), self.moved.poses, self._config.nav2
        left_s = self.harmless - self._node.now_s()
        for number, (pose, publisher) in enumerate(zip(poses, self._poses, strict=True)):
            if self._view is not None:
                self._view.see_ghost(number, *pose[:2], now.nanoseconds)
            publisher.publish(messages.pose_message(*pose, stamp))
            (harmless_s, away_s), own = left_s[number], GHOSTS[number].colour
            look = frightened_colour(harmless_s, self._config.power.warning_s) if harmless_s > 0 else own
            red, green, blue = EYES if away_s > 0 else look
            colour = red / 255, green / 255, blue / 255
            marker = messages.marker_message(messages.GHOSTS, number + 1, pose[:2], _DIAMETER_M, colour, stamp)
            self._marker.publish(marker)
        radius_m = max(nav2.clyde_keepout_m - self._config.robot.inscribed_radius_m, 0.0)
        harmful = (left_s[:, 0] <= 0) & (self._state != "returning_home")
        around = np.array(self.places)[harmful, None] + radius_m * GHOST_OBSTACLE  # original: 0.05 m
        self._show_clouds(around.reshape(-1, 2), self._trail.points(self.places, self._node.now_s()), stamp)

    def _show_clouds(self, obstacle: NDArray[np.float64], trail: NDArray[np.float64], stamp: Any) -> None:
        self._obstacle.publish(messages.cloud_message(obstacle, stamp, _OBSTACLE_Z_M))
        self._trail_out.publish(messages.cloud_message(trail, stamp, _OBSTACLE_Z_M))

    def hide(self) -> None:
        """Remove the obstacles at the end of the process."""
        nothing = GHOST_OBSTACLE[:0]
        self._show_clouds(nothing, nothing, self._node.get_clock().now().to_msg())
