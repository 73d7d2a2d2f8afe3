"""How a round ends: the codes of games, and what machines and people call the ends."""

from typing import NamedTuple

RUNNING, CAUGHT, COMPLETE, CLEARED, TIMEOUT = range(5)  # codes
_WHITE, _BLACK = (255, 255, 255), (30, 30, 30)


class End(NamedTuple):
    """Names and colours of one end, or of a running round."""

    word: str  # in infos, messages and recordings
    name: str  # for people
    meaning: str  # for people
    letter: str  # in the results of a comparison
    field: str  # stem of fields in the results of a comparison
    chart: str  # colour in charts: Okabe and Ito's palette for colour-blind readers
    badge: tuple[int, int, int]  # background in pictures of a game
    ink: tuple[int, int, int]  # text on this background


#: Ends by code.
ENDS = (
    End("running", "running", "the round is not over", "", "", "", (46, 125, 50), _WHITE),
    End("caught", "caught", "caught", "D", "death", "#D55E00", (200, 32, 32), _WHITE),
    End("complete", "complete", "all pellets collected", "C", "completion", "#0072B2", (255, 214, 0), _BLACK),
    End("cleared", "cleared", "no pellet left, but some lost", "L", "cleared", "#CC79A7", (240, 200, 120), _BLACK),
    End("timeout", "time limit", "time limit reached", "T", "timeout", "#F0E442", (112, 118, 132), _WHITE),
)
