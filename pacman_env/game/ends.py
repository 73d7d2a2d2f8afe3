"""How a round ends: the codes of games, and what machines and people call the ends."""

from typing import NamedTuple

Colour = tuple[int, int, int]

RUNNING, CAUGHT, COMPLETE, CLEARED, TIMEOUT = range(5)  # codes
_WHITE, _BLACK = (255, 255, 255), (30, 30, 30)


class End(NamedTuple):
    """Names and colours of one end, or of a running round."""

    word: str  # in infos, messages and recordings
    name: str  # for people
    meaning: str  # for people
    letter: str  # in the results of a comparison
    rate: str  # field of a comparison's rows: share of the rounds with this end
    chart: str  # colour in charts: Okabe and Ito's palette for colour-blind readers
    badge: Colour  # background in pictures of a game
    ink: Colour  # text on this background


#: Ends by code.
ENDS = (
    End("running", "running", "the round is not over", "", "", "", (46, 125, 50), _WHITE),
    End("caught", "caught", "caught", "D", "death_rate", "#D55E00", (200, 32, 32), _WHITE),
    End("complete", "complete", "all pellets collected", "C", "completion_rate", "#0072B2", (255, 214, 0), _BLACK),
    End(
        *("cleared", "pellets lost", "no pellet left, but some lost to aborted goals"),
        *("L", "cleared_rate", "#CC79A7", (240, 200, 120), _BLACK),
    ),
    End("timeout", "time limit", "time limit reached", "T", "timeout_rate", "#F0E442", (112, 118, 132), _WHITE),
)
