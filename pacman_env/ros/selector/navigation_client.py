"""Asynchronous client of Nav2's NavigateToPose with numbered goals; it never blocks and makes no decisions."""

import uuid
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

from action_msgs.msg import GoalStatus
from rclpy.task import Future
from unique_identifier_msgs.msg import UUID

from pacman_env.game.execution import CANCELED
from pacman_env.ros import topics
from pacman_env.ros.message_conversion import BadMessage, Pose, Position, pose_message, pose_of, twist_message
from pacman_env.ros.selector.message_queue import MessageQueue

LOST_GOALS_S = 2.0  # between calls of ``end_without_results``
_CANCELLING, _UNKNOWN_GOAL = 0, 2  # action_msgs/CancelGoal
_REQUEST_AGAIN_S = 5.0  # between requests of a result
_CLEAR_S = 1.0  # longest wait for the answer to a cancel of all goals
_ENDED = (GoalStatus.STATUS_SUCCEEDED, GoalStatus.STATUS_CANCELED, GoalStatus.STATUS_ABORTED)
_RUNNING = (GoalStatus.STATUS_ACCEPTED, GoalStatus.STATUS_EXECUTING)


@dataclass
class _SentGoal:
    name: UUID
    accepted: bool = False
    request: Future | None = None  # request of the result
    requested_s: float = 0.0
    status: int | None = None  # set if the goal has ended without a result so far
    overdue: bool = False  # ``status`` was set when ``end_without_results`` was last called


