"""Lights, sounds and motions of events on the page of a simulated game: the robot's rules, without a robot."""

from __future__ import annotations

from pacman_env.config import ShowConfig
from pacman_env.game.dances import Motion, angular_velocity
from pacman_env.game.events import FEEDBACK
from pacman_env.game.lights import LASTING, LightRing
from pacman_env.game.sounds import SoundQueue, duration_s


class Feedback:
    """Of one game; times are real, s."""

    def __init__(self, show: ShowConfig) -> None:
        self.armed = False
        self.turned = 0.0  # rad, by motions
        self.ring = LightRing(show)
        self._show = show
        self._sounds = SoundQueue()
        self._sounds_until_s: float | None = None
        self._motion: Motion = "stop"
        self._motion_s = self._moved_s = 0.0

    def show(self, what: str, word: str, now: float) -> list[dict[str, str]]:
        """The news of an ``event``, ``light`` or ``sound``; KeyError or ValueError for an unknown word."""
        if what == "light":
            self.ring.command(word, now)
            return [{"light": word}]
        if what == "sound":
            return self._play(self._sounds.ask(word, now), now)
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

    def enter(self, state: str, now: float) -> None:
        """The game is in another state, which may have a lasting light."""
        if state in LASTING:
            self.ring.command(LASTING[state], now)

    def update(self, now: float) -> list[dict[str, str]]:
        """Do what is due; returns its news: a sound that has waited."""
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

    def _play(self, word: str | None, now: float) -> list[dict[str, str]]:
        if word is None:
            return []
        self._sounds_until_s = now + duration_s(word)
        return [{"sound": word}]
