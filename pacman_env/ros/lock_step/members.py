"""The nodes of a lock-step game, each with what waits for it: messages, tasks, and what a fault holds back."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from rclpy.context import Context
from rclpy.executors import Executor
from rclpy.task import Task

from ..node import BaseNode


class NodeExecutor(Executor):
    """One node's executor, which never waits: it keeps tasks, and reports that entities were made or destroyed."""

    def __init__(self, context: Context, changed: Callable[[], None]) -> None:
        super().__init__(context=context)
        self.tasks: list[Task] = []
        self._changed = changed

    def create_task(self, callback: Any, *arguments: Any, **options: Any) -> Task:
        """As of any executor; the task runs after the callback that makes it."""
        task = Task(callback, arguments, options, executor=self)
        self.tasks.append(task)
        return task

    def wake(self) -> None:
        self._changed()

    def run_tasks(self) -> None:
        """Run what can be run now, and what follows from it; raises what a task has raised."""
        moved = bool(self.tasks)
        while moved:
            waiting, self.tasks = self.tasks, []
            moved = False
            for task in waiting:
                task()
                if not task.done():
                    self.tasks.append(task)
                    continue
                moved = True
                if (error := task.exception()) is not None:
                    raise error
            moved = moved and bool(self.tasks)


@dataclass
class Delivery:
    member: Member
    entity: Any  # subscription, service, client or action's end
    name: str  # of topic or service
    content: Any
    handle: Callable[[], object]  # what the node does with it
    sender: Member | None  # None if it came from outside
    depth: int = 1000  # so many wait for the entity at most, the newest
    reliable: bool = True  # a network that loses it delivers it later
    latched: bool = False  # and even after a long loss


@dataclass(eq=False)
class Member:
    name: str
    number: int  # in the order of all starts
    node: BaseNode
    executor: NodeExecutor
    loses: bool = True  # losses concern what it sends and receives, too
    ending: bool = False  # it sends its last messages, or is gone
    present: bool = True  # False once it was killed or has ended
    frozen_s: float | None = None  # since when it stands still, s of the game's wall clock; None if it runs
    inbox: list[Delivery] = field(default_factory=list)  # what came while it was frozen

    def keep(self, delivery: Delivery) -> None:
        """Of a frozen member: keep the delivery, with as many for the same entity as that keeps."""
        self.inbox.append(delivery)
        same = [one for one in self.inbox if one.entity is delivery.entity]
        if len(same) > delivery.depth:
            self.inbox.remove(same[0])
