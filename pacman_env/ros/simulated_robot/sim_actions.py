"""Action servers of the simulated robot, and its action ``audio_note_sequence``."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from action_msgs.msg import GoalStatus
from rclpy.action import CancelResponse, GoalResponse
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.duration import Duration
from rclpy.task import Future

from ...sim.robot_simulation import SimulatedRobot
from .. import topics
from ..configured_node import ConfiguredNode
from ..message_conversion import BadMessage, seconds_of
from ..rclpy_private import start_goal

MOST_NOTES = 1000
LONGEST_S = 600.0  # longest sequence of notes


class Server:
    """Action server whose goals end by a call of :meth:`end`.

    ``check`` raises BadMessage to reject a request, and may return a future to wait for before the goal is accepted.
    ``begin`` starts an accepted goal. ``cancel`` returns True if the goal can be cancelled.
    """

    def __init__(
        self,
        node: ConfiguredNode,
        action: topics.RosAction,
        check: Callable[[Any], Future | None],
        begin: Callable[[Any], None],
        cancel: Callable[[Any], bool] = lambda handle: True,
    ) -> None:
        self.node, self.action = node, action
        self._check, self._begin, self._cancel = check, begin, cancel
        self._group = ReentrantCallbackGroup()  # a goal that waits for acceptance does not block others
        self.open()

    def open(self) -> None:
        self._server = self.action.server(
            self.node,
            lambda handle: None,  # ``end`` gives the result
            callback_group=self._group,
            goal_callback=self._judge,
            handle_accepted_callback=self._accepted,
            cancel_callback=lambda handle: CancelResponse.ACCEPT if self._cancel(handle) else CancelResponse.REJECT,
        )

    def close(self) -> None:
        """Disappear like a dead process, without results for goals."""
        self._server.destroy()

    def end(self, handle: Any, status: int, **result: Any) -> None:
        ends = {GoalStatus.STATUS_SUCCEEDED: handle.succeed, GoalStatus.STATUS_CANCELED: handle.canceled}
        ends.get(status, handle.abort)()
        # Called only now: an event-driven executor would poll a coroutine that awaits the goal's end.
        self._server.notify_execute(handle, lambda _: self.action.type.Result(**result))

    async def _judge(self, request: Any) -> Any:
        try:
            delay = self._check(request)
        except BadMessage as error:
            self.node.once.warning(f"{self.action.name} rejected", f"{self.action.name}: goal rejected: {error}")
            return GoalResponse.REJECT
        if delay is not None:
            await delay
        return GoalResponse.ACCEPT

    def _accepted(self, handle: Any) -> None:
        start_goal(handle)
        self._begin(handle)


@dataclass
class _Melody:
    """A melody that plays since ``began_s``: its notes, which last ``length_s``, are played ``iterations`` times."""

    handle: Any
    began_s: float
    length_s: float
    iterations: int

    def progress(self, now_s: float) -> tuple[int, Any]:
        """Return the number of complete iterations, and the playing time as a Duration message."""
        runtime_s = now_s - self.began_s
        played = math.floor(runtime_s / self.length_s + 1e-6)
        return min(played, self.iterations) if self.iterations > 0 else played, Duration(seconds=runtime_s).to_msg()


class Notes:
    """Action ``audio_note_sequence`` with one melody at a time; a new melody ends the current one.

    ``show`` is called with a description of the sound at each start and end of a melody.
    """

    def __init__(self, node: ConfiguredNode, robot: SimulatedRobot, show: Callable[[dict[str, Any]], None]) -> None:
        self._robot, self._show = robot, show
        self._playing: _Melody | None = None
        self._server = Server(node, topics.PLAY_NOTES, self._check, self._begin)

    def _check(self, request: Any) -> None:
        notes = request.note_sequence.notes
        if request.iterations < 1 and request.iterations != topics.PLAY_NOTES.type.Goal.INFINITE:
            raise BadMessage(f"iterations = {request.iterations}: must be at least 1, or -1 for no end")
        if not 1 <= len(notes) <= MOST_NOTES:
            raise BadMessage(f"{len(notes)} notes: must be 1 to {MOST_NOTES}")
        lengths = [seconds_of(note.max_runtime) for note in notes]
        if min(lengths) < 0.0 or not 0.0 < sum(lengths) <= LONGEST_S:
            raise BadMessage(f"notes of {sum(lengths):g} s in all: must be more than 0, at most {LONGEST_S:g} s")

    def _begin(self, handle: Any) -> None:
        self._stop(GoalStatus.STATUS_ABORTED)
        request = handle.request
        notes = [[int(note.frequency), seconds_of(note.max_runtime)] for note in request.note_sequence.notes]
        self._playing = _Melody(handle, self._robot.time_s, sum(seconds for _, seconds in notes), request.iterations)
        self._show({"playing": True, "iterations": request.iterations, "notes": notes})

    def step(self) -> None:
        playing = self._playing
        if playing is None:
            return
        if playing.handle.is_cancel_requested:
            self._stop(GoalStatus.STATUS_CANCELED)
        elif 0 < playing.iterations * playing.length_s <= self._robot.time_s - playing.began_s + 1e-9:
            self._stop(GoalStatus.STATUS_SUCCEEDED)

    def send_feedback(self) -> None:
        if self._playing is not None:
            played, runtime = self._playing.progress(self._robot.time_s)
            feedback = topics.PLAY_NOTES.type.Feedback(iterations_played=played, current_runtime=runtime)
            self._playing.handle.publish_feedback(feedback)

    def _stop(self, status: int) -> None:
        playing, self._playing = self._playing, None
        if playing is not None:
            played, runtime = playing.progress(self._robot.time_s)
            self._show({"playing": False})
            complete = status == GoalStatus.STATUS_SUCCEEDED
            self._server.end(playing.handle, status, complete=complete, iterations_played=played, runtime=runtime)
