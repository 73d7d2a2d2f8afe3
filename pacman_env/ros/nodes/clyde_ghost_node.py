"""Node ``clyde_ghost_node``: Clyde and the other ghosts on the map, as poses, markers and obstacles.

Targets and motion of ghosts are the simulator's (``sim/ghost_state.py``); this node adds a clock and topics.
Policies that move ghosts get the same situation as the robot's policy.
"""

import math
import sys
from collections.abc import Iterable, Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pacman_env.config import MAX_SPEED_MPS
from pacman_env.game.ghosts import GHOSTS
from pacman_env.game.power import EYES, frightened_colour
from pacman_env.levels.assets import map_assets
from pacman_env.observations.robot_view import Pellets, RobotView, Seen
from pacman_env.policies.policy_calls import PolicyError, choose, reset
from pacman_env.policies.registry import split_ghosts
from pacman_env.sim.ghost_state import GHOST_CHOICE, MapGhosts, choices_of

from .. import message_conversion as messages
from .. import topics
from ..message_conversion import GHOST_OBSTACLE, BadMessage, Pose, Position
from ..node import GameNode, parameter, run
from .ghost_trail import CostmapClearing, GhostTrail

NAME = "clyde_ghost_node"
_DIAMETER_M = 0.35  # diameter of the marker, as in the original
_OBSTACLE_Z_M = 0.25  # height at which the costmap expects a ghost, as in the original
_LISTEN_S = 2.0  # wall time; a new node waits at most this time for the robot's pose
_CATCH_UP_S = 1.0  # longest delay of the timer that is caught up


