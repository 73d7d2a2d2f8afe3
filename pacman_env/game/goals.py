"""Where a robot can be sent, and what is known of a goal that was sent."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

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


class Goals:
    """The goals of one map: pellets that are candidates, pellets out of reach, refuges.

    Args:
        pellets: the candidates' positions by id, m.
        out_of_reach: those of the pellets that the robot can collect only in passing.
        refuges: positions, m.

    Attributes:
        ids: the pellets' ids by slot.
        candidates: how many of the pellets are candidates.
        xy: (pellets + refuges, 2) m.
    """

    def __init__(
        self, pellets: dict[int, Position], out_of_reach: dict[int, Position], refuges: Sequence[Position]
    ) -> None:
        self.candidates = len(pellets)
        self.positions = {**pellets, **out_of_reach}
        self.ids = tuple(self.positions)
        self.slot = {number: slot for slot, number in enumerate(self.ids)}
        self.xy = np.array([*self.positions.values(), *refuges], dtype=np.float64).reshape(-1, 2)
        self.refuges = len(refuges)


@dataclass
class Sent:
    """A goal that Nav2 has not ended yet, as far as is known."""

    place: Place
    since_s: float
    accepted: bool = False
    cancelled_s: float | None = None  # when its end was asked for
    let_go: bool = False  # nobody wants it any more, or a later one has pre-empted it
