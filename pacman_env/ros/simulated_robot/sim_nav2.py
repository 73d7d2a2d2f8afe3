"""Nav2 as the game uses it: goals, clearing of the global costmap, and ghosts as obstacles of the planner."""

from collections.abc import Callable
from functools import partial
from typing import Any

from ...sim.navigate_to_pose import Navigation
from .. import topics
from ..message_conversion import GHOST_OBSTACLE, points_of, pose_of
from ..node import GameNode
from .sim_actions import NavigateServer
from .sim_faults import Faults

MARK_LASTS_S = 2.0  # the lidar clears a ghost from the costmap when it is no longer published

Handlers = tuple[tuple[topics.Topic, Callable[[Any], None]], ...]


class Nav2StandIn:
    def __init__(self, node: GameNode, navigation: Navigation, faults: Faults) -> None:
        self.node, self.navigation, self.robot = node, navigation, navigation.robot
        self._marks: dict[int, tuple[float, float]] = {}  # by ghost: its last position, m
        self._marked_step: int | None = None  # step in which the last position arrived
        self.server = NavigateServer(node, navigation, faults)
        self._clear_costmap = topics.CLEAR_GLOBAL_COSTMAP.server(node, self._clear)

    def handlers(self) -> Handlers:
        ghosts = ((topic, partial(self._on_ghost, k)) for k, topic in enumerate(topics.GHOST_POSES))
        return (*ghosts, (topics.CLYDE_OBSTACLE, self._on_obstacle))

    def step(self) -> None:
        if self._marked_step is not None:
            since_s = (self.robot.steps - self._marked_step) * self.robot.config.physics_step_s
            if since_s > MARK_LASTS_S + 1e-6:
                self._unmark()
        self.server.step()

    def open(self) -> None:
        self.server.open()
        self._clear_costmap = topics.CLEAR_GLOBAL_COSTMAP.server(self.node, self._clear)

    def close(self) -> None:
        """Disappear like a dead process."""
        self.server.close()
        self.node.destroy_service(self._clear_costmap)

    def _on_ghost(self, number: int, message: Any) -> None:
        self._marks[number] = pose_of(message)[:2]
        self._mark()

    def _on_obstacle(self, message: Any) -> None:
        points = points_of(message)
        if len(points) == 0:
            self._unmark()
            return
        around = len(points) if len(points) % len(GHOST_OBSTACLE) else len(GHOST_OBSTACLE)
        centres = points.reshape(-1, around, 2).mean(axis=1)
        self._marks = {number: (x, y) for number, (x, y) in enumerate(centres.tolist())}
        self._mark()

    def _mark(self) -> None:
        self.robot.set_obstacles(list(self._marks.values()))
        self._marked_step = self.robot.steps

    def _unmark(self) -> None:
        self._marks.clear()
        self.robot.set_obstacles([])
        self._marked_step = None

    def _clear(self, request: Any, response: Any) -> Any:
        self._unmark()
        return response
