"""Parse faults of the simulated robot: ``abort 2.0`` begins a fault, ``end abort`` ends it, ``end`` ends all faults."""

import math

#: By fault: the names of its numbers.
FAULTS: dict[str, tuple[str, ...]] = {
    "reject": (),  # all goals are rejected
    "abort": ("seconds",),  # all goals are aborted this time after their acceptance
    "nav2_away": (),  # the navigator's servers are gone
    "late_acceptance": ("seconds",),  # goals are accepted with this delay
    "pose_lost": (),  # no amcl_pose, no transform from map to odom
    "pose_jump": ("x", "y", "heading"),  # m, m, rad: AMCL converges this far from the true pose
    "kidnap": ("x", "y", "heading"),  # m, m, rad in the map: moved there; odometry and AMCL do not notice until the end
    "wheels_slip": ("seconds",),  # the wheels turn, but the robot stands this long; AMCL does not notice until then
    "base_silent": (),  # only the lidar publishes, as after a stop of a TurtleBot 4's create3_republisher
    "clock_jump": ("seconds",),  # /clock and all stamps are ahead by this time (negative: behind)
}
#: Faults of the simulated Nav2, and of the simulated AMCL.
OF_NAVIGATION = frozenset({"reject", "abort", "nav2_away", "late_acceptance"})
OF_LOCALIZATION = frozenset({"pose_lost", "pose_jump"})
_LIMITS = {"seconds": 3600.0, "x": 1000.0, "y": 1000.0, "heading": math.pi}
_USAGES = [" ".join([name, *map(str.upper, numbers)]) for name, numbers in FAULTS.items()]

Faults = dict[str, tuple[float, ...]]  # current faults by name, with their numbers


def fault_of(text: str) -> tuple[str, tuple[float, ...] | None]:
    """Parse a fault that begins (``NAME NUMBERS``) or ends (``end NAME``, or ``end`` for all); case does not matter.

    Returns its name ("" for all) and its numbers (None if it ends). Raises ValueError for an unknown fault or wrong
    numbers.
    """
    words = text.lower().split()
    if words == ["end"]:
        return "", None
    ends = len(words) == 2 and words[0] == "end"
    name = words[ends] if words else ""
    if name not in FAULTS:
        raise ValueError(f"unknown, must be {', '.join(_USAGES)}, end or end NAME")
    if ends:
        return name, None
    fields, values = FAULTS[name], words[1:]
    if len(values) != len(fields):
        raise ValueError(f"needs {' '.join(map(str.upper, fields)) or 'no number'}")
    return name, tuple(_number(name, field, value) for field, value in zip(fields, values, strict=True))


def _number(fault: str, field: str, text: str) -> float:
    most = _LIMITS[field]
    least = 0.0 if field == "seconds" and fault != "clock_jump" else -most
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not least <= value <= most:  # also refuses NaN
        raise ValueError(f"{field} {text} must be a number within {least:g} and {most:g}")
    return value


def fault_words(faults: Faults) -> list[str]:
    return [" ".join([name, *(f"{value:g}" for value in values)]) for name, values in sorted(faults.items())]
