"""Rounds that have ended, kept to be replayed: their summaries, frames and the terms at each tick."""

from __future__ import annotations

from typing import Any

import numpy as np
from msgspec.structs import replace

from pacman_env.web.frame import encode_all
from pacman_env.web.game import Refused
from pacman_env.web.played_round import PlayedRound

_KEPT = 10


class Recordings:
    """The last ten rounds, by number from 1."""

    def __init__(self) -> None:
        self.count = 0  # in all
        self._kept: dict[int, tuple[PlayedRound, dict[str, Any]]] = {}

    def keep(self, played: PlayedRound, facts: dict[str, Any]) -> dict[str, Any]:
        """One more; returns its summary (docs/web_protocol.md, "stories"), with ``facts`` of the game."""
        self.count += 1
        choices = np.array(played.choices).reshape(-1, 3)
        differ = choices[:, 1] != choices[:, 2]
        last = played.snapshots[-1]
        summary = {
            "story": self.count,
            "result": played.outcome,
            "seed": played.seed,
            "collected": last.collected,
            "spawned": last.spawned,
            "time_s": round(last.time_s, 2),
            "ticks": played.ticks,
            "parts": np.flatnonzero(differ & ~np.concatenate([[False], differ[:-1]])).tolist(),
            "decisions": np.flatnonzero(np.diff(choices[:, 0], prepend=-1)).tolist(),
            "player": "person" if played.by_person else "policy",
            "policies": list(played.names),
            "second": played.baseline_result() if played.by_person else None,
            **facts,
        }
        self._kept[self.count] = played, summary
        self._kept.pop(self.count - _KEPT, None)
        return summary

    def summaries(self) -> list[dict[str, Any]]:
        return [summary for _, summary in reversed(self._kept.values())]

    def frames(self, number: int) -> bytes | None:
        if number not in self._kept:
            return None
        played, summary = self._kept[number]
        fields = {name: summary[name] for name in ("revision", "round")}
        return encode_all([replace(snapshot, **fields) for snapshot in played.snapshots])

    def why(self, number: int, tick: int) -> dict[str, Any]:
        if number not in self._kept:
            raise Refused(f"story {number}: not kept")
        played, _ = self._kept[number]
        if tick > played.ticks:
            raise Refused(f"tick {tick}: the round has {played.ticks}")
        return played.why(tick)


def in_words(summary: dict[str, Any]) -> str:
    what = f"{summary['result']}: {summary['collected']} of {summary['spawned']} pellets in {summary['time_s']:g} s"
    other = summary["second"]
    if other is None:
        return what
    return f"{what}; {summary['policies'][0]} {other['result']}, {other['collected']} in {other['time_s']:g} s"
