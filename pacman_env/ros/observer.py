"""Node that only observes a game, in a ROS context of its own."""

import time
from collections.abc import Callable
from typing import Any

import rclpy
from rclpy.executors import Executor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from .discovery import avoid_shared_memory
from .game_nodes import QUIET
from .process import event_executor


def own_context(domain: int | None) -> rclpy.Context:
    """Return a new ROS context without signal handlers; ``domain`` None: the domain of the environment."""
    context, no_signals = rclpy.Context(), SignalHandlerOptions.NO
    rclpy.init(args=["--ros-args", *QUIET], context=context, domain_id=domain, signal_handler_options=no_signals)
    return context


class ObserverNode(Node):
    """Node that observes a game while ``spin`` runs; it has its own ROS context, which ``close`` shuts down."""

    make_executor: Callable[[rclpy.Context], Executor] = staticmethod(event_executor)

    def __init__(self, name: str, namespace: str, domain: int | None = None, **options: Any) -> None:
        avoid_shared_memory()
        context = own_context(domain)
        super().__init__(name, namespace=namespace, context=context, **options)
        self._executor = self.make_executor(context)
        self._executor.add_node(self)

    def __enter__(self) -> Any:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    def close(self) -> None:
        self._executor.shutdown()
        self.destroy_node()
        rclpy.shutdown(context=self.context)

    def spin(self, timeout_s: float) -> None:
        self._executor.spin_once(timeout_sec=timeout_s)

    def spin_until(self, condition: Callable[[], object], timeout_s: float) -> bool:
        """Spin until the condition is true, at most ``timeout_s``; return True if it became true."""
        end = time.monotonic() + timeout_s
        while not (holds := bool(condition())) and time.monotonic() < end:
            self.spin(0.05)
        return holds
