"""How a game stands, as one binary message (docs/web_protocol.md, "frame"); little endian."""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

STATES = ("menu", "returning_home", "starting", "running", "dying", "complete")
KIND = 1
PAUSED, STOPPED, BELIEVED, TRUE, SHADOW, OVER, RING = 1, 2, 4, 8, 16, 32, 64
MOST_PLAN_POINTS = 64
Pose = tuple[float, float, float]
_HEAD = struct.Struct("<BBBBHHIffIHHHh18sHHH3f3fff4f")
_NOWHERE = (math.nan, math.nan, math.nan)


@dataclass(frozen=True)
class Frame:
    """A game at one moment.

    Attributes:
        state: one of ``STATES``.
        revision: of the scene it belongs to.
        number: counts up.
        time_s: since the round began.
        speed: of the simulated time, times real time.
        goal: the candidate pursued, -1: none.
        true, believed: pose of the robot, x, y (m), heading (rad); None: not known.
        velocity: v (m/s), omega (rad/s).
        ghosts: (G, 2) m.
        alive: (P,) pellets that are there.
        scores: (C,) of the candidates, NaN: none.
        plan: (K, 2) m, the way to the goal.
        scan: (R,) m, ray 0 ahead, the others counter-clockwise; NaN: nothing met.
        ring: six times red, green, blue; None: not ours.
        shadow: pose of another robot in the same round.
        shadow_collected: its pellets.
        over: the round has ended.
    """

    state: str
    revision: int
    number: int
    time_s: float = 0.0
    speed: float = 1.0
    score: int = 0
    collected: int = 0
    spawned: int = 0
    round: int = 1
    goal: int = -1
    paused: bool = False
    stopped: bool = False
    over: bool = False
    true: Pose | None = None
    believed: Pose | None = None
    velocity: tuple[float, float] = (0.0, 0.0)
    shadow: Pose | None = None
    shadow_collected: int = 0
    ring: tuple[tuple[int, int, int], ...] | None = None
    ghosts: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 2)))
    alive: NDArray[np.bool_] = field(default_factory=lambda: np.zeros(0, dtype=np.bool_))
    scores: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))
    plan: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 2)))
    scan: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))

    def encode(self) -> bytes:
        """The message."""
        flags = (
            PAUSED * self.paused
            | STOPPED * self.stopped
            | BELIEVED * (self.believed is not None)
            | TRUE * (self.true is not None)
            | SHADOW * (self.shadow is not None)
            | OVER * self.over
            | RING * (self.ring is not None)
        )
        plan = self.plan
        if len(plan) > MOST_PLAN_POINTS:
            plan = plan[np.linspace(0, len(plan) - 1, MOST_PLAN_POINTS).round().astype(int)]
        counts = len(self.scores), len(plan), len(self.scan)
        head = _HEAD.pack(
            KIND,
            STATES.index(self.state),
            flags,
            len(self.ghosts),
            self.revision,
            len(self.alive),
            self.number,
            self.time_s,
            self.speed,
            self.score,
            self.collected,
            self.spawned,
            self.round,
            self.goal,
            bytes(c for colour in self.ring or () for c in colour),
            *counts,
            *(self.true or _NOWHERE),
            *(self.believed or _NOWHERE),
            *self.velocity,
            *(self.shadow or _NOWHERE),
            self.shadow_collected,
        )
        millimetres = np.nan_to_num(np.clip(self.scan, 0.0, 65.0) * 1000.0, nan=0.0).astype("<u2")
        return b"".join(
            (
                head,
                self.ghosts.astype("<f4").tobytes(),
                np.packbits(self.alive, bitorder="little").tobytes(),
                self.scores.astype("<f4").tobytes(),
                plan.astype("<f4").tobytes(),
                millimetres.tobytes(),
            )
        )


def decode(message: bytes) -> Frame:
    """A frame from its message, as the page reads it.

    Raises:
        ValueError: it is none.
    """
    try:
        values = _HEAD.unpack_from(message)
        kind, state, flags, ghosts, revision, pellets, number = values[:7]
        counts = values[15:18]
        sizes = (8 * ghosts, (pellets + 7) // 8, 4 * counts[0], 8 * counts[1], 2 * counts[2])
        if kind != KIND or len(message) != _HEAD.size + sum(sizes):
            raise ValueError(f"kind {kind}, {len(message)} bytes for {_HEAD.size + sum(sizes)}")
        name = STATES[state]
    except (struct.error, IndexError, ValueError) as error:
        raise ValueError(f"no frame: {error}") from error
    parts = []
    at = _HEAD.size
    for size in sizes:
        parts.append(message[at : at + size])
        at += size
    poses = [values[18:21], values[21:24], values[26:29]]
    ring = values[14]
    scan = np.frombuffer(parts[4], "<u2") / 1000.0
    return Frame(
        state=name,
        revision=revision,
        number=number,
        time_s=values[7],
        speed=values[8],
        score=values[9],
        collected=values[10],
        spawned=values[11],
        round=values[12],
        goal=values[13],
        paused=bool(flags & PAUSED),
        stopped=bool(flags & STOPPED),
        over=bool(flags & OVER),
        true=poses[0] if flags & TRUE else None,
        believed=poses[1] if flags & BELIEVED else None,
        velocity=values[24:26],
        shadow=poses[2] if flags & SHADOW else None,
        shadow_collected=int(values[29]),
        ring=tuple(tuple(ring[k : k + 3]) for k in range(0, 18, 3)) if flags & RING else None,
        ghosts=np.frombuffer(parts[0], "<f4").reshape(-1, 2).astype(float),
        alive=np.unpackbits(np.frombuffer(parts[1], np.uint8), count=pellets, bitorder="little").astype(bool),
        scores=np.frombuffer(parts[2], "<f4").astype(float),
        plan=np.frombuffer(parts[3], "<f4").reshape(-1, 2).astype(float),
        scan=np.where(scan == 0.0, np.nan, scan),
    )
