"""What is shown of a simulated game: its scene, and frames on the way from tick to tick."""

from __future__ import annotations

from typing import Any

import numpy as np

from pacman_env.game.round import RoundController
from pacman_env.web.feedback import Feedback
from pacman_env.web.frame import Frame
from pacman_env.web.played_round import PlayedRound, Snapshot, between
from pacman_env.web.rules import Rules
from pacman_env.web.scenes import PREPARING, scene_of
from pacman_env.web.tick_clock import TickClock

_STEPS = 64  # of a tick that frames tell apart


class SimulatedView:
    """The scene and the last two snapshots.

    Args:
        clock: how much of the last tick is over.
        feedback: lights and motions.
    """

    def __init__(self, clock: TickClock, feedback: Feedback) -> None:
        self.scene = PREPARING
        self.lidar = False
        self._clock, self._feedback = clock, feedback
        self._before: Snapshot | None = None
        self._now: Snapshot | None = None
        self._changes = self._number = 0
        self._key: Any = None

    def changed(self) -> None:
        """Another frame is due."""
        self._changes += 1

    def show(self, before: Snapshot, now: Snapshot) -> None:
        """Move from one snapshot to the next."""
        self._before, self._now = before, now
        self.changed()

    def stay(self) -> None:
        """A tick in which nothing moves."""
        self._before = self._now
        self.changed()

    def show_round(self, played: PlayedRound, rules: Rules) -> None:
        """Another round, or one whose ghosts were placed."""
        self.show(played.snapshots[-1], played.snapshots[-1])
        self.scene = scene_of(played, rules, self.scene.revision % 65535 + 1)

    def frame(self, played: PlayedRound | None, controller: RoundController, real_s: float) -> Frame | None:
        """The game at a moment of real time; None: no round is laid out yet."""
        if self._now is None or self._before is None or played is None:
            return None
        clock, feedback, now = self._clock, self._feedback, self._now
        share, ring = int(clock.share(real_s) * _STEPS) / _STEPS, feedback.ring(real_s)
        key = (self._changes, share, ring, feedback.turned, clock.paused, clock.stopped)
        if key != self._key:
            self._key = key
            self._number += 1
        fields = between(self._before, now, share)
        runs = controller.state == "running"
        if clock.is_held or not runs:
            fields["velocity"] = (0.0, 0.0)
        if feedback.turned:
            fields |= {name: (*fields[name][:2], fields[name][2] + feedback.turned) for name in ("true", "believed")}
        return Frame(
            state=controller.state,
            revision=self.scene.revision,
            number=self._number,
            speed=clock.speed,
            score=controller.score - (now.collected - fields["collected"] if runs else 0),
            spawned=len(now.alive),
            round=controller.round,
            paused=clock.paused,
            stopped=clock.stopped,
            ring=ring,
            scan=played.lidar() if self.lidar else np.zeros(0),
            **fields,
        )
