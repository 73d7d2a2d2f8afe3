"""Colours of the six LEDs of the light ring by light word and time (Algorithm 7); event lights are in ``events.py``."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

from ..config import ShowConfig
from .ghosts import GHOSTS

Colour = tuple[int, int, int]  # red, green, blue, 0..255
Ring = tuple[Colour, ...]  # colours of the six LEDs

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
YELLOW, RED, WHITE = COLOURS["yellow"], COLOURS["red"], COLOURS["white"]
FRAME_S = 0.15


@dataclass(frozen=True)
class Light:
    """A named light: colours of the LED ring over time, repeated until its duration is over."""

    word: str
    rings: tuple[Ring, ...]  # empty: the robot controls the ring
    lasts: float | str = math.inf  # s, or a field of ShowConfig in s; inf: until the next word
    then: str | None = None  # lasting word shown afterwards; None: the previous one

    def duration_s(self, show: ShowConfig) -> float:
        return getattr(show, self.lasts) if isinstance(self.lasts, str) else self.lasts

    def at(self, elapsed_s: float) -> Ring | None:
        return self.rings[int(elapsed_s / FRAME_S) % len(self.rings)] if self.rings else None


def all_six(colour: Colour) -> Ring:
    return (colour,) * 6


def turning(ring: Ring) -> tuple[Ring, ...]:
    return tuple(ring[6 - k :] + ring[: 6 - k] for k in range(6))


def wave(colour: Colour) -> tuple[Ring, ...]:
    adjacent, background = _dimmed(colour, 0.5), _dimmed(RED, 0.2)
    return turning((colour, adjacent, background, background, background, adjacent))


def _dimmed(colour: Colour, share: float) -> Colour:
    red, green, blue = colour
    return round(red * share), round(green * share), round(blue * share)


def _mouth(width: int) -> Ring:
    dark = range(-(width // 2), width - width // 2)
    return tuple(BLACK if {k, k - 6} & set(dark) else YELLOW for k in range(6))


OFF = Light("off", ())
#: Lights without an event.
PLAIN_LIGHTS = (
    *(Light(name, (all_six(colour),)) for name, colour in COLOURS.items()),
    Light("pacman", (_mouth(0), _mouth(1), _mouth(3), _mouth(1))),  # opening and closing mouth
    OFF,
)
#: Lasting light by game state; ``off`` in all other states.
LASTING = {"starting": "pacman", "running": "pacman"}


def light_colour(light: Light) -> Colour | None:
    """Return the colour of a light for a button: its ghost's colour or its only colour; None if it has several."""
    colours = {colour for ring in light.rings for colour in ring}
    return GHOST_COLOURS.get(light.word.split()[0]) or (colours.pop() if len(colours) == 1 else None)


class LightRing:
    """State of the light ring: a lasting word stays, and finite animations are shown on top of it."""

    def __init__(self, lights: Mapping[str, Light], show: ShowConfig) -> None:
        self._lights, self._show = lights, show
        self._lasting = self._word = OFF.word
        self._since_s = 0.0

    def command(self, word: str, now: float) -> None:
        """Start showing a word at the time ``now``, s; raises ValueError if there is no such light."""
        if word not in self._lights:
            raise ValueError(f"light {word!r}: not one of {', '.join(sorted(self._lights))}")
        self._word, self._since_s = word, now
        light = self._lights[word]
        if light.lasts == math.inf:
            self._lasting = word
        elif light.then is not None:
            self._lasting = light.then

    def ring(self, now: float) -> Ring | None:
        """Return the colours to show at the time ``now``, s, or None if the robot controls the ring."""
        if not 0 <= now - self._since_s < self._lights[self._word].duration_s(self._show):  # over, or clock set back
            self._word, self._since_s = self._lasting, now
        return self._lights[self._word].at(now - self._since_s)
