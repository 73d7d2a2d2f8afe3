"""Step the nodes of one process: each message is handled before the next, and all before time advances."""

import contextlib
from collections.abc import Callable
from functools import partial
from typing import Any

import rclpy
from rclpy.context import Context
from rclpy.signals import SignalHandlerOptions

from ..discovery import undiscovered
from ..game_nodes import QUIET
from ..node import LAST_MESSAGES_S, BaseNode
from ..rclpy_private import require_known_version
from ..surroundings import within
from .deliveries import Deliveries
from .entities import call
from .members import Member, NodeExecutor
from .surroundings import LockStepSurroundings, SimulatedWall

STEP_NS = 50_000_000  # one period of Nav2's controller
SILENCE_S = 60.0  # real time, the longest duration of a callback


class LockStep:
    """Run nodes in this process and step their simulated time.

    ``seed`` decides all random numbers of the nodes. ``domain`` is the ROS domain; None: the domain
    in the environment. The process ends if a callback takes ``silence_s`` of real time. If ``alone``,
    the nodes discover no other process.
    """

    def __init__(
        self, seed: int = 0, domain: int | None = None, silence_s: float = SILENCE_S, alone: bool = True
    ) -> None:
        require_known_version()
        self.context = Context()
        arguments, signals = ["--ros-args", *QUIET], SignalHandlerOptions.NO
        with undiscovered() if alone else contextlib.nullcontext():
            rclpy.init(args=arguments, context=self.context, domain_id=domain, signal_handler_options=signals)
        self.wall = SimulatedWall(seed)
        self.members: list[Member] = []
        self.messages = Deliveries(self.members, silence_s, self._end)
        self.step_ns = STEP_NS  # step of the simulated robot, if there is one
        self._alone = alone
        self._started = 0
        self._closed = False

    def add(self, make: Callable[[], BaseNode], arguments: list[str]) -> Member:
        """Create a node with ROS arguments ``--ros-args ...``; latched messages reach it before this returns.

        Raises NodeFailed, and the exceptions of ``make``.
        """
        self._started += 1
        surroundings = LockStepSurroundings(self, self._started, arguments, self._alone)
        with within(surroundings), self.messages.making(f"the creation of node {self._started}"):
            node = make()
            for service in node.services:  # rclpy creates the lifecycle services unwatched
                self.messages.watch(service)
        executor = NodeExecutor(self.context, self.messages.entities_changed)
        member = Member(node.get_name(), self._started, node, executor)
        node.executor = executor
        self.step_ns = getattr(node, "step_ns", self.step_ns)
        self.members.append(member)
        self.messages.entities_changed()
        self.messages.join(member, set())
        return member

    def subscribe(self, node: BaseNode, subscribe: Callable[[], Any]) -> Any:
        """Let a member subscribe between two steps; latched messages arrive before this returns."""
        earlier = set(node.subscriptions)
        subscriptions = subscribe()
        self.messages.join(self._member_of(node), earlier)
        return subscriptions

    def member(self, name: str) -> Member | None:
        return next((one for one in self.members if one.name == name and one.present), None)

    def _member_of(self, node: BaseNode) -> Member:
        return next(one for one in self.members if one.node is node)

    def remove(self, member: Member, last_messages: bool = True) -> None:
        """End a node as a signal would, or as a kill would if ``last_messages`` is False.

        Messages that wait for the node are lost.
        """
        if member.ending:
            return
        member.ending = True
        if last_messages and not member.node.silent:
            answers = self.messages.run(member, lambda: list(member.node.last_messages()))
            end_s = self.wall.now_s + LAST_MESSAGES_S
            self.messages.drain()
            while not all(one.done() for one in answers) and self.wall.now_s < end_s and not self._closed:
                self.step()
            member.node.once.summary()
        member.present = False
        self.members.remove(member)
        self.messages.discard(member)
        member.executor.shutdown()
        member.node.destroy_node()
        self.messages.entities_changed()

    def _end(self, member: Member) -> None:
        self.remove(member)
        self.ended(member)

    def ended(self, member: Member) -> None:
        """Handle the end of a node that ended by itself; subclasses may restart it."""

    def close(self) -> None:
        """End the remaining nodes without last messages, then ROS."""
        if self._closed:
            return
        self._closed = True
        self.messages.watchdog.close()
        for member in self.members[::-1]:
            self.remove(member, last_messages=False)
        self.context.try_shutdown()

    def step(self) -> None:
        """Advance time by one step of the simulated robot and handle everything; raises NodeFailed."""
        self.wall.advance(self.step_ns)
        self.messages.drain()
        robot = next((one for one in self.members if hasattr(one.node, "step")), None)
        if robot is not None and robot.present:
            self.messages.run(robot, robot.node.step)
            self.messages.expire_goals()
            self.messages.drain()
        for member in self.members[:]:
            if member.present:
                self._fire_timers(member)

    def _fire_timers(self, member: Member) -> None:
        for timer in self.messages.index.timers[member]:
            with timer.handle:
                due = timer.handle.is_timer_ready()
                if due:
                    timer.handle.call_timer()
            if due and member.present:
                self.messages.run(member, partial(call, member, timer.callback))
                self.messages.drain()

    def until(self, condition: Callable[[], object], limit_s: float) -> bool:
        """Step until the condition is true, at most ``limit_s`` of simulated time; return True if it became true."""
        end_s = self.wall.now_s + limit_s
        while not condition():
            if self.wall.now_s >= end_s:
                return False
            self.step()
        return True

    def within(self, node: BaseNode, do: Callable[[], Any]) -> Any:
        result = self.messages.run(self._member_of(node), do)
        self.messages.drain()
        return result

    def advance(self, seconds: float) -> None:
        self.until(lambda: False, seconds - 1e-6)
