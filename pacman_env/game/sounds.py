"""Algorithm 8: the melodies, and which of them is played when several are asked for.

Time is an argument. Which event asks for which sound is decided in ``events``; how notes get to the robot is not here.
"""

from __future__ import annotations

from dataclasses import dataclass, field

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

#: What may be left out while something else sounds; everything else waits for its turn.
_PASSING = frozenset({"pellet"})
_IMPORTANCE = {"pellet": 0, "power pellet": 1, "ghost": 1, "start": 2, "pacman_theme": 2, "win": 3, "death": 3}


def frequency_hz(midi_note: int) -> int:
    """440 * 2 ** ((m - 69) / 12), in whole Hz (Milestone 3, Algorithm 8)."""
    return round(440.0 * 2.0 ** ((midi_note - 69) / 12.0))


def duration_s(word: str) -> float:
    """How long a melody sounds."""
    return sum(seconds for _, seconds in MELODIES[word])


@dataclass
class SoundQueue:
    """One melody sounds, at most one waits; each method returns the word to play now, or None.

    While one sounds, the same word again and a pellet are left out; of the others the more important one waits, the
    newer of equals. A melody whose end is never reported is over ``patience_s`` after its time.
    """

    debounce_s: float = 0.1  # the same word again within this time counts once
    patience_s: float = 2.0

    _playing: str | None = field(default=None, init=False)
    _waiting: str | None = field(default=None, init=False)
    _deadline_s: float = field(default=0.0, init=False)
    _last: str | None = field(default=None, init=False)  # the last word begun
    _begun_s: float = field(default=0.0, init=False)  # and when

    def ask(self, word: str, now: float) -> str | None:
        """A sound is wanted.

        Raises:
            ValueError: it is none of ``MELODIES``.
        """
        if word not in MELODIES:
            raise ValueError(f"sound {word!r}: not one of {', '.join(sorted(MELODIES))}")
        if self._playing is None:
            if word == self._last and 0 <= now - self._begun_s < self.debounce_s:
                return None
            return self._begin(word, now)
        least = 0 if self._waiting is None else _IMPORTANCE[self._waiting]
        if word != self._playing and word not in _PASSING and _IMPORTANCE[word] >= least:
            self._waiting = word
        return None

    def ended(self, now: float) -> str | None:
        """What sounded is over, or could not be played."""
        self._playing = None
        word, self._waiting = self._waiting, None
        return None if word is None else self._begin(word, now)

    def overdue(self, now: float) -> bool:
        """Whether the end of what sounds should have been reported; ``ended`` is then the time-out.

        A clock that was set back counts too: the deadline would otherwise be far away.
        """
        return self._playing is not None and not self._begun_s <= now < self._deadline_s

    def _begin(self, word: str, now: float) -> str:
        self._playing = word
        self._last, self._begun_s = word, now
        self._deadline_s = now + duration_s(word) + self.patience_s
        return word
