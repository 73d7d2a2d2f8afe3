"""Combinations of an environment's arguments: which there are, and choices of them that cover what is promised.

What is tested on them stands in test_judges.py and test_promises.py.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from gymnasium.vector import AutoresetMode

from tests.envs.helpers import QUICK

KINDS = ("features", "scan", "grid")
AXES: dict[str, tuple[Any, ...]] = {
    "observation": tuple(kinds for count in (1, 2, 3) for kinds in itertools.combinations(KINDS, count)),
    "action": ("goal", "velocity"),
    "ghosts": (1, ("chase", "arcade"), 4),
    "endless": (False, True),
    "map": ("house", "maze", "generated"),
    "preset": ("robot", "ideal"),
    "execution.rules": ("robust", "as_built"),
    "randomize": (False, True),
}
CROSSED = ("observation", "action", "ghosts", "endless")  # COVERING has every combination of these

#: Ranges around QUICK's values, for every field that can be drawn.
RANGES: dict[str, tuple[float, float]] = {
    "randomize.speed_mps": (0.6, 1.2),
    "randomize.clyde_speed_mps": (0.2, 0.6),
    "randomize.sigma_xy_m": (0.0, 0.1),
    "randomize.sigma_yaw_rad": (0.0, 0.1),
    "randomize.update_distance_m": (0.1, 0.4),
    "randomize.update_angle_rad": (0.1, 0.4),
    "randomize.accept_delay_s": (0.0, 0.5),
    "randomize.abort_rate": (0.0, 0.3),
    "randomize.pickup_radius_m": (0.5, 1.0),
}
#: Few pellets, short rounds, small scans and pictures (36 pixels are the least that SB3's network takes).
SMALL: dict[str, Any] = {
    **QUICK,
    "time_limit_s": 6.0,
    "observation.scan_rays": 16,
    "observation.grid_pixels": 36,
    "observation.grid_pixel_m": 0.2,
}
Combination = Mapping[str, Any]


def arguments(combination: Combination, **changes: Any) -> dict[str, Any]:
    """Arguments of the environment; ``changes`` are settings by their last name, e.g. ``time_limit_s``."""
    chosen = dict(combination)
    settings = {**SMALL, **(RANGES if chosen.pop("randomize") else {}), **changes}
    chosen.pop("autoreset_mode", None)
    settings |= {name: chosen.pop(name) for name in ("endless", "execution.rules")}
    settings |= {"num_levels": 2} if chosen["map"] == "generated" else {}
    return {**chosen, "settings": settings}


def name(combination: Combination) -> str:
    """A test's id."""
    return "-".join(
        key if value is True else "+".join(map(str, value)) if isinstance(value, tuple) else str(value)
        for key, value in combination.items()
        if value is not False
    )


def groups(combination: Combination, strength: int) -> Iterator[tuple[tuple[str, Any], ...]]:
    """Every ``strength`` values of the combination."""
    return itertools.combinations(combination.items(), strength)


def product(axes: Mapping[str, Sequence[Any]]) -> list[dict[str, Any]]:
    """Every combination there is."""
    return [dict(zip(axes, values, strict=True)) for values in itertools.product(*axes.values())]


def covering(axes: Mapping[str, Sequence[Any]], strength: int, crossed: Sequence[str] = ()) -> list[dict[str, Any]]:
    """Combinations in which any ``strength`` values of different axes, and all those of ``crossed``, meet.

    Each next one is that with the most groups of values not met yet.
    """
    everything = [(combination, frozenset(groups(combination, strength))) for combination in product(axes)]
    missing = {group for _, met in everything for group in met}
    begun = product({axis: axes[axis] for axis in crossed}) if crossed else []
    chosen = []
    while begun or missing:
        first = begun.pop() if begun else {}
        eligible = [one for one in everything if first.items() <= one[0].items()]
        best, met = max(eligible, key=lambda one: len(one[1] & missing))
        missing -= met
        chosen.append(best)
    return chosen


#: Any two values meet, the autoreset mode's too.
PAIRWISE = covering({**AXES, "autoreset_mode": tuple(AutoresetMode)}, 2)
#: Every combination of CROSSED, and any three values meet.
COVERING = covering(AXES, 3, CROSSED)
