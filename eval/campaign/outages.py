"""Nodes that are frozen, killed, or lose packets: begun and ended in the processes of a running game.

What is drawn is in ``schedule``, what may be late because of it in ``verdict``. Durations are wall time; a killed
node is away until the recorder has heard the new one, and so is one that ends after a standstill.
"""

from __future__ import annotations

import contextlib
import math
import os
import signal
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from . import network
from .schedule import EVERY_NODE, FREEZE, KILL, LEASE_S, LOSS, Step
from .verdict import Outage

#: By how many leases a node stood still, at most: how long it may take, wall time on a busy machine, until it is
#: started anew. Nobody has missed it; it may be; it is.
_ENDS_WITHIN_S = (0.75, 0.0), (1.25, 8.0), (math.inf, 60.0)
_LOOK_S = 0.2  # between two looks at the ports of those who lose packets: a node that is started again has others


@dataclass
class _Active:
    step: Step
    process: int
    began: int  # ns
    end_s: float
    thawed: bool = False  # it ran again, and may end to be started anew


class Outages:
    """Those of one game.

    Args:
        ids: the processes of the nodes, by name, as they are now.
        heard: likewise, as they have been heard of.
        speed: of simulated time: outages are as much shorter than they were drawn.
    """

    def __init__(
        self, ids: Callable[[], Mapping[str, int]], heard: Callable[[], Mapping[str, int]], speed: float
    ) -> None:
        self._ids, self._heard, self._speed = ids, heard, speed
        self._active: list[_Active] = []
        self._losses: list[network.Loss] = []
        self._look_s = 0.0
        self.over: list[Outage] = []

    def __bool__(self) -> bool:
        """Whether anybody is away."""
        return bool(self._active)

    @property
    def now(self) -> list[Outage]:
        """Those that are not over, as if they were."""
        return [Outage(one.step.kind, one.step.node, one.began, time.time_ns()) for one in self._active]

    def away(self, node: str) -> bool:
        """Whether that node is."""
        return any(one.step.node in (node, EVERY_NODE) for one in self._active)

    def begin(self, step: Step) -> bool:
        """False: nothing comes of it, for the node is dead or frozen already."""
        process = self._ids().get(step.node, 0)
        if step.kind != LOSS and (
            not process or any(one.step.node == step.node and one.step.kind in (KILL, FREEZE) for one in self._active)
        ):
            return False
        if step.kind != LOSS:
            os.kill(process, signal.SIGKILL if step.kind == KILL else signal.SIGSTOP)
        end_s = time.monotonic() + step.lasts_s / self._speed
        self._active.append(_Active(step, process, time.time_ns(), end_s))
        self._look_s = 0.0
        return True

    def tend(self) -> None:
        """To be called often: ends what is due."""
        for one in self._active[:]:
            if self._is_over(one):
                self._end(one)
            elif one.step.kind == FREEZE and not one.thawed and time.monotonic() >= one.end_s:
                self._thaw(one)
                leases = (time.time_ns() - one.began) * 1e-9 * self._speed / LEASE_S
                one.end_s = time.monotonic() + next(wait_s for most, wait_s in _ENDS_WITHIN_S if leases < most)
        now_s = time.monotonic()
        if now_s - self._look_s >= _LOOK_S:
            self._look_s = now_s
            self._lose()

    def end_all(self) -> None:
        """Nobody is left frozen or cut off."""
        for one in self._active[:]:
            self._end(one)
        self._lose()

    def _is_over(self, one: _Active) -> bool:
        known = self._ids().get(one.step.node)
        if one.step.kind == KILL or (one.thawed and known != one.process):
            return known not in (None, one.process) and self._heard().get(one.step.node) == known
        return time.monotonic() >= one.end_s and (one.thawed or one.step.kind != FREEZE)

    def _thaw(self, one: _Active) -> None:
        one.thawed = True
        if self._ids().get(one.step.node) == one.process:
            with contextlib.suppress(ProcessLookupError):
                os.kill(one.process, signal.SIGCONT)

    def _end(self, one: _Active) -> None:
        self._active.remove(one)
        if one.step.kind == FREEZE:
            self._thaw(one)
        self._look_s = 0.0
        self.over.append(Outage(one.step.kind, one.step.node, one.began, time.time_ns()))

    def _lose(self) -> None:
        ids = self._ids()
        losses = [
            network.Loss(
                None if one.step.node == EVERY_NODE else network.ports_of(ids.get(one.step.node, 0)), one.step.percent
            )
            for one in self._active
            if one.step.kind == LOSS
        ]
        if losses != self._losses:
            network.apply(losses, network.ports_of(os.getpid()))  # who judges hears all
            self._losses = losses
