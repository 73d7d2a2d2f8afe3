"""Keep the last rounds of the page: their frames, summaries and links."""

from typing import Any

import numpy as np
from msgspec import UNSET
from msgspec.structs import replace

from pacman_env.web.frame import encode_all
from pacman_env.web.game_interface import Refused
from pacman_env.web.played_round import PlayedRound

_KEPT = 10


def encoded(played: PlayedRound, revision: int, round: int) -> bytes:
    """Return the frames of a round as a JSON list."""
    return encode_all([replace(frame, revision=revision, round=round) for frame in played.snapshots])


class Recordings:
    """The last rounds with their summaries, by number."""

    def __init__(self) -> None:
        self.count = 0  # number of all rounds
        self.last_seed: int | None = None  # of the last round
        self._kept: dict[int, tuple[PlayedRound, dict[str, Any]]] = {}

    def keep(self, played: PlayedRound, **facts: Any) -> str:
        """Store a round with its summary and ``facts``, and return a description of the round in words.

        The summary has the fields of an entry of ``stories`` (docs/dev/web_protocol.md). Only the last rounds are kept.
        """
        self.count, self.last_seed = self.count + 1, played.seed
        choices = np.array(played.choices).reshape(-1, 3)
        differ = choices[:, 1] != choices[:, 2]
        last, baseline = played.snapshots[-1], played.baseline if played.by_person else None
        second = baseline.finish() if baseline else None
        self._kept.pop(self.count - _KEPT, None)
        summary = {
            "story": self.count,
            "result": played.end.word,
            "seed": played.seed,
            "collected": last.collected,
            "spawned": last.spawned,
            "time_s": round(last.time_s, 2),
            "ticks": played.ticks,
            "parts": np.flatnonzero(differ & ~np.concatenate([[False], differ[:-1]])).tolist(),
            "worse": played.worse,
            "moves": played.moves,
            "decisions": np.flatnonzero(np.diff(choices[:, 0], prepend=-1)).tolist(),
            "player": "person" if played.by_person else "policy",
            "ghosts_played": sorted(played.ghost_roles),
            "catcher": played.catcher,
            "policies": list(played.names),
            "second": second,
            **facts,
        }
        if last.ghosts_caught is not UNSET:
            summary["ghosts_caught"] = last.ghosts_caught
        self._kept[self.count] = played, summary
        words = f"{played.end.name}: {last.collected} of {last.spawned} pellets in {round(last.time_s, 2):g} s"
        if baseline and second:
            words += f"; {played.names[0]} {baseline.end.name}, {second['collected']} in {second['time_s']:g} s"
        return words

    def summaries(self) -> list[dict[str, Any]]:
        return [summary for _, summary in reversed(self._kept.values())]

    def frames(self, number: int) -> bytes | None:
        entry = self._kept.get(number)
        if entry is None:
            return None
        played, summary = entry
        return encoded(played, summary["revision"], summary["round"])

    def compare(self, number: int) -> dict[str, Any] | None:
        """Return the second policy's result in a round of policies, or None if people influenced the round."""
        played, summary = self._require(number)
        if "compared" not in summary:
            people = played.by_person or played.moves.placed or played.ghost_roles
            alone = people or len(played.names) < 2
            summary["compared"] = None if alone else played.unplayed(played.names[1:]).finish()
        return summary["compared"]

    def _require(self, number: int) -> tuple[PlayedRound, dict[str, Any]]:
        if number not in self._kept:
            raise Refused(f"round {number} is no longer stored")
        return self._kept[number]

    def why(self, number: int, tick: int) -> dict[str, Any]:
        played, _ = self._require(number)
        if tick > played.ticks:
            raise Refused(f"tick {tick}: the round has {played.ticks}")
        return played.why(tick)
