"""Goals of a map, and goals sent to Nav2 that have not ended as far as known."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from .execution import NO_CHOICE

HOME = -2  # candidate number of the home pose
_KEPT = 16  # largest number of open goals; older ones are forgotten
_ANSWER_S = 5.0  # a goal without an answer for this long is given up
_CANCEL_S = 1.0  # a new goal waits this long for the end of a cancel, which would cancel the new goal too

Position = tuple[float, float]  # m


@dataclass(frozen=True)
class Place:
    """A goal: a pellet with its id, a refuge, or home with its heading (rad)."""

    candidate: int  # number of the candidate, or ``HOME``
    x: float  # m
    y: float
    pellet: int | None = None
    heading: float | None = None


def goal_name(pellet_ids: Sequence[int], goal: int) -> str:
    """Return the displayed name of a map goal: pellets have ids, refuges count from 0."""
    pellets = len(pellet_ids)
    return f"pellet {pellet_ids[goal]}" if goal < pellets else f"refuge {goal - pellets}"


def home_place(x: float, y: float, heading: float) -> Place:
    return Place(HOME, x, y, heading=heading)


class Goals:
    """Goals of one map: candidate pellets, pellets out of reach, refuges; positions in m.

    Pellets out of reach can only be collected in passing. ``slot`` maps a pellet's id to its row in ``xy``, and
    ``power`` is a mask of the power pellets by slot.
    """

    def __init__(
        self,
        pellets: dict[int, Position],
        out_of_reach: dict[int, Position],
        refuges: Sequence[Position],
        power: Collection[int] = (),
    ) -> None:
        self.candidates = len(pellets)
        self.positions = {**pellets, **out_of_reach}
        self.ids = tuple(self.positions)
        self.slot = {number: slot for slot, number in enumerate(self.ids)}
        self.xy = np.array([*self.positions.values(), *refuges], dtype=np.float64).reshape(-1, 2)
        self.refuges = len(refuges)
        self.power = np.array([number in power for number in self.ids], dtype=np.bool_)


@dataclass(frozen=True)
class ExecutorAction:
    """One action of the executor; actions must be done in order.

    ``send`` and ``cancel`` a goal by its number, ``stop`` the wheels, report a ``status`` word, ``remove`` a pellet by
    its id, announce an ``event``. The value of ``ignored`` tells why an input had no effect.
    """

    kind: Literal["send", "cancel", "stop", "status", "remove", "event", "ignored"]
    value: int | str = ""
    place: Place | None = None


@dataclass
class Sent:
    place: Place
    since_s: float
    accepted: bool = False
    cancelled_s: float | None = None  # time of the last cancel request
    unwanted: bool = False  # must be cancelled, or was pre-empted by a later goal

    def unanswered(self, now: float) -> bool:
        return not self.accepted and now - self.since_s >= _ANSWER_S

    def cancel_due(self, now: float) -> bool:
        """Return True if an unwanted goal must be cancelled now, possibly again.

        A goal without an answer may have been lost and then never ends. Its cancel is repeated less often, because no
        goal is chosen while a cancel may also cancel the next goal.
        """
        if not (self.accepted or self.unanswered(now)):
            return False
        again_s = _CANCEL_S if self.accepted else _ANSWER_S
        return self.cancelled_s is None or now - self.cancelled_s >= again_s


class SentGoals:
    """Open goals by number; at most one is current."""

    def __init__(self) -> None:
        self.open: dict[int, Sent] = {}
        self.number = 0  # number of the last goal sent
        self.current: int | None = None

    @property
    def pursued(self) -> int:
        return NO_CHOICE if self.current is None else self.open[self.current].place.candidate

    @property
    def navigating(self) -> bool:
        return any(not sent.unwanted for sent in self.open.values())

    def settling(self, now: float) -> bool:
        """Return True if a recent cancel request could still cancel a goal that is sent now."""
        return any(sent.cancelled_s is not None and now - sent.cancelled_s < _CANCEL_S for sent in self.open.values())

    def send(self, place: Place, now: float) -> ExecutorAction:
        for sent in self.open.values():
            sent.unwanted |= not sent.accepted  # if accepted late, it would replace the new goal
        self.number += 1
        self.current = self.number
        self.open[self.number] = Sent(place, now)
        while len(self.open) > _KEPT:
            del self.open[min(self.open)]
        return ExecutorAction("send", self.number, place)

    def accepted(self, number: int, now: float) -> list[ExecutorAction]:
        """Record that Nav2 accepted a goal, and cancel it at once if it is unwanted."""
        sent = self.open.get(number)
        if sent is not None:
            sent.accepted = True
            for other, earlier in self.open.items():
                earlier.unwanted |= other < number
        if self.current is not None or (sent is not None and not sent.unwanted):
            return []  # it is wanted, or the current goal pre-empts it
        if sent is not None:
            sent.cancelled_s = now
        return [ExecutorAction("cancel", number)]

    def cancel_all(self, now: float) -> list[ExecutorAction]:
        """Cancel all goals; goals that are not accepted yet are cancelled on acceptance or when overdue."""
        self.current = None
        for sent in self.open.values():
            sent.unwanted = True
        return self.cancel_unwanted(now)

    def cancel_unwanted(self, now: float) -> list[ExecutorAction]:
        due = [number for number, sent in self.open.items() if sent.unwanted and sent.cancel_due(now)]
        for number in due:
            self.open[number].cancelled_s = now
        return [ExecutorAction("cancel", number) for number in due]
