"""Where a robot can be sent, and what is known of a goal that was sent; what is done about them is ``pursuit.py``'s."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

HOME = -2  # as a candidate: the way home

Position = tuple[float, float]


class Place(Protocol):
    """Where to go; a pellet has an id."""

    @property
    def candidate(self) -> int:
        """Number of the candidate, or ``HOME``."""

    @property
    def x(self) -> float:
        """Position, m."""

    @property
    def y(self) -> float:
        """Position, m."""

    @property
    def pellet(self) -> int | None:
        """The pellet's id; None: no pellet."""


@dataclass(frozen=True)
class Home:
    """The home pose as a place."""

    x: float  # m
    y: float
    heading: float  # rad
    candidate: int = HOME
    pellet: None = None


@dataclass
class Sent:
    """A goal that Nav2 has not ended yet, as far as is known."""

    place: Place
    since_s: float
    accepted: bool = False
    cancelled_s: float | None = None  # when its end was asked for
