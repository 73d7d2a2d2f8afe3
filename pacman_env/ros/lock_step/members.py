"""The nodes of a lock-step game, each with its waiting messages and tasks."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from rclpy.context import Context
from rclpy.executors import Executor
from rclpy.task import Task

from ..node import BaseNode


class NodeExecutor(Executor):
    """Executor of one node that never waits: it collects tasks and reports created or destroyed entities."""

    def __init__(self, context: Context, changed: Callable[[], None]) -> None:
        super().__init__(context=context)
        self.tasks: list[Task] = []
        self._changed = changed

    def create_task(self, callback: Any, *arguments: Any, **options: Any) -> Task:
        """Create a task like any executor; it runs after the current callback."""
        task = Task(callback, arguments, options, executor=self)
        self.tasks.append(task)
        return task

    def wake(self) -> None:
        self._changed()

    def run_tasks(self) -> None:
        """Run all tasks that can run, and the tasks that these create; raises the exceptions of tasks."""
        progress = bool(self.tasks)
        while progress:
            tasks, self.tasks = self.tasks, []
            progress = False
            for task in tasks:
                task()
                if not task.done():
                    self.tasks.append(task)
                    continue
                progress = True
                if (error := task.exception()) is not None:
                    raise error
            progress = progress and bool(self.tasks)


@dataclass
class Delivery:
    member: Member
    entity: Any  # subscription, service, client, action server or action client
    name: str  # name of topic or service
    content: Any
    handle: Callable[[], object]  # calls the node's callback with the content
    sender: Member | None  # None: another process


@dataclass(eq=False)
class Member:
    name: str
    number: int  # 1 for the first node that was started
    node: BaseNode
    executor: NodeExecutor
    ending: bool = False  # True from the start of its last messages on
    present: bool = True  # False once it was killed or has ended
