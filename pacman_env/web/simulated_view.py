"""View of a simulated game: its scene, frames between ticks, lights, sounds and motions."""

import math
import time
from dataclasses import replace
from typing import Any

import cv2
import numpy as np
from msgspec import structs

from pacman_env.config import ShowConfig
from pacman_env.game.events import FEEDBACK, LIGHTS, SOUNDS, Motion, angular_velocity
from pacman_env.game.lights import LightRing
from pacman_env.game.sounds import SoundQueue
from pacman_env.web.frame import Frame, Pose
from pacman_env.web.game_interface import News, Scene
from pacman_env.web.played_round import PlayedRound
from pacman_env.web.rules import Rules
from pacman_env.web.vocabulary import scene_facts

_COMPILING = "Preparing the first round. On a new computer the rules are compiled once, which takes up to a minute."
NO_SCENE = Scene(1, {"map": None, "preparing": True, "notice": _COMPILING})

#: Fields that change at the start of a tick. The others change at its end: a pellet is shown until it is reached.
_EARLY = ("goal", "velocity", "ghost_goals", "scores", "plan")


class TickClock:
    """Ticks at ``speed`` times real time, held while the game is paused or stopped."""

    def __init__(self, speed: float) -> None:
        self.speed = speed
        self.tick_s = 0.5  # simulated time
        self.paused = self.stopped = False
        self._share = 0.0  # share of the tick that was over at the last change
        self._changed_s = time.monotonic()

    @property
    def is_held(self) -> bool:
        return self.paused or self.stopped

    @property
    def due_s(self) -> float:
        return self._changed_s + (1.0 - self._share) * self.tick_s / self.speed

    def share(self, real_s: float) -> float:
        """Return the share of the last tick that is over (0 to 1) at the real time ``real_s``."""
        ran_s = 0.0 if self.is_held else max(real_s - self._changed_s, 0.0)
        return min(self._share + ran_s * self.speed / self.tick_s, 1.0)

    def begin(self, due_s: float) -> None:
        """Start a tick: late ticks are skipped, and nothing of a paused tick is shown yet."""
        self._share, self._changed_s = 0.0, max(due_s, time.monotonic() - self.tick_s / self.speed)

    def set_speed(self, times: float) -> None:
        self._keep_share()
        self.speed = times

    def hold(self, *, paused: bool | None = None, stopped: bool | None = None) -> None:
        self._keep_share()
        self.paused = self.paused if paused is None else paused
        self.stopped = self.stopped if stopped is None else stopped

    def _keep_share(self) -> None:
        now = time.monotonic()
        self._share, self._changed_s = self.share(now), now


class FeedbackPlayer:
    """Play lights, sounds and motions by the robot's rules for one game, as news; times are real time, s."""

    def __init__(self, show: ShowConfig, news: News) -> None:
        self.armed = False
        self.turned = 0.0  # angle by which motions have turned the robot, rad
        self.ring = LightRing(LIGHTS, show)
        self._show, self._news = show, news
        self._sounds = SoundQueue(SOUNDS)
        self._sounds_until_s: float | None = None
        self._motion: Motion = "stop"
        self._motion_s = self._moved_s = 0.0

    def show(self, what: str, word: str, now: float) -> None:
        if what == "light":
            self.ring.command(word, now)
            self._news.add(light=word)
        elif what == "sound":
            self._play(self._sounds.request(word, now), now)
        else:
            answer = FEEDBACK[word]
            self._news.add(event=word)
            for kind, shown in (("light", answer.light), ("sound", answer.sound)):
                if shown is not None:
                    self.show(kind, shown.word, now)
            if answer.motion is not None:
                self._motion = answer.motion if self.armed else "stop"
                self._motion_s = self._moved_s = now

    def update(self, now: float) -> None:
        turn = angular_velocity(self._motion, now - self._motion_s, self._show)
        if turn is None or not self.armed:
            self._motion = "stop"
        else:
            self.turned += turn * (now - self._moved_s)
        self._moved_s = now
        if self._sounds_until_s is not None and now >= self._sounds_until_s:
            self._sounds_until_s = None
            self._play(self._sounds.ended(now), now)

    def _play(self, word: str | None, now: float) -> None:
        if word is not None:
            self._sounds_until_s = now + SOUNDS[word].duration_s
            self._news.add(sound=word)


def between(old: Frame, new: Frame, share: float) -> Frame:
    """Return a frame between two ticks; ``share`` 1 gives the frame of the later tick."""
    if share >= 1.0 or new.time_s < old.time_s:
        return new
    fields = {name: getattr(new, name) for name in _EARLY}
    for name in ("true", "believed", "baseline"):
        if (pose := getattr(new, name)) is not None:
            fields[name] = _pose_between(getattr(old, name) or pose, pose, share)
    for name in ("time_s", "ghosts"):
        fields[name] = getattr(old, name) + share * (getattr(new, name) - getattr(old, name))
    return structs.replace(old, **fields)


def _pose_between(old: Pose, new: Pose, share: float) -> Any:
    turned = math.remainder(new[2] - old[2], 2 * math.pi)
    return old[0] + share * (new[0] - old[0]), old[1] + share * (new[1] - old[1]), old[2] + share * turned


def scene_of(played: PlayedRound, rules: Rules, revision: int) -> Scene:
    assets, config, settings = played.assets, played.config, dict(rules.settings)
    xy, ids = assets.goal_xy.round(4).tolist(), assets.pellet_ids.tolist()
    power_pellets = np.flatnonzero(played.power_pellets).tolist()
    if power_pellets:  # the time is shorter in later rounds
        settings["power.duration_s"] = config.power.duration_s
    linked = replace(rules, level=rules.level if played.level is None else played.level, settings=settings)
    height, width = assets.occupancy.grey.shape
    facts = {
        **vars(rules),
        **scene_facts(config.value, xy, ids, power_pellets, dict(enumerate(rules.ghosts))),
        "map": {
            "name": rules.map,
            "resolution": assets.occupancy.resolution,
            "width": width,
            "height": height,
            "origin": list(assets.occupancy.origin),
        },
        "home": assets.grid.home.tolist(),
        "pellets": xy[: len(ids)],
        "seed": played.seed,
        "level": played.level,
        "clyde_speed_mps": config.clyde.speed_mps,
        "link": linked.link(played.seed, config.clyde.speed_mps),
        "preparing": False,
    }
    return Scene(revision, facts, cv2.imencode(".png", assets.occupancy.grey)[1].tobytes())
