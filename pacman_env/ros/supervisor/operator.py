"""Operator commands for a running game from another terminal: status, start, reset, stop, release."""

import json
import math
import os
import sys
import time
from collections.abc import Callable
from functools import partial
from typing import Any

from pacman_env import __version__
from pacman_env.ros import topics
from pacman_env.ros.discovery import join, publishers
from pacman_env.ros.game_monitor import MONITORED
from pacman_env.ros.game_nodes import GAME, OURS, SELECTOR, SHADOW, needed_nodes
from pacman_env.ros.supervisor.status_line import ANSWER_S, STOPPED, VALUES, StatusLine
from pacman_env.ros.supervisor.terminal import wrapped

DONE, REFUSED, NO_ANSWER = 0, 1, 3  # exit statuses; 2 means bad arguments
INCOMPLETE = 1  # exit status of ``status``: a node or value is absent or pending
QUIET_S = 3.0  # the wait of ``status`` ends after this time without a discovery or message
SETTLE_S = 0.5  # after the first message, time for latched messages to arrive
OBEY_S = 2.0  # time for all nodes to obey
DRIVERS = (GAME, SELECTOR)  # nodes that send goals to Nav2


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
    """List the nodes that send goals and have not obeyed the stop; outside the menu even an undiscovered game."""
    names = status_line.discovered | (set() if status_line.state == "menu" else {GAME})
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
    missing = wait_for_all(status_line, end_s)
    print((status_json if as_json else status_rows)(status_line, missing))
    return INCOMPLETE if _names_of(missing) or status_line.silence else DONE


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


#: By fact: the topic from which it is read.
_SOURCES: dict[str, topics.Topic] = {
    **{name: MONITORED[name].topic for name in VALUES},
    "goal_selector": topics.DIAGNOSTICS,
    "stopped": topics.OPERATOR_STOP,
}

#: Names of missing parts by kind (``nodes``, ``values``), of which the source is not discovered (``absent``) or has
#: not published so far (``pending``).
Missing = dict[str, dict[str, list[str]]]


def wait_for_all(status_line: StatusLine, end_s: float) -> Missing:
    """Wait for all nodes and values of a game, and return the missing ones.

    The wait ends at ``end_s`` (monotonic, s), or if nothing new arrives for ``QUIET_S``. If nothing is missing, it
    continues until it is known whether the goal selector still reports, and which processes ``ros up`` has started.
    """
    previous: Any = None
    quiet_s = 0.0
    while True:
        missing, now_s = _missing(status_line), time.monotonic()
        if missing != previous:
            previous, quiet_s = missing, now_s + QUIET_S
        known = status_line.game.started or not publishers(status_line, [topics.PROCESSES.name])
        if (not _names_of(missing) and status_line.silence is not None and known) or now_s >= min(quiet_s, end_s):
            return missing
        status_line.spin(0.05)


def _names_of(missing: Missing, *states: str) -> list[str]:
    """List the missing nodes and values, of all states or of ``states``."""
    return [name for state in states or missing for names in missing[state].values() for name in names]


def _missing(status_line: StatusLine) -> Missing:
    originals, facts = status_line.originals, status_line.facts()
    nodes = needed_nodes(status_line.sim, originals, status_line.game.condition.get("selector", OURS))
    silent = [name for name in nodes if name not in originals and name not in status_line.game.nodes]
    unknown = [name for name, topic in _SOURCES.items() if facts[name] is None]
    published = {name for name in unknown if publishers(status_line, [_SOURCES[name].name])}
    missing: Missing = {"absent": {}, "pending": {}}
    for kind, names, discovered in (("nodes", silent, status_line.discovered), ("values", unknown, published)):
        missing["absent"][kind] = [name for name in names if name not in discovered]
        missing["pending"][kind] = [name for name in names if name in discovered]
    return missing


def status_json(status_line: StatusLine, missing: Missing) -> str:
    return json.dumps({"version": __version__, **status_line.facts(), **missing}, indent=2)


def status_rows(status_line: StatusLine, missing: Missing) -> str:
    facts = status_line.facts()
    age_s, speed, caught = facts["pose_age_s"], facts["clyde_speed_mps"], facts.get("ghosts_caught")
    pellets = ("-" if facts[name] is None else facts[name] for name in ("pellets_collected", "pellets_spawned"))
    rows = {
        **{name: facts[name] for name in ("state", "round", "score")},
        "pellets": "{} of {}".format(*pellets),
        "ghosts": None if caught is None else f"{caught} caught",
        "result": facts["result"],
        "Clyde": None if speed is None else f"{speed:.2f} m/s",
        "pose": "none" if age_s is None else f"{_place(status_line.game.condition)}{age_s:.1f} s ago",
        "policy": facts["policy"],
        "selector": _selector(status_line.game.condition, facts["nodes"]),
        "nodes": ", ".join([*facts["nodes"], *(f"{name} (original)" for name in sorted(status_line.originals))]),
        "stopped": "until 'pacman-env ros release'" if facts["stopped"] else None,
        "troubles": "; ".join(text for kind, text in status_line.troubles.items() if kind != STOPPED),
        "invalid": "; ".join(f"{name}: {what}" for name, what in facts["invalid"].items()),
        **{state: ", ".join(_names_of(missing, state)) for state in missing},
    }
    lines = (f"{name:<9} {value}" for name, value in rows.items() if value not in (None, ""))
    return "\n".join(wrapped(line, 10) for line in lines)


def _selector(condition: Any, nodes: list[str]) -> str:
    """Describe who sends goals if it is not our goal selector, and who sends none."""
    others = condition.get("selector", OURS)
    words = [] if others == OURS else [f"{others}: goals are not sent from here"]
    if SHADOW in nodes or condition.get("shadow"):
        words.append("a shadow decides and logs, but drives nothing")
    return "; ".join(words)


def _place(condition: Any) -> str:
    """Return the goal selector's believed pose as text, if it reports one."""
    pose = condition.get("pose", ())
    if pose is None:
        return "unknown; "
    if not (isinstance(pose, list) and len(pose) == 3 and all(isinstance(value, float | int) for value in pose)):
        return ""
    return f"({pose[0]:.2f}, {pose[1]:.2f}) m, {math.degrees(pose[2]):.0f} degrees; "
