"""Arguments of environments that the contract and outside checkers are run on."""

import itertools
import random
from collections.abc import Mapping, Sequence
from typing import Any

from tests.envs.helpers import QUICK

KINDS = ("features", "scan", ("scan", "grid"), ("features", "scan", "grid"))
#: How an environment is configured, whatever its interface.
AXES: dict[str, tuple[Any, ...]] = {
    "observation": KINDS,
    "action": ("goal", "velocity"),
    "ghosts": ("one", "two", "four"),
    "endless": (False, True),
    "power": (0, 2),
    "map": ("house", "maze", "generated"),
    "preset": ("robot", "ideal"),
    "execution.rules": ("robust", "as_built"),
    "randomize": (False, True),
}
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
#: Few pellets, short rounds, small scans and pictures (SB3's network takes 36 pixels at least).
SMALL: dict[str, Any] = {
    **QUICK,
    "time_limit_s": 6.0,
    "observation.scan_rays": 16,
    "observation.grid_pixels": 36,
    "observation.grid_pixel_m": 0.2,
}
#: Ghosts of an environment with one agent, and of one with several agents.
GHOSTS: dict[str, tuple[Any, Any]] = {
    "one": (1, ("policy",)),
    "two": (("chase", "arcade"), ("policy", "chase")),
    "four": (4, ("policy", "chase", "arcade", "policy")),
}


def pairwise(axes: Mapping[str, Sequence[Any]]) -> list[dict[str, Any]]:
    """Return rows in which any two values of different axes meet; always the same rows."""
    draws = random.Random(0)
    missing = {
        ((one, a), (other, b)): None  # a dictionary keeps the order
        for one, other in itertools.combinations(axes, 2)
        for a, b in itertools.product(axes[one], axes[other])
    }
    rows = []
    while missing:
        first = dict(next(iter(missing)))
        drawn = [{axis: first.get(axis, draws.choice(values)) for axis, values in axes.items()} for _ in range(60)]
        met = [[pair for pair in itertools.combinations(row.items(), 2) if pair in missing] for row in drawn]
        best = max(range(len(drawn)), key=lambda k: len(met[k]))
        rows.append(drawn[best])
        for pair in met[best]:
            del missing[pair]
    return rows


def arguments(row: Mapping[str, Any], several: bool = False, **changes: Any) -> dict[str, Any]:
    """Return the arguments of an environment with one or several agents; ``changes`` are settings."""
    chosen = {name: row[name] for name in ("observation", "action", "map", "preset")}
    settings = {**SMALL, **({**RANGES, "reward.progress": 0.5} if row["randomize"] else {}), **changes}
    settings |= {name: row[name] for name in ("endless", "execution.rules")}
    settings |= {"power.pellets": row["power"], "power.duration_s": 3.0, "power.shortest_s": 2.0, "power.return_s": 1.0}
    settings |= {"num_levels": 2} if row["map"] == "generated" else {}
    return {**chosen, "ghosts": GHOSTS[row["ghosts"]][several], "settings": settings}


def name(row: Mapping[str, Any]) -> str:
    """Return the id of a row in a test's name."""
    values = (key if value is True or key == "power" else value for key, value in row.items() if value)
    return "-".join("+".join(value) if isinstance(value, tuple) else str(value) for value in values)


PAIRWISE = pairwise(AXES)

#: Settings of a learner of velocities that knows no dictionaries and no masks.
DRIVING: dict[str, Any] = {
    "action_range": "unit",
    "reward.progress": 0.5,
    "observation.normalize": True,
    "observation.mask": "method",
    "observation.numeric_info": True,
    "timeout": "termination",
}
LEARNERS: dict[str, dict[str, Any]] = {
    "flat mask in info": {"flat": True, "map": "loop", "settings": {"observation.mask": "info"}},
    "flat features": {"flat": True, "map": "loop", "observation": "features"},
    "flat row with scan": {"flat": True, "map": "loop", "observation": ("flat", "planner", "scan")},
    "velocities scan": {"action": "velocity", "observation": "scan", "settings": DRIVING},
    "velocities row": {
        "action": "velocity",
        "observation": ("features", "scan", "planner", "flat"),
        "map": "generated",
        "ghosts": ("chase", "arcade"),
        "settings": DRIVING,
    },
}
NORMALIZED = {"observation.normalize": True, "observation.numeric_info": True}
#: The same of learners of several agents.
SEVERAL_LEARNERS: dict[str, dict[str, Any]] = {
    "row and mask": {"observation": "flat", "settings": {**NORMALIZED, "observation.mask": "beside"}},
    "row": {"observation": "flat", "settings": {**NORMALIZED, "observation.mask": "info"}},
    "kinds and mask": {"observation": ("features", "planner"), "settings": {"observation.mask": "beside"}},
    "three agents": {
        "observation": "flat",
        "settings": {"observation.mask": "method"},
        "ghosts": ("policy", "policy", "wander"),
    },
    "nearest": {"flat": True, "settings": {"observation.candidates": "nearest"}},
}
