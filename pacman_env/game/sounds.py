"""Sounds as melodies, and the choice between several requested sounds (Algorithm 8)."""

from collections.abc import Mapping
from dataclasses import dataclass

Melody = tuple[tuple[int, float], ...]  # MIDI note and seconds

PATIENCE_S = 2.0  # a melody without a reported end is over this long after its duration
_DEBOUNCE_S = 0.1  # repeated words within this time count once


@dataclass(frozen=True)
class Sound:
    word: str
    melody: Melody
    importance: int  # 0: never waits for another sound to end

    @property
    def duration_s(self) -> float:
        return sum(seconds for _, seconds in self.melody)


def even(notes: tuple[int, ...], note_s: float, last_s: float) -> Melody:
    return (*((note, note_s) for note in notes[:-1]), (notes[-1], last_s))


def frequency_hz(midi_note: int) -> int:
    """Return 440 * 2 ** ((m - 69) / 12), rounded to Hz (Milestone 3, Algorithm 8)."""
    return round(440.0 * 2.0 ** ((midi_note - 69) / 12.0))


class SoundQueue:
    """Queue with one playing and at most one waiting melody; each method returns the word to play now, or None.

    While a melody plays, repetitions of its word and words without importance are ignored. Of other words the most
    important one waits, and the newest one if they are equally important. Times are in s.
    """

    def __init__(self, sounds: Mapping[str, Sound]) -> None:
        self._sounds = sounds
        self._playing: str | None = None
        self._waiting: str | None = None
        self._deadline_s = 0.0
        self._last: str | None = None  # the last played word
        self._begun_s = 0.0  # its start time

    def request(self, word: str, now: float) -> str | None:
        """Request a sound; raises ValueError if there is no such word."""
        if word not in self._sounds:
            raise ValueError(f"sound {word!r}: not one of {', '.join(sorted(self._sounds))}")
        if self._playing is None:
            if word == self._last and 0 <= now - self._begun_s < _DEBOUNCE_S:
                return None
            return self._begin(word, now)
        least = 1 if self._waiting is None else self._sounds[self._waiting].importance
        if word != self._playing and self._sounds[word].importance >= least:
            self._waiting = word
        return None

    def ended(self, now: float) -> str | None:
        """Note that the current melody has finished or could not be played."""
        self._playing = None
        word, self._waiting = self._waiting, None
        return None if word is None else self._begin(word, now)

    def overdue(self, now: float) -> bool:
        """Return True if, at the time ``now`` (s), the melody's end is overdue, or the clock was set back."""
        return self._playing is not None and not self._begun_s <= now < self._deadline_s

    def _begin(self, word: str, now: float) -> str:
        self._playing = word
        self._last, self._begun_s = word, now
        self._deadline_s = now + self._sounds[word].duration_s + PATIENCE_S
        return word
