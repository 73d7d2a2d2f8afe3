"""Operator commands for a running game from another terminal: status, start, reset, stop, release."""

import os
import sys
import time
from collections.abc import Callable
from functools import partial
from typing import Any

from pacman_env.ros import topics
from pacman_env.ros.discovery import join
from pacman_env.ros.supervisor import status
from pacman_env.ros.supervisor.status_line import ANSWER_S, StatusLine
from pacman_env.ros.supervisor.terminal import wrapped

DONE, REFUSED, NO_ANSWER = 0, 1, 3  # exit statuses; 2 means bad arguments
SETTLE_S = 0.5  # after the first message, time for latched messages to arrive
OBEY_S = 2.0  # time for all nodes to obey
DRIVERS = ("goal_selector", "game_controller")  # nodes that send goals to Nav2


def operate(command: str, namespace: str, domain: int | None, sim: bool, wait_s: float) -> int:
    join(domain, sim)
    with StatusLine(namespace, sim) as status_line:
        return COMMANDS[command](status_line, wait_s)


def _call(service: topics.Service, status_line: StatusLine, wait_s: float) -> int:
    end = time.monotonic() + wait_s
    answer: Any = None
    while time.monotonic() < end:
        call_s = time.monotonic()
        answer = status_line.call(service)
        if answer is None:
            status_line.spin(0.05)
        elif status_line.spin_until(answer.done, min(ANSWER_S, end - call_s)):
            break
    if answer is None or not answer.done():
        return _no_answer(status_line, service.name)
    result = answer.result()
    print(wrapped(result.message))
    return DONE if result.success else REFUSED


def _stop(status_line: StatusLine, wait_s: float) -> int:
    status_line.operator.request(True, "a terminal")
    status_line.halt()
    status = _print_obeying(status_line, wait_s, "stopped until 'pacman-env ros release'; obeyed by {}")
    if status != DONE:
        return status
    if late := _late(status_line):
        print(wrapped(f"NOT YET obeyed by {', '.join(late)}: watch the robot, it may still drive"))
    return REFUSED if late else DONE


def _late(status_line: StatusLine) -> list[str]:
    """List the nodes that send goals and have not obeyed the stop; outside the menu even undiscovered (frozen) ones."""
    names = status_line.discovered if status_line.state == "menu" else DRIVERS
    return [name for name in DRIVERS if name in names and name not in status_line.operator.obeyed_by]


def _release(status_line: StatusLine, wait_s: float) -> int:
    operator = status_line.operator
    if not status_line.spin_until(lambda: operator.known, wait_s):
        return _no_answer(status_line, topics.OPERATOR_STOP.name)
    status_line.spin_until(lambda: False, SETTLE_S)
    if not operator.stopped:
        print("nothing was stopped")
        return DONE
    operator.request(False, "a terminal")
    return _print_obeying(status_line, wait_s, "released; received by {}")


def _status(status_line: StatusLine, wait_s: float, as_json: bool = False) -> int:
    end_s = time.monotonic() + wait_s
    if not status_line.spin_until(lambda: status_line.state or "state" in status_line.game.invalid, wait_s):
        return _no_answer(status_line, topics.GAME_STATE.name)
    missing = status.wait_for_all(status_line, end_s)
    print((status.as_json if as_json else status.as_rows)(status_line, missing))
    return status.INCOMPLETE if missing or status_line.unresponsive else status.ALL_THERE


COMMANDS: dict[str, Callable[[StatusLine, float], int]] = {
    "start": partial(_call, topics.START_GAME),
    "reset": partial(_call, topics.RESET_GAME),
    "continue": partial(_call, topics.CONTINUE),
    "stop": _stop,
    "release": _release,
    "status": _status,
    "status --json": partial(_status, as_json=True),
}


def _print_obeying(status_line: StatusLine, wait_s: float, text: str) -> int:
    """Print which nodes have obeyed; return DONE, or NO_ANSWER if none has."""
    operator = status_line.operator
    if not status_line.spin_until(lambda: operator.obeyed_by, wait_s):
        return _no_answer(status_line, topics.OPERATOR_STOP.name)
    status_line.spin_until(lambda: False, SETTLE_S)
    status_line.spin_until(lambda: operator.obeyed_by_all and not (operator.stopped and _late(status_line)), OBEY_S)
    print(wrapped(text.format(", ".join(operator.obeyed_by))))
    return DONE


def _no_answer(status_line: StatusLine, what: str) -> int:
    place, number = status_line.get_namespace(), os.environ["ROS_DOMAIN_ID"]
    text = f"no game in {place}, ROS domain {number}: no answer on {what}; is 'pacman-env ros up' running there? "
    text += f"for details run 'pacman-env ros doctor{' --sim' if status_line.sim else ''}'"
    print(wrapped(text) if sys.stderr.isatty() else text, file=sys.stderr)
    return NO_ANSWER
