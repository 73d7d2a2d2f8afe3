"""Line-ups of ghosts, such as ``"arcade,chase@0.1-0.3"``: what is allowed, who teaches against them, in what order.

The first behaviour of a line-up is Clyde's, the second Blinky's, and so on; ``learned`` is moved by a member of the
league (``league.py``); after ``@`` come their lowest and highest
speed, m/s, if they differ from the training's. A line-up that is listed twice has twice the share of the games.
"""

import math
from collections.abc import Sequence

from pacman_env.config import ConfigError
from pacman_env.config.validation import require
from pacman_env.game.ghosts import GHOST_NAMES, WANDER, find_behaviour
from pacman_env.heuristics.search.search import SearchParameters
from pacman_env.policies.base import Policy
from pacman_env.policies.registry import make_policy

LEARNED = "learned"  # a ghost that a member of the training's league moves
RULE = "lookahead"  # teaches where all ghosts wander; the base of ``search`` elsewhere
_SPEEDS = "@"
_FUTURES = 1  # of ghosts that wander beside others, in the search that teaches
#: Segments that the search needs for a decision.
LEAST_NODES = SearchParameters(samples=_FUTURES).least_nodes
SUB_BATCHES = 4  # of the games of a segment; with several line-ups at least, if games and levels can be divided so


def behaviours(lineup: str) -> tuple[str, ...]:
    """The behaviour of each ghost, Clyde first."""
    return tuple(lineup.partition(_SPEEDS)[0].split(","))


def speeds(lineup: str) -> tuple[float, float] | None:
    """The lowest and the highest speed of its ghosts, m/s; None: those of the training."""
    _, given, text = lineup.partition(_SPEEDS)
    if not given:
        return None
    low, _, high = text.partition("-")
    return float(low), float(high)


def checked(lineup: str, name: str) -> str:
    """The line-up without spaces; ConfigError, which names the field ``name`` and the value, for one that cannot be."""
    ghosts, given, text = lineup.partition(_SPEEDS)
    try:
        low, high = speeds(lineup) or (0.0, 1.0)
        fits = math.isfinite(high) and 0 <= low < high
    except ValueError:
        fits = False
    require(fits, name, lineup, f"after {_SPEEDS} must be a lowest and a highest speed, m/s, such as 0.1-0.3")
    each = [one.strip() for one in ghosts.split(",")]
    require(all(each), name, lineup, "must be behaviours separated by commas")
    require(len(each) <= len(GHOST_NAMES), name, lineup, f"must be at most {len(GHOST_NAMES)} behaviours")
    for one in each:
        if one == LEARNED:
            continue
        try:
            found = find_behaviour(one)
        except ConfigError as error:
            raise ConfigError(f"{name} = {lineup!r}: {error}") from None
        require(found.target is not None, name, lineup, f"{one!r} is for a ghost that is sent from outside")
    return ",".join(each) + given + text.replace(" ", "")


def searches(lineup: str) -> bool:
    """Whether ``search`` teaches against it: not all ghosts wander."""
    return set(behaviours(lineup)) != {WANDER}


def teacher_name(lineup: str) -> str:
    """The rule that is imitated against a line-up."""
    return "search" if searches(lineup) else RULE


def make_teacher(lineup: str, nodes: int) -> Policy:
    """That rule; ``nodes``: segments that a search plays for a decision."""
    # The teacher knows what the network has to infer from the ghosts' moves.
    searching = {"base": RULE, "behaviours": "configuration", "nodes": nodes, "samples": _FUTURES}
    settings = searching if searches(lineup) else {}
    return make_policy(teacher_name(lineup), **settings)


def sub_batches(ghosts: Sequence[str], games: int, levels: int) -> list[str]:
    """The line-up of each sub-batch, the first half of them as costly as the other.

    They are as many as line-ups in the list or a multiple, so that each line-up has its share of the games. Raises
    ConfigError if ``games`` cannot be divided evenly, or if there are fewer ``levels`` than line-ups.
    """
    count = len(ghosts)
    require(games % count == 0, "games", games, f"must be a multiple of the {count} line-ups in ghosts")
    require(levels >= count, "levels", levels, f"must be at least the {count} line-ups in ghosts")
    most = -(-SUB_BATCHES // count)
    copies = next(k for k in range(most, 0, -1) if games % (k * count) == 0 and levels >= k * count)
    ordered = sorted([*ghosts] * copies, key=lambda one: (searches(one), len(behaviours(one)), one))
    halves: tuple[list[str], list[str]] = [], []
    for k, one in enumerate(ordered):
        halves[k % 4 in (1, 2)].append(one)  # dealt out as 0 1 1 0
    first, last = sorted(halves, key=len)  # the games' first group is the smaller one
    return first + last
