"""Run nodes as a process: one thread, signals, a stop that delivers the last messages, the end of ROS."""

from __future__ import annotations

import math
import os
import signal
import sys
import time
import warnings
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import rclpy
from rclpy.duration import Duration
from rclpy.exceptions import ParameterException
from rclpy.executors import Executor, SingleThreadedExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import remove_ros_args

from .discovery import avoid_shared_memory, provide_log_folder, simulated, stay_on_this_machine
from .heartbeat import HEART, LONG_S
from .memory import release_memory
from .node import BAD_START, BaseNode

LAST_MESSAGES_S = 2.0  # longest wait for answers and acknowledgements of last messages, together
TEARDOWN_S = 5  # longest end of ROS; many participants that leave together can hang in Fast DDS
POLL_S = 0.2  # longest delay until a signal is noticed
LEASE = "PACMAN_ENV_LEASE_S"  # environment variable
DEFAULT_LEASE_S = 20.0  # Fast DDS's leaseDuration
STOOD_STILL = 75  # exit status: EX_TEMPFAIL of sysexits.h
CRASHED = 1  # exit status of Python after an exception
_CLOCK = getattr(time, "CLOCK_BOOTTIME", time.CLOCK_MONOTONIC)  # CLOCK_BOOTTIME also counts sleep


class StopSignals:
    """Context in which SIGINT and SIGTERM set ``asked``, and raise KeyboardInterrupt if ``breaks_off`` is True."""

    def __init__(self, breaks_off: bool = False) -> None:
        self.asked = False
        self.breaks_off = breaks_off

    def __enter__(self) -> StopSignals:
        self._before = {number: signal.signal(number, self._ask) for number in (signal.SIGINT, signal.SIGTERM)}
        return self

    def __exit__(self, *exception: object) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def _ask(self, number: int, frame: Any) -> None:
        self.asked = True
        if self.breaks_off:
            raise KeyboardInterrupt


def run(
    makes: Callable[[], BaseNode] | Iterable[Callable[[], BaseNode]],
    name: str,
    argv: Sequence[str] | None = None,
    stopped: int = 0,
) -> int:
    """Spin nodes in the main thread until a signal or the end of one of them, then send their last messages.

    Returns ``stopped`` after a signal, 2 if a node cannot be created, otherwise its status (75 after a standstill).
    """
    makes = (makes,) if callable(makes) else makes
    arguments = list(sys.argv[1:] if argv is None else argv)
    nodes: list[BaseNode] = []
    running = False
    # A client that ends before its response is no error, even if warnings are errors.
    warnings.filterwarnings("ignore", "failed to send response", RuntimeWarning)
    with StopSignals(breaks_off=True) as stop:
        try:
            extra = remove_ros_args(arguments)
            if extra:
                raise ValueError(
                    f"unknown arguments {' '.join(extra)}: parameters are given as --ros-args -p NAME:=VALUE"
                )
            if simulated(arguments):
                stay_on_this_machine()
            avoid_shared_memory()
            provide_log_folder()
            longest_s = lease_s()
            # ROS's own signal handlers would end the context before the last messages.
            rclpy.init(args=arguments, signal_handler_options=SignalHandlerOptions.NO)
            for make in makes:
                nodes.append(make())
            running, stop.breaks_off = True, False
            release_memory()
            _spin(nodes, stop, longest_s)
        except KeyboardInterrupt:
            pass  # no node with last messages exists yet
        except (ValueError, OSError, ParameterException, rclpy_implementation.RCLError) as error:
            if running:
                raise
            print(f"{name}: {error}", file=sys.stderr)
            return BAD_START
        finally:
            stop.breaks_off = False
            signal.alarm(TEARDOWN_S)  # kills the process; needs no Python to run
            for node in nodes:
                node.destroy_node()
            rclpy.try_shutdown()
            signal.alarm(0)
            HEART.beat(0)
    return next((node.status for node in nodes if node.status is not None), stopped)


def event_executor(context: Any = None) -> Executor:
    """Return the executor for nodes that spin as long as a game: EventsExecutor if rclpy has it (7.1.3 does not).

    EventsExecutor waits for events. SingleThreadedExecutor needs more processor time, because it collects all entities
    of its nodes before each wait. Entities should live as long as their node: in a stress test EventsExecutor crashed
    when subscriptions were destroyed while nodes appeared and disappeared.
    """
    try:
        from rclpy.experimental.events_executor import EventsExecutor

        return EventsExecutor(context=context)
    except (ImportError, OSError):  # it lets faulthandler write to stderr, which may be no file
        return SingleThreadedExecutor(context=context)


def _spin(nodes: Sequence[BaseNode], stop: StopSignals, longest_s: float) -> None:
    """Spin the nodes until a stop is requested, a node has ended, or the process stood still for over ``longest_s``.

    Then let the nodes publish their last messages, and wait for the delivery.
    """
    executor = event_executor()
    for node in nodes:
        executor.add_node(node)
    last_s = idle_s()
    try:
        while not stop.asked and all(node.status is None for node in nodes):
            HEART.beat()
            executor.spin_once(timeout_sec=POLL_S)
            idle = idle_s()  # read once: a standstill between two readings would count for neither
            stood_s, last_s = idle - last_s, idle
            if stood_s > longest_s and HEART.limit_s != LONG_S:  # otherwise a callback has waited for that long
                nodes[0].get_logger().warning(f"stood still for {stood_s:.1f} s: others may have lost it, so it ends")
                nodes[0].status = STOOD_STILL
    except Exception:
        nodes[0].status = CRASHED  # for its last messages
        raise
    finally:
        HEART.beat(LONG_S)
        end = time.monotonic() + LAST_MESSAGES_S
        for node in nodes:
            for answer in () if node.silent else node.last_messages():
                executor.spin_until_future_complete(answer, max(0.0, end - time.monotonic()))
            node.once.summary()
        for publisher in (publisher for node in nodes for publisher in node.publishers):
            publisher.wait_for_all_acked(Duration(seconds=max(0.0, end - time.monotonic())))
        executor.shutdown()


def lease_s() -> float:
    """Return the time of silence, s, after which other nodes drop a node (the middleware profile's lease).

    A process that stood still for longer, such as on a sleeping laptop, must restart: Fast DDS discovers such a
    participant again, but not always its endpoints (its issues 155, 457).
    """
    text = os.environ.get(LEASE, "")
    try:
        seconds = float(text) if text else DEFAULT_LEASE_S
    except ValueError:
        seconds = math.nan
    if not seconds > 0:
        raise ValueError(f"{LEASE}={text!r}: must be a number of seconds above 0")
    return seconds


def idle_s() -> float:
    """Return a clock, s, that counts the machine's sleep but not the work of this process."""
    return time.clock_gettime(_CLOCK) - time.process_time()
