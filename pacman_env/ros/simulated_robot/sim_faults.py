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
_USAGE = f"must be {', '.join(_USAGES)}, end or end NAME"


class Faults:
    def __init__(self) -> None:
        self.now: dict[str, tuple[float, ...]] = {}  # current faults by name, with their numbers

    def __contains__(self, name: str) -> bool:
        return name in self.now

    def number(self, name: str) -> float | None:
        return self.now[name][0] if name in self.now else None

    def apply(self, text: str) -> str:
        """Begin a fault (``NAME NUMBERS``), end a fault (``end NAME``), or end all (``end``); case does not matter.

        Returns the name of the fault that begins, else "". For an unknown fault or wrong numbers, raises ValueError and
        changes nothing.
        """
        words = text.lower().split()
        if not words:
            raise ValueError(f"fault {text!r}: {_USAGE}")
        if words == ["end"]:
            self.now.clear()
            return ""
        ends = len(words) == 2 and words[0] == "end"
        name = words[ends]
        if name not in FAULTS:
            raise ValueError(f"fault {name!r}: unknown, {_USAGE}")
        if ends:
            self.now.pop(name, None)
            return ""
        self.now[name] = _numbers(name, words[1:])
        return name

    def words(self) -> list[str]:
        return [" ".join([name, *(f"{value:g}" for value in values)]) for name, values in sorted(self.now.items())]


def _numbers(name: str, words: list[str]) -> tuple[float, ...]:
    fields = FAULTS[name]
    if len(words) != len(fields):
        raise ValueError(f"fault {name}: needs {' '.join(map(str.upper, fields)) or 'no number'}, got {words}")
    values = []
    for what, word in zip(fields, words, strict=True):
        try:
            value = float(word)
        except ValueError:
            raise ValueError(f"fault {name}: {what} {word!r} is no number") from None
        if not abs(value) <= _LIMITS[what]:  # also refuses NaN
            raise ValueError(f"fault {name}: {what} {word} must be within {_LIMITS[what]:g}")
        if value < 0 and what == "seconds" and name != "clock_jump":
            raise ValueError(f"fault {name}: {what} {word} must not be negative")
        values.append(value)
    return tuple(values)
