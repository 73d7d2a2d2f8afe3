"""Line-ups of ghosts, such as ``"arcade,chase@0.1-0.3"``: their syntax, teachers and order.

The first behaviour of a line-up is Clyde's, the second Blinky's, and so on. A member of the league (``league.py``)
moves the ghosts called ``learned``. After ``@`` follow their lowest and highest speed, m/s, if they differ from the
training's, and after ``+`` the number of power pellets. A line-up listed twice has twice the share of the games.
"""

import math
import re
from collections.abc import Sequence

from pacman_env.config.validation import located, require
from pacman_env.game.ghosts import GHOST_NAMES, WANDER, find_behaviour
from pacman_env.heuristics.search.search import SearchParameters
from pacman_env.policies.base import Policy
from pacman_env.policies.registry import make_policy

LEARNED = "learned"  # behaviour of ghosts that a member of the league moves
RULE = "lookahead"  # teacher if all ghosts wander, otherwise the base of ``search``
_SPEEDS, _POWER = "@", "+"
_AROUND = re.compile(r"\s*([,@+-])\s*")  # spaces around separators
_FUTURES = 1  # sampled futures of wandering ghosts in the teacher's search
#: Fewest segments that the search needs for a decision.
LEAST_NODES = SearchParameters(samples=_FUTURES).least_nodes
SUB_BATCHES = 4  # in a segment; more if several line-ups cannot share the games otherwise


def _parts(lineup: str) -> tuple[str, str | None, str | None]:
    """Split a line-up into the texts of its ghosts, their speeds and the number of power pellets; None: not given."""
    ghosts, has_power, power = lineup.partition(_POWER)
    ghosts, has_speeds, speeds = ghosts.partition(_SPEEDS)
    return ghosts, speeds if has_speeds else None, power if has_power else None


def behaviours(lineup: str) -> tuple[str, ...]:
    """Return the behaviour of each ghost, Clyde first."""
    return tuple(_parts(lineup)[0].split(","))


def speeds(lineup: str) -> tuple[float, float] | None:
    """Return the lowest and highest speed of the ghosts, m/s; None: the speeds of the training."""
    text = _parts(lineup)[1]
    if text is None:
        return None
    low, _, high = text.partition("-")
    return float(low), float(high)


def power_pellets(lineup: str) -> int:
    text = _parts(lineup)[2]
    return 0 if text is None else int(text)


def checked(lineup: str, name: str) -> str:
    """Return the line-up without spaces; raises ConfigError, with the field ``name``, for an invalid line-up."""
    lineup = _AROUND.sub(r"\1", lineup.strip())
    try:
        low, high = speeds(lineup) or (0.0, 1.0)
        fits = math.isfinite(high) and 0 <= low < high and power_pellets(lineup) >= 0
    except ValueError:
        fits = False
    rule = f"lowest and highest speed, m/s, follow {_SPEEDS}, the number of power pellets {_POWER}: chase@0.1-0.3+4"
    require(fits, name, lineup, rule)
    each = behaviours(lineup)
    require(all(each), name, lineup, "must be behaviours separated by commas")
    require(len(each) <= len(GHOST_NAMES), name, lineup, f"must be at most {len(GHOST_NAMES)} behaviours")
    for one in each:
        if one == LEARNED:
            continue
        with located(f"{name} = {lineup!r}"):
            behaviour = find_behaviour(one)
        require(behaviour.target is not None, name, lineup, f"{one!r} is for a ghost that is sent from outside")
    return lineup


def searches(lineup: str) -> bool:
    """Return True if ``search`` teaches against the line-up, because not all ghosts wander."""
    return set(behaviours(lineup)) != {WANDER}


def teacher_name(lineup: str) -> str:
    """Return the name of the rule to imitate against a line-up."""
    return "search" if searches(lineup) else RULE


def make_teacher(lineup: str, nodes: int) -> Policy:
    """Create the rule to imitate; ``nodes`` are the segments that a search plays for a decision."""
    # The teacher knows the behaviours, which the network has to infer from the ghosts' moves.
    searching = {"base": RULE, "behaviours": "configuration", "nodes": nodes, "samples": _FUTURES}
    settings = searching if searches(lineup) else {}
    return make_policy(teacher_name(lineup), **settings)


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
    ordered = sorted([*ghosts] * copies, key=lambda one: (searches(one), len(behaviours(one)), one))
    halves: tuple[list[str], list[str]] = [], []
    for k, one in enumerate(ordered):
        halves[k % 4 in (1, 2)].append(one)  # deal in the order 0 1 1 0
    first, last = sorted(halves, key=len)  # the first group of games is the smaller one
    return first + last
