"""Estimate how long a round takes without ghosts, and warn if the time limit is too short for the pellets."""

import math

import numpy as np

from ..config import Config
from ..world.navigation.paths import UNREACHABLE_CM
from .assets import MapAssets

#: Time per pellet for braking, turning and starting, s. On 14 maps with 7 to 133 pellets, the estimate with mppi is
#: within 16 % of the median of the rounds that ``nearest`` completes.
_STOP_S = {"mppi": 3.0, "pure_pursuit": 0.0}
_SPARE = 1.5  # ``ppo`` needs up to 1.4 times the estimate, because it avoids the ghost


def time_warning(assets: MapAssets, config: Config) -> str | None:
    """Return a sentence with suggested settings if ``time_limit_s`` is too short for a round without ghosts."""
    need = _tour_m(assets) / config.robot.speed_mps + assets.pellets * _STOP_S[config.nav2.controller]
    limit = config.time_limit_s
    if need <= limit:
        return None
    # ``also`` is the limit for twice the spacing, which is assumed to halve the time.
    longer, also = (math.ceil(_SPARE * part / 100) * 100 for part in (need, need / 2))
    spacing = f"pellets.spacing_m={2 * config.pellets.spacing_m:g}" + (f" with time_limit_s={also}" * (also > limit))
    return (
        f"{assets.pellets} pellets need about {need:.0f} s even without ghosts, but time_limit_s is {limit:g}, so most "
        f"rounds will time out: try time_limit_s={longer}, or {spacing}"
    )


def _tour_m(assets: MapAssets) -> float:
    """Return the length of a tour that always drives to the nearest pellet, m."""
    here, total = assets.grid.nearest_cell(assets.grid.home[0], assets.grid.home[1], 1.0), 0
    left = np.flatnonzero(assets.length_cm[here, : assets.pellets] < UNREACHABLE_CM)
    while len(left):
        nearest = assets.length_cm[here, left].argmin()
        total += int(assets.length_cm[here, left[nearest]])
        here = int(assets.goal_cell[left[nearest]])
        left = np.delete(left, nearest)
    return total / 100
