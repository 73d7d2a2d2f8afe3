"""Algorithm 7: what the six LEDs of the light ring show, by light word and time."""

from __future__ import annotations

import math
from dataclasses import dataclass

from ..config import ShowConfig
from .ghosts import GHOSTS

Colour = tuple[int, int, int]  # red, green, blue, 0..255
Ring = tuple[Colour, ...]  # of the six LEDs

COLOURS: dict[str, Colour] = {
    "yellow": (255, 180, 0),
    "red": (255, 0, 0),
    "blue": (0, 0, 255),
    "pink": (255, 60, 180),
    "orange": (255, 80, 0),
    "white": (255, 255, 255),
}
GHOST_COLOURS = {ghost.name: ghost.light for ghost in GHOSTS}
BLACK: Colour = (0, 0, 0)
_YELLOW, _RED, _WHITE = COLOURS["yellow"], COLOURS["red"], COLOURS["white"]
_FRAME_S = 0.15


@dataclass(frozen=True)
class Animation:
    """Rings shown one after the other, again and again, until the time is over."""

    rings: tuple[Ring, ...]
    duration_s: float = math.inf  # inf: until the next word
    then: str | None = None  # the lasting word afterwards; None for the one before

    def at(self, elapsed_s: float) -> Ring:
        return self.rings[int(elapsed_s / _FRAME_S) % len(self.rings)]


def _all(colour: Colour) -> Ring:
    return (colour,) * 6


def _dimmed(colour: Colour, share: float) -> Colour:
    red, green, blue = colour
    return round(red * share), round(green * share), round(blue * share)


def _turning(ring: Ring) -> tuple[Ring, ...]:
    return tuple(ring[6 - k :] + ring[: 6 - k] for k in range(6))


def _wave(colour: Colour) -> tuple[Ring, ...]:
    beside, background = _dimmed(colour, 0.5), _dimmed(_RED, 0.2)
    return _turning((colour, beside, background, background, background, beside))


def _mouth(width: int) -> Ring:
    dark = range(-(width // 2), width - width // 2)
    return tuple(BLACK if {k, k - 6} & set(dark) else _YELLOW for k in range(6))


def animations(show: ShowConfig) -> dict[str, Animation]:
    """By light word, without ``off``."""
    ghosts = GHOST_COLOURS.items()
    return {
        **{name: Animation((_all(colour),)) for name, colour in COLOURS.items()},
        "pacman": Animation((_mouth(0), _mouth(1), _mouth(3), _mouth(1))),  # it opens and shuts
        "start": Animation(_turning((_YELLOW, *GHOST_COLOURS.values(), BLACK)), show.start_s, "pacman"),
        "pellet": Animation((_all(_WHITE), _all(_YELLOW)), 2 * _FRAME_S),
        "power pellet": Animation((_all(_YELLOW), _all(_WHITE)), 3.0),
        "game over": Animation(_wave(_RED), show.death_s, "off"),
        "win": Animation((*_turning((_YELLOW, BLACK, _WHITE) * 2), _all(_WHITE), _all(_YELLOW)), 6.0, "off"),
        **{f"{g} caught": Animation((_all(c), _all(_YELLOW)), 2.0) for g, c in ghosts},
        **{f"{g} killed": Animation(_wave(c), show.death_s, "off") for g, c in ghosts},
    }


def light_colour(word: str) -> Colour | None:
    """The colour that stands for a light word, such as on a button; None if it has several, or none."""
    return COLOURS.get(word) or GHOST_COLOURS.get(word.split()[0])


LIGHTS = frozenset(animations(ShowConfig())) | {"off"}
#: By state of the game: what the ring shows in it when nothing happens; ``off`` in every other.
LASTING = {"starting": "pacman", "running": "pacman"}


class LightRing:
    """The ring from word to word: a lasting word stays, an animation that ends is shown over it."""

    def __init__(self, show: ShowConfig) -> None:
        self._animations = animations(show)
        self._lasting = self._word = "off"
        self._since_s = 0.0

    def command(self, word: str, now: float) -> None:
        """Show a word from now on; raises ValueError unless it is one of ``LIGHTS``."""
        if word not in LIGHTS:
            raise ValueError(f"light {word!r}: not one of {', '.join(sorted(LIGHTS))}")
        self._word, self._since_s = word, now
        animation = self._animations.get(word)
        if animation is None or animation.duration_s == math.inf:
            self._lasting = word
        elif animation.then is not None:
            self._lasting = animation.then

    def ring(self, now: float) -> Ring | None:
        """What to show; None if the ring is the robot's own."""
        animation = self._animations.get(self._word)
        if animation is not None and not 0 <= now - self._since_s < animation.duration_s:  # over, or the clock set back
            self._word, self._since_s = self._lasting, now
            animation = self._animations.get(self._word)
        return None if animation is None else animation.at(now - self._since_s)
