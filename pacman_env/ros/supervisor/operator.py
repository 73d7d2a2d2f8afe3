"""What an operator asks of a game that is up, from a terminal of its own: start, reset, stop, how it stands."""

from __future__ import annotations

import json
import os
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from pacman_env import __version__
from pacman_env.ros.discovery import join
from pacman_env.ros.supervisor.status_line import StatusLine
from pacman_env.ros.topics import OPERATOR_STOP, RESET_GAME, START_GAME

DONE, REFUSED, NO_ANSWER = 0, 1, 3  # exit statuses, beside 2 for bad arguments
SERVICES = {"start": START_GAME, "reset": RESET_GAME}
ANSWER_S = 2.0  # then it is asked again: an answer may be lost
SETTLE_S = 0.5  # in which what is latched comes in, once anything has


@contextmanager
def listening(namespace: str, domain: int | None, sim: bool) -> Iterator[StatusLine]:
    """A participant in the robot's namespace, for as long as the block lasts.

    Raises:
        ValueError: a namespace or ROS_DOMAIN_ID that there is not.
    """
    join(domain, sim)
    status_line = StatusLine(namespace, sim)
    try:
        yield status_line
    finally:
        status_line.close()


def ask(what: str, namespace: str, domain: int | None, sim: bool, wait_s: float) -> int:
    """Start or reset the game, and print the referee's answer.

    Args:
        what: ``start`` or ``reset``.
        namespace: of the robot.
        domain: ROS_DOMAIN_ID; None: that of the environment.
        sim: a simulated game, on this machine alone.
        wait_s: for an answer.

    Returns:
        The exit status: 0 done, 1 refused, 3 there is no referee.

    Raises:
        ValueError: a namespace or domain that there is not.
    """
    with listening(namespace, domain, sim) as status_line:
        service, end = SERVICES[what], time.monotonic() + wait_s
        answer: Any = None
        while time.monotonic() < end:
            asked_s = time.monotonic()
            answer = status_line.call(service)
            if answer is None:
                status_line.spin(0.05)
            elif status_line.spin_until(answer.done, min(ANSWER_S, end - asked_s)):
                break
        if answer is None or not answer.done():
            return _no_answer(status_line, service.name)
        result = answer.result()
        print(result.message)
        return DONE if result.success else REFUSED


def stop(namespace: str, domain: int | None, sim: bool, wait_s: float) -> int:
    """Stop the robot until it is released, and print which nodes obey; arguments and errors are those of :func:`ask`.

    Returns:
        The exit status: 0, or 3 where no node obeys.
    """
    with listening(namespace, domain, sim) as status_line:
        operator = status_line.operator
        operator.say(True, "a terminal")
        status_line.halt()
        if not status_line.spin_until(lambda: operator.obeyed_by, wait_s):
            return _no_answer(status_line, OPERATOR_STOP.name)
        status_line.spin_until(lambda: False, SETTLE_S)
        print(f"stopped: {', '.join(operator.obeyed_by)} obey until 'pacman-env ros release'")
    return DONE


def release(namespace: str, domain: int | None, sim: bool, wait_s: float) -> int:
    """Let the robot go on after a stop; arguments and exit statuses are those of :func:`stop`."""
    with listening(namespace, domain, sim) as status_line:
        operator = status_line.operator
        if not status_line.spin_until(lambda: operator.known, wait_s):
            return _no_answer(status_line, OPERATOR_STOP.name)
        status_line.spin_until(lambda: False, SETTLE_S)
        if not operator.stopped:
            print("nothing was stopped")
            return DONE
        operator.say(False, "a terminal")
        if not status_line.spin_until(lambda: operator.obeyed_by, wait_s):
            return _no_answer(status_line, OPERATOR_STOP.name)
        status_line.spin_until(lambda: False, SETTLE_S)
        print(f"released: {', '.join(operator.obeyed_by)} know it")
    return DONE


def status(namespace: str, domain: int | None, sim: bool, wait_s: float, as_json: bool = False) -> int:
    """Print how the game stands; with ``as_json`` everything that is known. Arguments and errors are as of :func:`ask`.

    Returns:
        The exit status: 0, or 3 where no game is up.
    """
    with listening(namespace, domain, sim) as status_line:
        if not status_line.spin_until(lambda: status_line.state is not None, wait_s):
            return _no_answer(status_line, "game_state")
        status_line.spin_until(lambda: bool(status_line.condition), min(1.5, wait_s))  # published once a second
        status_line.spin_until(lambda: False, SETTLE_S)
        facts = {"version": __version__, **status_line.facts()}
    if as_json:
        print(json.dumps(facts, indent=2))
        return DONE
    age_s, speed = facts["pose_age_s"], facts["clyde_speed_mps"]
    rows = {
        "state": facts["state"],
        "round": facts["round"],
        "score": facts["score"],
        "pellets": f"{_known(facts['pellets_collected'])} of {_known(facts['pellets_spawned'])}",
        "result": facts["result"],
        "Clyde": None if speed is None else f"{speed:.2f} m/s",
        "pose": "none yet" if age_s is None else f"{age_s:.1f} s ago",
        "policy": facts["policy"],
        "nodes": ", ".join(facts["nodes"]),
        "stopped": "until 'pacman-env ros release'" if facts["stopped"] else None,
        "troubles": "; ".join(facts["goal_selector"].get("troubles", {})),
    }
    print(*(f"{name:<9} {value}" for name, value in rows.items() if value not in (None, "")), sep="\n")
    return DONE


def _known(value: Any) -> str:
    return "-" if value is None else str(value)


def _no_answer(status_line: StatusLine, what: str) -> int:
    where, number = status_line.get_namespace(), os.environ["ROS_DOMAIN_ID"]
    print(
        f"no game in {where}, ROS domain {number}: nobody answers on {what}; is 'pacman-env ros up' running there? "
        "'pacman-env ros doctor' says more",
        file=sys.stderr,
    )
    return NO_ANSWER