class NavigationClient:
    """Send and cancel goals by number; report when Nav2 has accepted, rejected or finished a goal.

    All callbacks get the goal's number. ``finished`` also gets its status (action_msgs/GoalStatus) and the last
    position of the robot in Nav2's feedback.
    """

    def __init__(
        self,
        node: Any,
        accepted: Callable[[int], None],
        rejected: Callable[[int], None],
        finished: Callable[[int, int, Position | None], None],
    ) -> None:
        self._node = node
        action = topics.NAVIGATE_TO_POSE
        # Not rclpy's ActionClient, which wakes the executor for each feedback: Nav2 sends 100 per second.
        self._sender, self._results = action.goal_client(node), action.result_client(node)
        self._canceller = topics.cancel_client(node, action.name)
        self._cmd_vel = topics.CMD_VEL.publisher(node)
        self._clients = (self._sender, self._results, self._canceller)
        self._feedback = MessageQueue(node, action.feedback, self._on_feedback)
        self._statuses = action.statuses.subscription(node, self._on_statuses)
        self._clearing: tuple[Future, float] | None = None  # answer to ``clear``, and its deadline
        self._accepted, self._rejected, self._finished = accepted, rejected, finished
        self._goals: dict[int, _SentGoal] = {}
        self._newest: Any = None  # newest feedback, of any goal
        self._forbidden = False  # if True, every goal of any node is cancelled
        self._all_ended: Future | None = None  # result of ``finish``
        self.last_status, self.last_error = 0, 0  # result of the last goal that ended

    @property
    def ready(self) -> bool:
        return all(client.service_is_ready() for client in self._clients)

    def clear(self) -> bool:
        """Cancel all earlier goals and return True once they are cancelled; call this until it returns True.

        The goal of a killed node is still active, and Nav2 drives to it. A goal sent too early would also be cancelled.
        """
        if self._clearing is None and self.ready:
            request = self._canceller.srv_type.Request()  # all zero: every goal
            self._clearing = self._canceller.call_async(request), self._node.now_s() + _CLEAR_S
        if self._clearing is None:
            return False
        answer, end = self._clearing
        return self._node.now_s() > end or (answer.done() and not answer.result().goals_canceling)

    def forbid(self, forbidden: bool) -> None:
        """Stop the robot and cancel every goal of any node, or end that."""
        self._forbidden = forbidden
        if forbidden:
            self.stop_wheels()
            if self._canceller.service_is_ready():
                self._canceller.call_async(self._canceller.srv_type.Request())  # all zero: every goal

    def _on_statuses(self, message: Any) -> None:
        status_of = {bytes(goal.goal_info.goal_id.uuid): goal.status for goal in message.status_list}
        for own in self._goals.values():
            status = status_of.get(bytes(own.name.uuid))
            if own.accepted and status in _ENDED:
                own.status = status
        if not self._forbidden and (self._clearing is None or self._node.now_s() > self._clearing[1]):
            return
        # A foreign goal that appears just after all goals were cancelled was in transit at that time.
        names = {bytes(own.name.uuid) for own in self._goals.values()}
        for goal in message.status_list:
            if goal.status in _RUNNING and bytes(goal.goal_info.goal_id.uuid) not in names:
                self._canceller.call_async(self._canceller.srv_type.Request(goal_info=goal.goal_info))

    def end_without_results(self) -> None:
        """End goals that Nav2 reports as ended but whose result was lost; call this every few seconds.

        Late results are requested again: a restarted server answers that it does not know the goal.
        """
        for number, goal in list(self._goals.items()):
            late = self._node.now_s() - goal.requested_s > _REQUEST_AGAIN_S
            if late and goal.request is not None and self._results.service_is_ready():
                self._results.remove_pending_request(goal.request)
                self._request_result(number, goal)
            if goal.status is not None and goal.overdue:
                self._end(number, goal.status, 0)
            goal.overdue = goal.status is not None

    def send(self, number: int, pose: Pose) -> None:
        goal = self._goals[number] = _SentGoal(UUID(uuid=list(uuid.uuid4().bytes)))
        request = self._sender.srv_type.Request(goal_id=goal.name)
        request.goal.pose = pose_message(*pose, self._node.get_clock().now().to_msg())
        self._sender.call_async(request).add_done_callback(partial(self._on_answer, number, goal))

    def cancel(self, number: int) -> None:
        """Ask Nav2 to cancel a goal, even if its acceptance is unknown: the answer may have been lost."""
        if number in self._goals and self._canceller.service_is_ready():
            request = self._canceller.srv_type.Request()
            request.goal_info.goal_id = self._goals[number].name
            self._canceller.call_async(request).add_done_callback(partial(self._on_cancel, number))

    def stop_wheels(self) -> None:
        self._cmd_vel.publish(twist_message(0.0, 0.0, self._node.get_clock().now().to_msg()))

    def finish(self) -> tuple[Future, ...]:
        """Stop the wheels; return a future that is done when all goals have ended.

        Cancels the goals that Nav2 has not yet accepted.
        """
        self.stop_wheels()
        for number, goal in self._goals.items():
            if not goal.accepted:
                self.cancel(number)
        self._all_ended = Future()
        self._all_ended.add_done_callback(lambda _: self.stop_wheels())  # again: Nav2 drove until it got the cancels
        self._check_all_ended()
        return (self._all_ended,)

    def _on_feedback(self, message: Any, waited_s: float) -> None:
        self._newest = message

    def _on_answer(self, number: int, goal: _SentGoal, answer: Any) -> None:
        if answer.result().accepted:
            goal.accepted = True
            self._goals[number] = goal  # again: a cancel may have removed it
            self._request_result(number, goal)
            self._accepted(number)
        else:
            self._goals.pop(number, None)
            self._rejected(number)
        self._check_all_ended()

    def _request_result(self, number: int, goal: _SentGoal) -> None:
        request = self._results.srv_type.Request(goal_id=goal.name)
        goal.request, goal.requested_s = self._results.call_async(request), self._node.now_s()
        goal.request.add_done_callback(partial(self._on_result, number))

    def _on_result(self, number: int, answer: Any) -> None:
        result = answer.result()
        status = CANCELED if result.status == GoalStatus.STATUS_UNKNOWN else result.status
        self._end(number, status, getattr(result.result, "error_code", 0))

    def _on_cancel(self, number: int, answer: Any) -> None:
        # No result will come: the server was restarted, or its acceptance of the goal was lost.
        goal, code = self._goals.get(number), answer.result().return_code
        if goal is not None and code == (_UNKNOWN_GOAL if goal.accepted else _CANCELLING):
            self._end(number, CANCELED, 0)

    def _end(self, number: int, status: int, error: int) -> None:
        goal = self._goals.pop(number, None)
        if goal is None:
            return
        self.last_status, self.last_error = status, error
        self._finished(number, status, self._seen_at(goal.name))
        self._check_all_ended()

    def _seen_at(self, name: UUID) -> Position | None:
        self._feedback.catch_up()
        if self._newest is None or self._newest.goal_id != name:
            return None
        try:
            return pose_of(self._newest.feedback.current_pose)[:2]
        except BadMessage:
            return None

    def _check_all_ended(self) -> None:
        if self._all_ended is not None and not self._all_ended.done() and not self._goals:
            self._all_ended.set_result(True)
