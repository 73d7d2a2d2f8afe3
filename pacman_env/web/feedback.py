"""Lights, sounds and motions of events on the page of a simulated game: the robot's rules, without a robot."""

from __future__ import annotations

from pacman_env.config import ShowConfig
from pacman_env.game.events import FEEDBACK, Motion, angular_velocity
from pacman_env.game.lights import LASTING, LightRing, Ring
from pacman_env.game.sounds import SoundQueue, duration_s


class Feedback:
    """Of one game; times are s of a clock that goes as fast as the visitor's."""

    def __init__(self, show: ShowConfig) -> None:
        self.armed = False
        self.turned = 0.0  # rad, by motions
        self._show = show
        self._ring = LightRing(show)
        self._sounds = SoundQueue()
        self._sounds_until_s: float | None = None
        self._motion: Motion = "stop"
        self._motion_s = self._moved_s = 0.0

    def show(self, what: str, word: str, now: float) -> list[dict[str, str]]:
        """An ``event``, ``light`` or ``sound``; returns the news that follow.

        Raises:
            KeyError, ValueError: no such word.
        """
        if what == "light":
            self._ring.command(word, now)
            return [{"light": word}]
        if what == "sound":
            return self._play(self._sounds.request(word, now), now)
        answer = FEEDBACK[word]
        news = [{"event": word}]
        if answer.light is not None:
            news += self.show("light", answer.light, now)
        if answer.sound is not None:
            news += self.show("sound", answer.sound, now)
        if answer.motion is not None:
            self._motion = answer.motion if self.armed else "stop"
            self._motion_s = self._moved_s = now
        return news

    def state(self, state: str, now: float) -> None:
        """The game is in another state: the ring shows what it shows in it."""
        if state in LASTING:
            self._ring.command(LASTING[state], now)

    def _play(self, word: str | None, now: float) -> list[dict[str, str]]:
        if word is None:
            return []
        self._sounds_until_s = now + duration_s(word)
        return [{"sound": word}]

    def go_on(self, now: float) -> list[dict[str, str]]:
        """What is due: the sound that waited, the motion's turn."""
        turn = angular_velocity(self._motion, now - self._motion_s, self._show)
        if turn is None or not self.armed:
            self._motion = "stop"
        else:
            self.turned += turn * (now - self._moved_s)
        self._moved_s = now
        if self._sounds_until_s is not None and now >= self._sounds_until_s:
            self._sounds_until_s = None
            return self._play(self._sounds.ended(now), now)
        return []

    def ring(self, now: float) -> Ring | None:
        """What the six LEDs show."""
        return self._ring.ring(now)
