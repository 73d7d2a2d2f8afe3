"""``pacman-env ros status``: the state of a game, and which parts are absent or not received yet."""

import json
import math
import time
from dataclasses import dataclass, field
from typing import Any

from pacman_env import __version__
from pacman_env.ros import topics
from pacman_env.ros.discovery import publishers
from pacman_env.ros.game_monitor import MONITORED
from pacman_env.ros.game_nodes import GAME, ORIGINAL_SELECTOR, SELECTOR, SIMULATOR
from pacman_env.ros.supervisor.status_line import STOPPED, VALUES, StatusLine
from pacman_env.ros.supervisor.terminal import wrapped

#: Exit statuses: everything was received; a node or value is absent or pending. Without a game it is 3.
ALL_THERE, INCOMPLETE = 0, 1
QUIET_S = 3.0  # the wait ends after this time without a discovery or message
#: By fact: the topic from which it is read.
_SOURCES: dict[str, topics.Topic] = {
    **{name: MONITORED[name].topic for name in VALUES},
    "policy": topics.DIAGNOSTICS,
    "goal_selector": topics.DIAGNOSTICS,
    "pose_age_s": topics.AMCL_POSE,
    "stopped": topics.OPERATOR_STOP,
}


@dataclass(frozen=True)
class Missing:
    """Missing nodes and facts: their source is not discovered (absent), or has not published so far (pending)."""

    absent: dict[str, list[str]] = field(default_factory=dict)  # by kind (``nodes``, ``values``): names
    pending: dict[str, list[str]] = field(default_factory=dict)

    def __bool__(self) -> bool:
        return any([*self.absent.values(), *self.pending.values()])


def wait_for_all(status_line: StatusLine, end_s: float) -> Missing:
    """Wait for all nodes and values of a game, and return the missing ones.

    The wait ends at ``end_s`` (monotonic, s), or if nothing new arrives for ``QUIET_S``. If nothing is missing, it
    continues until it is known whether the goal selector still reports.
    """
    previous: Any = None
    quiet_s = 0.0
    while True:
        missing = _missing(status_line)
        now_s = time.monotonic()
        if missing != previous:
            previous, quiet_s = missing, now_s + QUIET_S
        if (not missing and status_line.unresponsive is not None) or now_s >= min(quiet_s, end_s):
            return missing
        status_line.spin(0.05)


def _missing(status_line: StatusLine) -> Missing:
    discovered = status_line.discovered
    planner = ORIGINAL_SELECTOR if ORIGINAL_SELECTOR in discovered else SELECTOR
    nodes = [*((SIMULATOR,) if status_line.sim else ()), *GAME, planner]
    silent = [name for name in nodes if name not in status_line.game.nodes and name != ORIGINAL_SELECTOR]
    facts = status_line.facts()
    unknown = [name for name in _SOURCES if facts[name] is None]
    published = {name for name in unknown if publishers(status_line, [_SOURCES[name].name])}
    return Missing(
        {
            "nodes": [one for one in silent if one not in discovered],
            "values": [one for one in unknown if one not in published],
        },
        {"nodes": [one for one in silent if one in discovered], "values": [one for one in unknown if one in published]},
    )


def as_json(status_line: StatusLine, missing: Missing) -> str:
    parts = {"version": __version__, **status_line.facts(), "absent": missing.absent, "pending": missing.pending}
    return json.dumps(parts, indent=2)


def as_rows(status_line: StatusLine, missing: Missing) -> str:
    facts = status_line.facts()
    age_s, speed = facts["pose_age_s"], facts["clyde_speed_mps"]
    pellets = ("-" if facts[name] is None else facts[name] for name in ("pellets_collected", "pellets_spawned"))
    caught = facts.get("ghosts_caught")
    rows = {
        **{name: facts[name] for name in ("state", "round", "score")},
        "pellets": "{} of {}".format(*pellets),
        "ghosts": None if caught is None else f"{caught} caught",
        "result": facts["result"],
        "Clyde": None if speed is None else f"{speed:.2f} m/s",
        "pose": "none yet" if age_s is None else f"{_place(facts['goal_selector'])}AMCL's last {age_s:.1f} s ago",
        "policy": facts["policy"],
        "nodes": ", ".join(facts["nodes"]),
        "stopped": "until 'pacman-env ros release'" if facts["stopped"] else None,
        "troubles": "; ".join(text for kind, text in status_line.troubles.items() if kind != STOPPED),
        "invalid": "; ".join(f"{name}: {what}" for name, what in facts["invalid"].items()),
        "absent": ", ".join(name for names in missing.absent.values() for name in names),
        "pending": ", ".join(name for names in missing.pending.values() for name in names),
    }
    lines = (f"{name:<9} {value}" for name, value in rows.items() if value not in (None, ""))
    return "\n".join(wrapped(line, 10) for line in lines)


def _place(condition: Any) -> str:
    """Return the goal selector's believed pose as text, if it reports one."""
    pose = (condition or {}).get("pose", ())
    if pose is None:
        return "unknown; "
    if not (isinstance(pose, list) and len(pose) == 3 and all(isinstance(value, float | int) for value in pose)):
        return ""
    return f"({pose[0]:.2f}, {pose[1]:.2f}) m, {math.degrees(pose[2]):.0f} degrees; "
