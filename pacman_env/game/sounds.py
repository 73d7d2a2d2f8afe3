"""Algorithm 8: the melodies, and which of them is played when several are requested."""

from __future__ import annotations

Melody = tuple[tuple[int, float], ...]  # MIDI note and seconds


def _even(notes: tuple[int, ...], note_s: float, last_s: float) -> Melody:
    return (*((note, note_s) for note in notes[:-1]), (notes[-1], last_s))


#: By sound word. The theme is as long as the recorded one, 29 notes in 6.4 s; the tunes are the project's own.
MELODIES: dict[str, Melody] = {
    "start": _even((60, 64, 67, 72, 67, 72), 0.12, 0.30),
    "pacman_theme": (
        *_even((69, 76, 73, 81, 76, 73, 69), 0.20, 0.40),
        *_even((71, 78, 74, 83, 78, 74, 71), 0.20, 0.40),
        *_even((69, 76, 73, 81, 76, 73, 69), 0.20, 0.40),
        *_even((68, 71, 74, 76, 80, 83, 80, 81), 0.15, 0.55),
    ),
    "pellet": ((79, 0.07), (84, 0.07)),
    "power pellet": _even((64, 70, 76, 70, 76, 82), 0.10, 0.20),
    "ghost": _even((84, 79, 88, 83, 91), 0.08, 0.20),
    "death": _even((76, 75, 74, 73, 72, 70, 68, 65, 60, 48), 0.14, 0.50),
    "win": _even((67, 72, 76, 79, 76, 79, 84), 0.14, 0.60),
}

PATIENCE_S = 2.0  # a melody whose end is not reported is over so long after its time
_DEBOUNCE_S = 0.1  # the same word again within this time counts once
_IMPORTANCE = {"pellet": 0, "power pellet": 1, "ghost": 1, "start": 2, "pacman_theme": 2, "win": 3, "death": 3}


def frequency_hz(midi_note: int) -> int:
    """440 * 2 ** ((m - 69) / 12), in whole Hz (Milestone 3, Algorithm 8)."""
    return round(440.0 * 2.0 ** ((midi_note - 69) / 12.0))


def duration_s(word: str) -> float:
    return sum(seconds for _, seconds in MELODIES[word])


class SoundQueue:
    """One melody sounds, at most one waits; each method returns the word to play now, or None.

    While one sounds, the same word again and a pellet are left out; of the others the more important one waits, the
    newer of equals.
    """

    def __init__(self) -> None:
        self._playing: str | None = None
        self._waiting: str | None = None
        self._deadline_s = 0.0
        self._last: str | None = None  # the last word begun
        self._begun_s = 0.0  # and when

    def request(self, word: str, now: float) -> str | None:
        """Raises ValueError unless the word is one of ``MELODIES``."""
        if word not in MELODIES:
            raise ValueError(f"sound {word!r}: not one of {', '.join(sorted(MELODIES))}")
        if self._playing is None:
            if word == self._last and 0 <= now - self._begun_s < _DEBOUNCE_S:
                return None
            return self._begin(word, now)
        least = 0 if self._waiting is None else _IMPORTANCE[self._waiting]
        if word != self._playing and word != "pellet" and _IMPORTANCE[word] >= least:
            self._waiting = word
        return None

    def ended(self, now: float) -> str | None:
        """The melody is over, or could not be played."""
        self._playing = None
        word, self._waiting = self._waiting, None
        return None if word is None else self._begin(word, now)

    def overdue(self, now: float) -> bool:
        """Whether the end of the melody should have been reported, or the clock was set back."""
        return self._playing is not None and not self._begun_s <= now < self._deadline_s

    def _begin(self, word: str, now: float) -> str:
        self._playing = word
        self._last, self._begun_s = word, now
        self._deadline_s = now + duration_s(word) + PATIENCE_S
        return word
