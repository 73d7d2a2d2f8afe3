"""Line-ups of ghosts, such as ``"arcade,chase@0.1-0.3"``: their syntax, teachers and order.

The first behaviour of a line-up is Clyde's, the second Blinky's, and so on. A member of the league (``league.py``)
moves the ghosts called ``learned``. After ``@`` follow their lowest and highest speed, m/s, if they differ from the
training's, and after ``+`` the number of power pellets. A line-up listed twice has twice the share of the games.
"""

import math
import re
from collections.abc import Sequence
from typing import NamedTuple

from ..config.validation import located, require
from ..game.ghosts import GHOST_NAMES, WANDER, find_behaviour
from ..heuristics.search.search import SearchParameters
from ..policies.base import Policy
from ..policies.registry import make_policy

LEARNED = "learned"  # behaviour of ghosts that a member of the league moves
RULE = "lookahead"  # teacher if all ghosts wander, otherwise the base of ``search``
_SYNTAX = re.compile(r"([^@+]*)(?:@([^+-]*)-([^+]*))?(?:\+(\d+))?")
_AROUND = re.compile(r"\s*([,@+-])\s*")  # spaces around separators
_FUTURES = 1  # sampled futures of wandering ghosts in the teacher's search
#: Fewest segments that the search needs for a decision.
LEAST_NODES = SearchParameters(samples=_FUTURES).least_nodes
SUB_BATCHES = 4  # in a segment; more if several line-ups cannot share the games otherwise


class Lineup(NamedTuple):
    behaviours: tuple[str, ...]  # of each ghost, Clyde first
    speeds_mps: tuple[float, float] | None  # lowest and highest; None: the speeds of the training
    power_pellets: int


def read(lineup: str) -> Lineup:
    """Return the parts of a line-up; raises ValueError for a wrong syntax."""
    if not (match := _SYNTAX.fullmatch(lineup)):
        raise ValueError(lineup)
    ghosts, low, high, power = match.groups()
    return Lineup(tuple(ghosts.split(",")), None if low is None else (float(low), float(high)), int(power or 0))


def checked(lineup: str, name: str) -> str:
    """Return the line-up without spaces; raises ConfigError, with the field ``name``, for an invalid line-up."""
    lineup = _AROUND.sub(r"\1", lineup.strip())
    try:
        low, high = read(lineup).speeds_mps or (0.0, 1.0)
        fits = math.isfinite(high) and 0 <= low < high
    except ValueError:
        fits = False
    rule = "lowest and highest speed, m/s, follow @, the number of power pellets +: chase@0.1-0.3+4"
    require(fits, name, lineup, rule)
    each = read(lineup).behaviours
    require(all(each), name, lineup, "must be behaviours separated by commas")
    require(len(each) <= len(GHOST_NAMES), name, lineup, f"must be at most {len(GHOST_NAMES)} behaviours")
    for one in set(each) - {LEARNED}:
        with located(f"{name} = {lineup!r}"):
            behaviour = find_behaviour(one)
        require(behaviour.target is not None, name, lineup, f"{one!r} is for a ghost that is sent from outside")
    return lineup


def searches(lineup: str) -> bool:
    """Return True if ``search`` teaches against the line-up, because not all ghosts wander."""
    return set(read(lineup).behaviours) != {WANDER}


def make_teacher(lineup: str, nodes: int) -> Policy:
    """Create the rule to imitate against a line-up; ``nodes`` are the segments that a search plays for a decision."""
    if not searches(lineup):
        return make_policy(RULE)
    # The teacher knows the behaviours, which the network has to infer from the ghosts' moves.
    return make_policy("search", base=RULE, behaviours="configuration", nodes=nodes, samples=_FUTURES)


def sub_batches(ghosts: Sequence[str], games: int, levels: int) -> list[str]:
    """Return the line-up of each sub-batch, ordered so that both halves take equally long to play.

    The number of sub-batches is a multiple of the number of line-ups, so that each line-up has its share of the games.
    Raises ConfigError if ``games`` cannot be divided evenly, or if there are fewer ``levels`` than line-ups.
    """
    count = len(ghosts)
    require(games % count == 0, "games", games, f"must be a multiple of the {count} line-ups in ghosts")
    require(levels >= count, "levels", levels, f"must be at least the {count} line-ups in ghosts")
    most = -(-SUB_BATCHES // count)
    copies = next(k for k in range(most, 0, -1) if games % (k * count) == 0 and levels >= k * count)
    ordered = sorted([*ghosts] * copies, key=lambda one: (searches(one), len(read(one).behaviours), one))
    halves: tuple[list[str], list[str]] = [], []
    for k, one in enumerate(ordered):
        halves[k % 4 in (1, 2)].append(one)  # deal in the order 0 1 1 0
    first, last = sorted(halves, key=len)  # the first group of games is the smaller one
    return first + last
