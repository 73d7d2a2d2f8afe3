"""What is shown of a simulated game: its scene, and frames on the way from tick to tick."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import cv2
from msgspec import structs

from pacman_env.game.round import RoundController
from pacman_env.web.control import ghost_role
from pacman_env.web.feedback import Feedback
from pacman_env.web.frame import Frame, Pose
from pacman_env.web.game import Scene
from pacman_env.web.played_round import PlayedRound
from pacman_env.web.rules import Rules
from pacman_env.web.tick_clock import TickClock

_STEPS = 64  # of a tick that frames distinguish
_COMPILING = "Preparing the first round. On a new computer the rules are compiled once, which takes a minute or two."


class SimulatedView:
    def __init__(self, clock: TickClock, feedback: Feedback) -> None:
        self.scene = Scene(1, {"map": None, "preparing": True, "notice": _COMPILING})
        self.lidar = False
        self._clock, self._feedback = clock, feedback
        self._before: Frame | None = None
        self._now: Frame | None = None
        self._number = 0
        self._key: Any = None

    def show(self, before: Frame | None, now: Frame | None) -> None:
        self._before, self._now = before, now

    def stay(self) -> None:
        """A tick in which nothing moves."""
        self._before = self._now

    def show_round(self, played: PlayedRound, rules: Rules) -> None:
        """Another round, or one whose ghosts were placed."""
        self.show(played.snapshots[-1], played.snapshots[-1])
        self.scene = scene_of(played, rules, self.scene.next_revision())

    def frame(self, played: PlayedRound | None, controller: RoundController, real_s: float) -> Frame | None:
        """The game at a moment of real time; None: no round is laid out yet."""
        if self._now is None or self._before is None or played is None:
            return None
        clock, feedback, before, now = self._clock, self._feedback, self._before, self._now
        share, runs = int(clock.share(real_s) * _STEPS) / _STEPS, controller.state == "running"
        shown = between(before, now, share)
        fields: dict[str, Any] = {
            "state": controller.state,
            "revision": self.scene.revision,
            "speed": clock.speed,
            "score": controller.score - (now.collected - shown.collected if runs else 0),
            "round": controller.round,
            "paused": clock.paused,
            "stopped": clock.stopped,
            "ring": feedback.ring.ring(real_s),
        }
        key = (fields, share, before.time_s, now.time_s, feedback.turned, self.lidar)
        if key != self._key:
            self._key = key
            self._number += 1
        moved: dict[str, Any] = {} if runs and not clock.is_held else {"velocity": (0.0, 0.0)}
        for name in ("true", "believed") if feedback.turned else ():
            x, y, heading = getattr(shown, name)
            moved[name] = x, y, heading + feedback.turned
        if self.lidar:
            moved["scan"] = played.lidar()
        return structs.replace(shown, number=self._number, **fields, **moved)


def between(old: Frame, new: Frame, share: float) -> Frame:
    """A frame on the way from one tick to the next; 1: there."""
    if share >= 1.0 or new.time_s < old.time_s:
        return new
    moved = {
        name: _pose_between(getattr(old, name) or pose, pose, share)
        for name in ("true", "believed", "baseline")
        if (pose := getattr(new, name)) is not None
    }
    if old.ghosts.shape == new.ghosts.shape:
        moved["ghosts"] = old.ghosts + share * (new.ghosts - old.ghosts)
    return structs.replace(
        new,
        time_s=old.time_s + share * (new.time_s - old.time_s),
        alive=old.alive,  # a pellet is there until it is reached
        collected=old.collected,
        baseline_collected=old.baseline_collected,
        over=old.over,
        **moved,
    )


def _pose_between(old: Pose, new: Pose, share: float) -> Any:
    turned = math.remainder(new[2] - old[2], 2 * math.pi)
    return old[0] + share * (new[0] - old[0]), old[1] + share * (new[1] - old[1]), old[2] + share * turned


def scene_of(played: PlayedRound, rules: Rules, revision: int) -> Scene:
    occupancy, config = played.assets.occupancy, played.config
    xy = played.assets.goal_xy.round(4).tolist()
    pellets = played.assets.pellets
    facts = {
        "map": {
            "name": rules.map,
            "resolution": occupancy.resolution,
            "width": occupancy.grey.shape[1],
            "height": occupancy.grey.shape[0],
            "origin": list(occupancy.origin),
        },
        "home": played.assets.grid.home.tolist(),
        "pellets": xy[:pellets],
        "refuges": xy[pellets:],
        "candidates": xy,
        "first_refuge": pellets,
        "ghosts": [
            {"role": ghost_role(k), "behaviour": behaviour, "catch_m": config.execution.death_radius_m}
            for k, behaviour in enumerate(rules.ghosts)
        ],
        "robot": {"radius_m": config.robot.radius_m, "speed_mps": config.robot.speed_mps},
        "wheels_mps": config.robot.wheel_speed_mps,
        "turn_radps": config.robot.omega_radps,
        "policy": rules.policy,
        "second": rules.second,
        "preset": rules.preset,
        "seed": played.seed,
        "level": played.level,
        "settings": dict(rules.settings),
        "clyde_speed_mps": config.clyde.speed_mps,
        "link": link_to(played, rules),
        "preparing": False,
    }
    return Scene(revision, facts, cv2.imencode(".png", occupancy.grey)[1].tobytes())


def link_to(played: PlayedRound, rules: Rules) -> str:
    """The link to a round; empty where names and numbers alone do not reproduce it."""
    if played.placed or played.by_person or played.ghost_roles:
        return ""
    named = rules if played.level is None else replace(rules, level=played.level)
    return named.link(played.seed, played.config.clyde.speed_mps)
