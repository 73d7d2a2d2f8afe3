"""A small real NavigateToPose server that answers as a script says, and treats goals of others as Nav2 does."""

from dataclasses import dataclass
from typing import Any

from rclpy.action import CancelResponse, GoalResponse
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.task import Future

from pacman_env.ros import topics
from pacman_env.ros.node import BaseNode

NAME = "bt_navigator"


@dataclass
class Goal:
    """One goal that was asked for; ``handle`` is there once it is accepted."""

    x: float
    y: float
    handle: Any = None
    cancelled: bool = False
    ended: bool = False

    @property
    def running(self) -> bool:
        return self.handle is not None and not self.ended


class ScriptedNav2(BaseNode):
    """Answers each goal with the next word of ``script``, and with ``accept`` when that is used up.

    Words: ``accept``, ``reject``, ``late`` (accepted when ``let_in`` is called) and ``nothing`` (never answered). A new
    goal pre-empts the one that runs, which ends aborted; a cancel ends all.
    """

    def __init__(self, *script: str, **options: Any) -> None:
        super().__init__(NAME, **options)
        self.script = list(script)
        self.goals: list[Goal] = []
        self._late: list[Future] = []
        self._asked: list[Goal] = []  # not accepted yet
        self._server = topics.NAVIGATE_TO_POSE.server(
            self,
            lambda handle: None,
            goal_callback=self._answer,
            handle_accepted_callback=self._accepted,
            cancel_callback=self._cancel,
            callback_group=ReentrantCallbackGroup(),
        )

    @property
    def all(self) -> list[tuple[float, float]]:
        """Where every goal led that was asked for, whatever became of it."""
        return [(goal.x, goal.y) for goal in self.goals]

    def running(self) -> list[Goal]:
        """Goals that the robot is driven to."""
        return [goal for goal in self.goals if goal.running]

    def let_in(self) -> None:
        for gate in self._late:
            gate.set_result(True)
        self._late.clear()

    def succeed(self, goal: Goal) -> None:
        self._end(goal, "succeed")

    def abort(self, goal: Goal, error: int = 208) -> None:
        """No way, or stuck."""
        self._end(goal, "abort", error)

    async def _answer(self, request: Any) -> GoalResponse:
        word = self.script.pop(0) if self.script else "accept"
        position = request.pose.pose.position
        goal = Goal(position.x, position.y)
        self.goals.append(goal)
        if word == "reject":
            return GoalResponse.REJECT
        if word in ("late", "nothing"):
            gate = Future()
            if word == "late":
                self._late.append(gate)
            await gate
        self._asked.append(goal)
        return GoalResponse.ACCEPT

    def _accepted(self, handle: Any) -> None:
        before = self.running()
        self._asked.pop(0).handle = handle
        for goal in before:
            self._end(goal, "abort")

    def _cancel(self, handle: Any) -> CancelResponse:
        for goal in self.running():
            goal.cancelled = True
            self._end(goal, "canceled" if goal.handle is handle else "abort")
        return CancelResponse.ACCEPT

    def _end(self, goal: Goal, how: str, error: int = 0) -> None:
        goal.ended = True
        goal.handle.execute(lambda own: self._finish(own, how, error))

    def _finish(self, handle: Any, how: str, error: int) -> Any:
        getattr(handle, how)()
        return topics.NAVIGATE_TO_POSE.type.Result(error_code=error)
