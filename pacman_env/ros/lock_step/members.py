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
    """One node's executor: keeps its tasks, and notes that entities have come or gone. It waits for nothing.

    Args:
        context: of rclpy.
        changed: called when the node has made or destroyed an entity.
    """

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
        """Entities have come or gone."""
        self._changed()

    def run_tasks(self) -> None:
        """Run what can be run now, and what follows from it.

        Raises:
            Exception: what a task has raised.
        """
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
    """A message, request or answer for one entity of a member.

    Attributes:
        member: whose entity it is.
        entity: the subscription, service, client or action's end.
        name: of topic or service.
        content: what was taken.
        handle: does what the node does with it.
        sender: the member that sent it; None: it came from outside.
        depth: so many wait for the entity at most, the newest.
        reliable: a network that loses it delivers it later.
        latched: it is delivered later even after a long loss.
    """

    member: Member
    entity: Any
    name: str
    content: Any
    handle: Callable[[], object]
    sender: Member | None
    depth: int = 1000
    reliable: bool = True
    latched: bool = False


@dataclass(eq=False)
class Member:
    """A node of the game.

    Attributes:
        name: of the node.
        number: in the order of all starts.
        make: makes the node, to start it again.
        arguments: of the node.
        loses: losses concern what it sends and gets, too.
        ending: it says its last messages, or is gone.
        present: False once it was killed or has ended.
        frozen_s: since when it does not run, game's wall s; None: it runs.
        inbox: what came while it was frozen.
    """

    name: str
    number: int
    make: Callable[[], BaseNode]
    arguments: list[str]
    node: BaseNode
    executor: NodeExecutor
    loses: bool = True
    ending: bool = False
    present: bool = True
    frozen_s: float | None = None
    inbox: list[Delivery] = field(default_factory=list)

    def keep(self, delivery: Delivery) -> None:
        """Of a frozen member: keep the delivery, with as many for the same entity as that keeps."""
        self.inbox.append(delivery)
        same = [one for one in self.inbox if one.entity is delivery.entity]
        if len(same) > delivery.depth:
            self.inbox.remove(same[0])
