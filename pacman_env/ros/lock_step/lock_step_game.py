"""A whole game with the simulated robot in lock-step: the nodes of ``ros up --sim`` in one process."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

from .. import game_nodes
from ..game_nodes import SELECTOR, SIMULATOR, WAIT, GameSetup
from ..node import BAD_START, BaseNode
from ..node_classes import node_class
from ..nodes.wait_for_amcl_pose import FOUND
from ..topics import Service
from .deliveries import NodeFailed
from .members import Member
from .stepper import LockStep

RESTART_S = 3.0  # simulated time from the end of a node to its restart
LOCALIZED_S = 60.0  # simulated time until the robot's first pose
SEEDED = (SIMULATOR, "clyde_ghost_node")


class LockStepGame(LockStep):
    """Nodes of a game; after construction the robot has its pose and all nodes run.

    ``seed`` decides all random values, ``options`` are as in ``LockStep``. Raises ValueError for an unplayable
    setup, NodeFailed if a node does not start or the robot is not localized.
    """

    def __init__(self, setup: GameSetup, seed: int = 0, **options: Any) -> None:
        if not setup.sim:
            raise ValueError("lock-step: only with a simulated robot")
        extra = {name: {"seed": seed, **setup.extra.get(name, {})} for name in SEEDED}
        self.setup = replace(setup, speed=1.0, extra={**setup.extra, **extra})
        super().__init__(seed, **options)
        self.restarts: list[tuple[float, str, int | None]] = []  # time (s), node, exit status (None: killed)
        self._due: dict[str, float] = {}  # by node to restart: the time, s
        self.namespace = game_nodes.full_namespace(setup.namespace)
        try:
            for name in self.setup.first_nodes:
                self.start(name)
            if not self.until(lambda: self.member(WAIT) is None, LOCALIZED_S):
                raise NodeFailed(f"the robot has no pose after {LOCALIZED_S:g} s of simulated time")
            self.start(SELECTOR)
        except BaseException:
            self.close()
            raise

    def start(self, name: str) -> Member:
        return self.add(node_class(name), self.setup.command(name)[1:])

    def join(self, make: Callable[[], BaseNode]) -> Any:
        """Add a node that ``make`` creates to the game's namespace, and return it."""
        arguments = ["--ros-args", "-r", f"__ns:={self.namespace}", "-p", "use_sim_time:=true"]
        return self.add(make, arguments).node

    def call(self, node: BaseNode, service: Service, limit_s: float = 10.0) -> Any:
        """Call a service from a joined node and return its answer; NodeFailed after ``limit_s`` of simulated time."""
        client = service.client(node)
        answer = self.within(node, lambda: client.call_async(service.type.Request()))
        if not self.until(answer.done, limit_s):
            raise NodeFailed(f"{service.name}: no answer within {limit_s:g} s of simulated time")
        node.destroy_client(client)
        return answer.result()

    def kill(self, name: str) -> None:
        """Kill a node without last messages; it restarts as under ``ros up``."""
        if (member := self.member(name)) is not None:
            self.remove(member, last_messages=False)
            self._start_again(name, None)

    def ended(self, member: Member) -> None:
        if member.name == WAIT:
            if member.node.status != FOUND:
                raise NodeFailed("the robot is not localized")
        elif member.name in game_nodes.NODES:
            if member.node.status == BAD_START:
                raise NodeFailed(f"{member.name} does not start")
            self._start_again(member.name, member.node.status)

    def _start_again(self, name: str, status: int | None) -> None:
        self.restarts.append((self.wall.now_s, name, status))
        self._due[name] = self.wall.now_s + RESTART_S

    def step(self) -> None:
        """Advance by one step, and restart nodes whose pause is over."""
        super().step()
        for name in [name for name, due_s in self._due.items() if due_s <= self.wall.now_s]:
            del self._due[name]
            self.start(name)

    def stop(self) -> None:
        """Stop all nodes in the order of ``ros up``, with their last messages, then ROS."""
        self._due.clear()
        order = [*game_nodes.STOP_ORDER, *(member.name for member in reversed(self.members))]
        for name in dict.fromkeys(order):
            if (member := self.member(name)) is not None:
                self.remove(member)
        self.close()
