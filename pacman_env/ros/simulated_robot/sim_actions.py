"""The simulated robot's two actions: ``navigate_to_pose`` and ``audio_note_sequence``.

``sim/navigate_to_pose.py`` decides what happens to goals; this module receives, checks and answers them.
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from action_msgs.msg import GoalStatus
from rclpy.action import CancelResponse, GoalResponse
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.duration import Duration
from rclpy.task import Future

from ...sim.navigate_to_pose import Navigation
from .. import topics
from ..message_conversion import BadMessage, pose_message, pose_of, seconds_of
from ..node import GameNode
from ..rclpy_private import start_goal
from .sim_faults import Faults

MOST_NOTES = 1000
LONGEST_S = 600.0  # longest sequence of notes


class Server(ABC):
    """Action server whose goals end by a call of :meth:`end`."""

    def __init__(self, node: GameNode, action: topics.RosAction) -> None:
        self.node, self.action = node, action
        self._group = ReentrantCallbackGroup()  # a goal that waits for acceptance does not block others
        self._handles: dict[bytes, Any] = {}  # goals that have not ended
        self._server: Any = None
        self.open()

    def open(self) -> None:
        if self._server is None:
            self._server = self.action.server(
                self.node,
                lambda handle: None,  # ``end`` gives the result
                callback_group=self._group,
                goal_callback=self._judge,
                handle_accepted_callback=self._begin,
                cancel_callback=self._cancel,
            )

    def close(self) -> None:
        """Disappear like a dead process, without results for goals."""
        if self._server is not None:
            self._server.destroy()
            self._server = None
            self._handles.clear()

    def _begin(self, handle: Any) -> None:
        key = bytes(handle.goal_id.uuid)
        self._handles[key] = handle
        start_goal(handle)
        self.begin(key, handle.request)

    def end(self, key: bytes, status: int, **result: Any) -> None:
        handle = self._handles.pop(key)
        ends = {GoalStatus.STATUS_SUCCEEDED: handle.succeed, GoalStatus.STATUS_CANCELED: handle.canceled}
        ends.get(status, handle.abort)()
        # Called only now: an event-driven executor would poll a coroutine that awaits the goal's end.
        self._server.notify_execute(handle, lambda _: self.action.type.Result(**result))

    def publish_feedback(self, key: bytes, **feedback: Any) -> None:
        self._handles[key].publish_feedback(self.action.type.Feedback(**feedback))

    async def _judge(self, request: Any) -> Any:
        try:
            await self.check(request)
        except BadMessage as error:
            self.node.once.warning(f"{self.action.name} rejected", f"{self.action.name}: goal rejected: {error}")
            return GoalResponse.REJECT
        return GoalResponse.ACCEPT

    def _cancel(self, handle: Any) -> Any:
        return CancelResponse.ACCEPT if self.cancel(bytes(handle.goal_id.uuid)) else CancelResponse.REJECT

    @abstractmethod
    async def check(self, request: Any) -> None: ...  # raises BadMessage to reject a goal

    @abstractmethod
    def begin(self, key: bytes, request: Any) -> None: ...  # starts an accepted goal

    @abstractmethod
    def cancel(self, key: bytes) -> bool: ...  # returns True if the goal can be cancelled


class NavigateServer(Server):
    """Server of ``navigate_to_pose``; :meth:`step` is called once for each step of the world."""

    def __init__(self, node: GameNode, navigation: Navigation, faults: Faults) -> None:
        self.navigation, self.faults = navigation, faults
        self._late: list[tuple[float, Future]] = []  # delayed goals: robot time (s) of acceptance, and answer
        super().__init__(node, topics.NAVIGATE_TO_POSE)

    def close(self) -> None:
        self.navigation.drop_goals()
        self._late.clear()
        super().close()

    async def check(self, request: Any) -> None:
        pose_of(request.pose)
        if "reject" in self.faults:
            raise BadMessage("as requested by a fault")
        wait_s = self.faults.number("late_acceptance")
        if wait_s is not None:
            acceptance: Future = Future()
            self._late.append((self.navigation.robot.time_s + wait_s, acceptance))
            await acceptance

    def begin(self, key: bytes, request: Any) -> None:
        x, y, _ = pose_of(request.pose)
        self.navigation.send(key, x, y)

    def cancel(self, key: bytes) -> bool:
        return self.navigation.cancel(key)

    def step(self) -> None:
        for goal in self.navigation.step():
            if goal.message:
                self.node.get_logger().info(f"goal ended with code {goal.error_code}: {goal.message}")
            self.end(goal.key, goal.status, error_code=goal.error_code, error_msg=goal.message)
        now = self.navigation.robot.time_s
        for due, acceptance in self._late:
            if due <= now:
                acceptance.set_result(None)
        self._late = [one for one in self._late if one[0] > now]

    def send_feedback(self, stamp: Any) -> None:
        feedback = self.navigation.feedback()
        if feedback is not None:
            self.publish_feedback(
                feedback.key,
                current_pose=pose_message(*feedback.pose, stamp),
                navigation_time=Duration(seconds=feedback.time_s).to_msg(),
                estimated_time_remaining=Duration(seconds=feedback.remaining_s).to_msg(),
                number_of_recoveries=feedback.recoveries,
                distance_remaining=feedback.distance_m,
            )


@dataclass
class _Melody:
    """A melody that plays since ``began_s``: its notes, which last ``length_s``, are played ``iterations`` times."""

    key: bytes
    began_s: float
    length_s: float
    iterations: int
    canceled: bool = False


class NotesServer(Server):
    """Server of ``audio_note_sequence`` with one melody at a time; a new melody ends the current one.

    ``show`` is called with a description of the sound at each start and end of a melody.
    """

    def __init__(self, node: GameNode, show: Callable[[dict[str, Any]], None]) -> None:
        self._show = show
        self._playing: _Melody | None = None
        self._now_s = 0.0
        super().__init__(node, topics.PLAY_NOTES)

    async def check(self, request: Any) -> None:
        notes = request.note_sequence.notes
        if request.iterations < 1 and request.iterations != self.action.type.Goal.INFINITE:
            raise BadMessage(f"iterations = {request.iterations}: must be at least 1, or -1 for no end")
        if not 1 <= len(notes) <= MOST_NOTES:
            raise BadMessage(f"{len(notes)} notes: must be 1 to {MOST_NOTES}")
        lengths = [seconds_of(note.max_runtime) for note in notes]
        if min(lengths) < 0.0 or not 0.0 < sum(lengths) <= LONGEST_S:
            raise BadMessage(f"notes of {sum(lengths):g} s in all: must be more than 0, at most {LONGEST_S:g} s")

    def begin(self, key: bytes, request: Any) -> None:
        self._stop(GoalStatus.STATUS_ABORTED)
        notes = [[int(note.frequency), seconds_of(note.max_runtime)] for note in request.note_sequence.notes]
        self._playing = _Melody(key, self._now_s, sum(seconds for _, seconds in notes), request.iterations)
        self._show({"playing": True, "iterations": request.iterations, "notes": notes})

    def cancel(self, key: bytes) -> bool:
        if self._playing is None or self._playing.key != key:
            return False
        self._playing.canceled = True
        return True

    def step(self, now_s: float) -> None:
        self._now_s = now_s
        playing = self._playing
        if playing is None:
            return
        if playing.canceled:
            self._stop(GoalStatus.STATUS_CANCELED)
        elif 0 < playing.iterations * playing.length_s <= now_s - playing.began_s + 1e-9:
            self._stop(GoalStatus.STATUS_SUCCEEDED)

    def send_feedback(self) -> None:
        if self._playing is not None:
            played, runtime = self._progress(self._playing)
            self.publish_feedback(self._playing.key, iterations_played=played, current_runtime=runtime)

    def _progress(self, playing: _Melody) -> tuple[int, Any]:
        """Return the number of complete iterations, and the playing time as a Duration message."""
        runtime_s = self._now_s - playing.began_s
        played = math.floor(runtime_s / playing.length_s + 1e-6)
        if playing.iterations > 0:
            played = min(played, playing.iterations)
        return played, Duration(seconds=runtime_s).to_msg()

    def _stop(self, status: int) -> None:
        playing, self._playing = self._playing, None
        if playing is not None:
            played, runtime = self._progress(playing)
            self._show({"playing": False})
            complete = status == GoalStatus.STATUS_SUCCEEDED
            self.end(playing.key, status, complete=complete, iterations_played=played, runtime=runtime)
