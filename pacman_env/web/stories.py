"""Rounds that have ended, kept to be looked at: their frames, the terms at each tick, what is told of them."""

from __future__ import annotations

import collections
from typing import Any

import numpy as np

from pacman_env.web.frame import encode_all
from pacman_env.web.game import Refused
from pacman_env.web.played_round import PlayedRound

_KEPT = 10


class Stories:
    """The last ten, by number from 1."""

    def __init__(self) -> None:
        self.count = 0  # so far, those that are not kept any more included
        self._kept: collections.OrderedDict[int, tuple[PlayedRound, dict[str, Any]]] = collections.OrderedDict()

    def keep(self, played: PlayedRound, facts: dict[str, Any]) -> dict[str, Any]:
        """One more; returns what is told of it (docs/web_protocol.md), with ``facts`` of the game."""
        self.count += 1
        choices = np.array(played.choices).reshape(-1, 3)
        parts = choices[:, 1] != choices[:, 2]
        last = played.snapshots[-1]
        told = {
            "story": self.count,
            "result": played.outcome,
            "seed": played.seed,
            "collected": last.collected,
            "spawned": len(last.alive),
            "time_s": round(last.time_s, 2),
            "ticks": played.ticks,
            "parts": np.flatnonzero(parts & ~np.concatenate([[False], parts[:-1]])).tolist(),
            "decisions": np.flatnonzero(np.diff(choices[:, 0], prepend=-1)).tolist(),
            "player": "person" if played.by_person else "policy",
            "policies": list(played.names),
            "second": played.baseline_result() if played.by_person else None,
            **facts,
        }
        self._kept[self.count] = played, told
        while len(self._kept) > _KEPT:
            self._kept.popitem(last=False)
        return told

    def all(self) -> list[dict[str, Any]]:
        """What is told of each, the newest first."""
        return [told for _, told in reversed(self._kept.values())]

    def frames(self, number: int) -> bytes | None:
        """Of each tick, as a JSON list; None: not kept."""
        if number not in self._kept:
            return None
        played, told = self._kept[number]
        fields = {name: told[name] for name in ("revision", "spawned", "round")}
        return encode_all([played.frame(tick, fields) for tick in range(played.ticks + 1)])

    def why(self, number: int, tick: int) -> dict[str, Any]:
        """The terms of the candidates at a tick.

        Raises:
            Refused: there is no such story or tick.
        """
        if number not in self._kept:
            raise Refused(f"story {number}: not kept")
        played, _ = self._kept[number]
        try:
            return played.why(tick)
        except IndexError:
            raise Refused(f"tick {tick}: the round has {played.ticks}") from None


def in_words(told: dict[str, Any]) -> str:
    """One line of a round that has ended."""
    what = f"{told['result']}: {told['collected']} of {told['spawned']} pellets in {told['time_s']:g} s"
    other = told["second"]
    if other is None:
        return what
    return f"{what}; {told['policies'][0]} {other['result']}, {other['collected']} in {other['time_s']:g} s"
