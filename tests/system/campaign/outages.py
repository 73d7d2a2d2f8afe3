"""Nodes that are frozen, killed, or lose packets: begun and ended at simulated moments of a running game.

What is drawn is in ``schedule``, what may be late because of it in ``verdict``. Durations are of the simulated wall
clock; a killed node is away until it has been started again, and so is one that ends after a standstill.
"""

from __future__ import annotations

from dataclasses import dataclass

from tests.system.campaign.recorded_game import RecordedGame
from tests.system.campaign.schedule import EVERY_NODE, FREEZE, KILL, LOSS, Step
from tests.system.campaign.verdict import Outage


@dataclass
class _Active:
    step: Step
    number: int  # of the node's start; 0: of none
    began: int  # instant
    end_s: float  # of the simulated wall clock
    thawed: bool = False


class Outages:
    """Those of one game.

    Args:
        game: whose nodes are concerned.

    Attributes:
        over: those that have ended.
    """

    def __init__(self, game: RecordedGame) -> None:
        self._game = game
        self._active: list[_Active] = []
        self.over: list[Outage] = []

    def __bool__(self) -> bool:
        """Whether a node is away, or loses packets."""
        return bool(self._active)

    @property
    def now(self) -> list[Outage]:
        """Those that are not over, as if they were."""
        return [self._outage(one) for one in self._active]

    def away(self, node: str) -> bool:
        """Whether that node is, or loses packets."""
        return any(one.step.node in (node, EVERY_NODE) for one in self._active)

    def begin(self, step: Step) -> bool:
        """False: nothing comes of it, for the node is dead or frozen already."""
        game, kind, node = self._game, step.kind, step.node
        member = game.member(node)
        if kind != LOSS and (member is None or member.frozen_s is not None):
            return False
        self._active.append(
            _Active(step, member.number if member else 0, game.recorder.instant(), game.wall.now_s + step.lasts_s)
        )
        if kind == KILL:
            game.kill(node)
        elif kind == FREEZE:
            game.freeze_node(node)
        else:
            game.losses.begin(_loser(step), step.percent, game.wall.now_s)
        return True

    def tend(self) -> None:
        """To be called after each step: ends what is due."""
        for one in self._active[:]:
            due = self._game.wall.now_s >= one.end_s - 1e-6
            if one.step.kind == FREEZE and due and not one.thawed:
                one.thawed = True
                self._game.thaw_node(one.step.node)
            if due if one.step.kind == LOSS else self._is_back(one):
                self._end(one)

    def end_all(self) -> None:
        """No node is left frozen or cut off."""
        for one in self._active[:]:
            if one.step.kind == FREEZE and not one.thawed:
                self._game.thaw_node(one.step.node)
            self._end(one)

    def _is_back(self, one: _Active) -> bool:
        """Whether a node is there that is not frozen: another one than was killed."""
        member = self._game.member(one.step.node)
        killed = one.step.kind == KILL
        return member is not None and member.frozen_s is None and not (killed and member.number == one.number)

    def _end(self, one: _Active) -> None:
        self._active.remove(one)
        if one.step.kind == LOSS:
            self._game.losses.end(_loser(one.step), self._game.wall.now_s)
        self.over.append(self._outage(one))

    def _outage(self, one: _Active) -> Outage:
        return Outage(one.step.kind, one.step.node, one.began, self._game.recorder.instant())


def _loser(step: Step) -> str | None:
    return None if step.node == EVERY_NODE else step.node