class ClydeGhostNode(GameNode):
    """Node of the ghosts, which move only while the game is running."""

    def __init__(self) -> None:
        super().__init__(NAME, with_map=True)
        seed = parameter(self, "seed", -1, "random seed of the ghosts; -1: a new one at each start", -1, 2**31 - 1)
        text = (
            "shortest time between two clearings of the global costmap, s; 0: never; the original's Nav2 file needs 5"
        )
        clear_s = parameter(self, "clear_costmap_s", 0.0, text, 0.0, 3600.0)
        seed = self.surroundings.new_seed() if seed < 0 else seed
        behaviours, self._policies = split_ghosts(self.config.clyde.ghosts)
        config = self.config.with_fields(**{"clyde.ghosts": behaviours})
        assets = map_assets(self.map, config)
        self._view = RobotView(assets, config, seed)
        self._pellets: Pellets | None = None
        self._decided_s, self._began_round_s = -math.inf, 0.0
        self._stepped_s: float | None = None  # time of the last step in this round
        self._owed_s = 0.0
        self._state = "menu"
        self._began_s = self.surroundings.monotonic()
        self._home: Position | None = None  # the robot's first pose, later its pose at the start of a round
        self._robot: Pose | None = None
        self._harmless = np.zeros((len(behaviours), 2))  # ROS times, s: harmless until, away until
        self._chosen: int | None = None  # Clyde's cell for the next round, set by a click
        self.ghosts = MapGhosts(assets, config, seed)
        self.ghosts.compile_kernels(self._choices())

        self._poses = [topic.publisher(self) for topic in topics.GHOST_POSES[: len(behaviours)]]
        self._marker = topics.CLYDE_MARKER.publisher(self)
        self._obstacle = topics.CLYDE_OBSTACLE.publisher(self)
        self._trail, self._trail_out = GhostTrail(), topics.CLYDE_TRAIL.publisher(self)
        self._costmap = CostmapClearing(self, clear_s, self._places())
        self.listen(topics.GAME_STATE, self._on_state, "bad state")
        self.listen(topics.CLYDE_SPEED, self._on_speed, "bad speed")
        self.listen(topics.AMCL_POSE, self._on_robot, "bad robot pose")
        self.listen(topics.CLICKED_POINT, self._on_click, "bad click")
        if config.power.pellets > 0:
            self.listen(topics.HARMLESS_GHOSTS, self._on_harmless, "bad times of ghosts")
        if self._policies:
            self.listen(topics.PELLET_MARKERS, self._on_pellets, "bad pellets")
        topics.RESET_CLYDE.server(self, self._on_reset)
        self.create_timer(config.clyde.update_period_s, self._update)
        self.get_logger().info(f"{', '.join(self.config.clyde.ghosts)} on {self.map.name}, seed {seed}")

    def _on_state(self, message: Any) -> None:
        state = messages.word_of(message, topics.STATE_WORDS)
        if state == "running" != self._state:
            self._chosen = self._stepped_s = None
            self._began_round_s, self._owed_s = self.now_s(), 0.0
            self._view.begin()
            for policy in self._policies.values():
                reset(policy, np.ones(1, np.bool_), self.config)
        if state == "returning_home" != self._state:
            self._costmap.request(self._places())  # ghosts are harmless on the return home and must not block it
        if state == "starting" != self._state and self._robot is not None:
            self._home = self._robot[:2]  # the first pose is not the home if this node was started during a game
            self._keep_away()
        self._state = state

    def _on_speed(self, message: Any) -> None:
        self.ghosts.speed_mps = self._view.clyde_speed_mps = messages.number_of(message, 0.0, MAX_SPEED_MPS)

    def _on_harmless(self, message: Any) -> None:
        before, self._harmless = self._harmless, messages.ghost_times_of(message, len(self.ghosts))
        caught = np.flatnonzero(self._harmless[:, 1] > before[:, 1])
        self.ghosts.send_back(caught.tolist())  # now: the message may be so late that the ghosts have already returned
        if self._harmless.any():
            self._costmap.request(self._places())  # harmless ghosts must not block the way

    def _on_pellets(self, message: Any) -> None:
        self._pellets = self._view.pellets(messages.pellets_of(message), messages.power_pellets_of(message))

    def _on_robot(self, message: Any) -> None:
        pose, first = messages.pose_of(message), self._robot is None
        self.ghosts.see_robot(pose)
        self._robot = pose
        if first:
            self._home = pose[:2]
            self._keep_away()  # the ghosts were placed without the robot's pose

    def _keep_away(self) -> None:
        """Move ghosts away from the robot, except a Clyde that was placed there by a click."""
        if self._robot is not None:
            least_m, robot = self.config.clyde.spawn_distance_m, self._robot[:2]
            neighbours = [k for k, at in enumerate(self._places()) if math.dist(robot, at) < least_m]
            self._respawn([k for k in neighbours if k > 0 or self._chosen is None])

    def _on_click(self, message: Any) -> None:
        cell, distance = self.ghosts.cells.nearest(*messages.point_of(message))
        if self._state == "running":
            raise BadMessage("Clyde can be placed only before a round")
        if distance > self.config.clyde.click_distance_m:
            raise BadMessage(f"Clyde cannot be there: {distance:.2f} m from the nearest place wide enough for a ghost")
        self.once.over("bad click")
        self._chosen = cell
        self._respawn([0])

    def _on_reset(self, request: Any, response: Any) -> Any:
        self._respawn(range(len(self.ghosts)))
        response.success, response.message = True, "Clyde at ({:.2f}, {:.2f})".format(*self.ghosts.poses[0])
        return response

    def _respawn(self, numbers: Sequence[int]) -> None:
        if not numbers:
            return
        random = [k for k in numbers if k > 0 or self._chosen is None]
        robot = None if self._robot is None else self._robot[:2]
        self.ghosts.respawn([place for place in (self._home, robot) if place is not None], random)
        if self._chosen is not None and 0 in numbers:
            self.ghosts.place(0, self._chosen)
        self._show()

    def _places(self) -> list[Position]:
        return [pose[:2] for pose in self.ghosts.poses]

    def _update(self) -> None:
        if self._robot is None and self.surroundings.monotonic() - self._began_s < _LISTEN_S:
            return  # started during a round: ghosts could appear next to the robot
        if self._state == "running":
            now = self.now_s()
            self.ghosts.see_harmless(np.maximum(self._harmless - now, 0.0))
            if not 0 <= now - self._decided_s < self.config.execution.tick_s - 1e-6:
                self._decided_s = now
                self.ghosts.decide(self._choices())
            for _ in range(self._steps_due(now)):
                self.ghosts.step()
            self._costmap.moved(self._places())
        self._show()

    def _steps_due(self, now: float) -> int:
        """Return the steps due at ``now``, s: 1, or 2 to catch up after a late timer, so ghosts keep their speed."""
        period_s, last_s, self._stepped_s = self.config.clyde.update_period_s, self._stepped_s, now
        late_s = 0.0 if last_s is None else max(now - last_s - period_s, 0.0)
        self._owed_s = min(self._owed_s + late_s, _CATCH_UP_S)
        if self._owed_s < period_s / 2:
            return 1
        self._owed_s -= period_s
        return 2

    def _choices(self) -> NDArray[Any]:
        """Return the choices (G,) of the ghosts' policies, of type ``GHOST_CHOICE``; ghosts without a policy wander."""
        choices = np.zeros(len(self.config.clyde.ghosts), dtype=GHOST_CHOICE)
        for number, policy in self._policies.items():
            if self._pellets is None or self._robot is None:
                situation = self._view.sample_situation(number)  # calling the policy compiles or loads it
            else:
                now = self.now_s()
                harmless_s = np.maximum(self._harmless - now, 0.0)
                seen = Seen(now - self._began_round_s, self._robot, self._pellets.known, harmless_s=harmless_s)
                situation = self._view.situation(seen, number)
            try:
                choices[number] = choices_of(choose(policy, situation))[0]
            except PolicyError as error:
                self.once.warning(f"policy of ghost {number} fails", f"{error}; the ghost wanders")
        return choices

    def _show(self) -> None:
        now = self.get_clock().now()
        stamp, poses, nav2 = now.to_msg(), self.ghosts.poses, self.config.nav2
        left_s = self._harmless - now.nanoseconds / 1e9
        for number, (pose, publisher) in enumerate(zip(poses, self._poses, strict=True)):
            self._view.see_ghost(number, *pose[:2], now.nanoseconds)
            publisher.publish(messages.pose_message(*pose, stamp))
            (harmless_s, away_s), own = left_s[number], GHOSTS[number].colour
            look = frightened_colour(harmless_s, self.config.power.warning_s) if harmless_s > 0 else own
            red, green, blue = EYES if away_s > 0 else look
            colour = red / 255, green / 255, blue / 255
            marker = messages.marker_message(messages.GHOSTS, number + 1, pose[:2], _DIAMETER_M, colour, stamp)
            self._marker.publish(marker)
        radius_m = max(nav2.clyde_keepout_m - self.config.robot.inscribed_radius_m, 0.0)
        harmful = (left_s[:, 0] <= 0) & (self._state != "returning_home")
        around = np.array(self._places())[harmful, None] + radius_m * GHOST_OBSTACLE  # original: 0.05 m
        self._show_obstacle(around.reshape(-1, 2), stamp)
        self._show_trail(self._places(), stamp)

    def _show_obstacle(self, points: NDArray[np.float64], stamp: Any) -> None:
        self._obstacle.publish(messages.cloud_message(points, stamp, _OBSTACLE_Z_M))

    def _show_trail(self, places: Sequence[Position], stamp: Any) -> None:
        points = self._trail.points(places, self.now_s())
        self._trail_out.publish(messages.cloud_message(points, stamp, _OBSTACLE_Z_M))

    def last_messages(self) -> Iterable[Any]:
        stamp = self.get_clock().now().to_msg()
        self._show_obstacle(GHOST_OBSTACLE[:0], stamp)
        self._show_trail((), stamp)
        return ()


main = partial(run, ClydeGhostNode, NAME)

if __name__ == "__main__":
    sys.exit(main())
