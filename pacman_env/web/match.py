"""A simulated game with the phases of the robot's referee: menu, show, round, next round; and the people in it."""

import logging
import math
import threading
import time
from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import numpy as np
from msgspec import structs

from pacman_env import __version__
from pacman_env.game.events import killed_by
from pacman_env.game.ghosts import GHOST_NAMES
from pacman_env.game.lights import LASTING
from pacman_env.game.power import frightened_s
from pacman_env.game.round import Action, RoundController, begins_in_s, clyde_speed_mps
from pacman_env.web import page_messages
from pacman_env.web.driving import Driving
from pacman_env.web.frame import Frame
from pacman_env.web.game_interface import IN_PROGRESS, News, Refused
from pacman_env.web.orders import FOLLOW, Moves, Orders
from pacman_env.web.played_round import PlayedRound
from pacman_env.web.recordings import Recordings, encoded
from pacman_env.web.roles import ROBOT
from pacman_env.web.rules import Choices, Rules
from pacman_env.web.simulated_view import NO_SCENE, FeedbackPlayer, TickClock, between, scene_of

_LOG = logging.getLogger(__name__)
START_S = 2.0  # length of the start show; the robot's is longer
_HOME_S = 2.0  # real time for which the end of a round is shown
_STEPS = 64  # positions within a tick that frames distinguish
_THEME_S = 6.0  # below this length, a start show has a short melody, which does not cover sounds of the round
_LIVES = 3  # lives of a person who plays the robot
HARDEST = 3  # for a person who plays the robot, later levels are not harder
NO_MOVES = Moves()
_HIDDEN_TICKS = 6  # enough for a plan and the begin of goals


class Match:
    """A sequence of rounds. ``lock`` protects the shown state, but is released while a round is played or prepared."""

    def __init__(
        self,
        rules: Rules,
        choices: Choices,
        seed: int | None,
        speed: float,
        news: News,
        lock: threading.RLock,
        start_s: float = START_S,
    ) -> None:
        config = choices.prepare(rules, None)[0]
        show = replace(config.show, start_s=start_s)
        self.clock = TickClock(speed)
        self.driving = Driving()
        self.recordings = Recordings()
        self.feedback = FeedbackPlayer(show, news)
        self.scene = NO_SCENE
        self.lidar = False
        self.round: PlayedRound | None = None
        self._choices, self._rules, self._news, self._lock = choices, rules, news, lock
        self._seeds = np.random.default_rng(seed)
        self._next_seed: int | None = seed
        self._clock_s = 0.0  # simulated time, shows included
        self._home_due_s: float | None = None  # real time at which the robot is at home
        self._clyde_mps: float | None = None
        self._controller = RoundController(config.clyde, show, config.power)
        self._gained = 0  # points gained in the last tick
        self._lives = _LIVES
        self._level_score = 0  # score when the present round started
        self._retry: tuple[int, int] | None = None  # round and score if a person tries a level again
        self._shown: tuple[Frame, Frame] | None = None  # snapshots before and after the last tick
        self._demo: tuple[int, bytes | None] = 0, None  # last demo, with the revision of its scene
        self._number = 0  # number of the frame
        self._key: Any = None  # everything that decides the content of the frame; a change gives the frame a new number

    @property
    def state(self) -> str:
        return self._controller.state

    @property
    def _level(self) -> int:
        """Return the number that decides how fast ghosts are and how long they are frightened."""
        return min(self._controller.round, HARDEST) if self.driving.plays_robot else self._controller.round

    def frame(self) -> Frame | None:
        """Return the game at this moment, between its last two ticks; None before the first round."""
        played, real_s = self.round, time.monotonic()
        if played is None or self._shown is None:
            return None
        self.feedback.update(real_s)
        (before, now), clock, turned = self._shown, self.clock, self.feedback.turned
        share, runs = int(clock.share(real_s) * _STEPS) / _STEPS, self.state == "running"
        shown, sent = between(before, now, share), self.driving.sent(played)
        fields: dict[str, Any] = {
            "state": self.state,
            "revision": self.scene.revision,
            "speed": clock.speed,
            "score": self._controller.score - (self._gained if runs and shown is not now else 0),
            "round": self._controller.round,
            "paused": clock.paused,
            "stopped": clock.stopped,
            "ring": self.feedback.ring.ring(real_s),
        }
        if self.driving.plays_robot:
            fields["lives"] = self._lives
        left_s = begins_in_s(self._controller, self._clock_s - (1.0 - share) * clock.tick_s)
        if left_s is not None:
            fields["begins_in_s"] = round(min(left_s, self._controller.show.start_s), 2)
        key = (fields, share, before.time_s, now.time_s, turned, self.lidar, sent)
        if key != self._key:
            self._key = key
            self._number += 1
        moved: dict[str, Any] = {} if runs and not clock.is_held else {"velocity": (0.0, 0.0)}
        for name in ("true", "believed") if turned else ():
            x, y, heading = getattr(shown, name)
            moved[name] = x, y, heading + turned
        if self.lidar:
            moved["scan"] = played.lidar()
        moved["ghost_goals"] = played.ghost_goals(sent, shown.true)
        return structs.replace(shown, number=self._number, **fields, **moved)

    def _show_round(self, played: PlayedRound) -> None:
        self._shown = played.snapshots[-1], played.snapshots[-1]
        self._gained = 0
        self.scene = scene_of(played, self._rules, self.scene.revision + 1)

    def require_round(self) -> PlayedRound:
        if self.round is None:
            raise Refused("no round could be prepared; choose another map or other settings")
        return self.round

    def start(self, same: bool = False) -> None:
        """Start the prepared round, or the last round again (``same``); the show after a round ends at once."""
        played = self.require_round()
        if self.clock.stopped:
            raise Refused("stopped: press Release first")
        if self.state != "menu":
            if not played.over:
                raise Refused(IN_PROGRESS)
            self._act(self._controller.tick(math.inf))
            self._home_due_s = 0.0
            self._follow_clock()
        if same:
            self.lay_out(self.recordings.last_seed)
        self._level_score = self._controller.score
        self._act(self._controller.start(self._clock_s))
        self._follow_clock()

    def reset(self) -> None:
        self._act(self._controller.reset(self._clock_s))
        self._retry, self._lives = None, _LIVES
        self._to_menu()

    def set_clyde_speed(self, mps: float) -> None:
        self._clyde_mps = mps
        self._controller.base_clyde_speed(mps)
        if self.state == "menu":
            self.lay_out(self.round.seed if self.round is not None else None)

    def set_up(self, setup: page_messages.Setup) -> Any:
        rules = self._rules.changed(setup)
        clyde_mps = self._clyde_mps if setup.clyde_mps is None else setup.clyde_mps
        self._choices.prepare(rules, clyde_mps)
        self._rules, self._clyde_mps = rules, clyde_mps
        if setup.seed is not None:
            self._next_seed = setup.seed
            self._seeds = np.random.default_rng(setup.seed)
        self._retry, self._lives = None, _LIVES
        if (self.state, self._controller.round, self._controller.score) != ("menu", 1, 0):
            self._act(self._controller.reset(self._clock_s))
        moves = setup.moves or NO_MOVES
        self.lay_out(None, moves, setup.until)
        if not setup.finish:
            return None
        played = self.require_round()
        played.replay(moves)
        self._record(played)
        self.lay_out(played.seed)
        return {"story": self.recordings.count}

    def place_ghost(self, ghost: int, x: float, y: float) -> None:
        played = self.require_round()
        if self.state != "menu":
            raise Refused("Clyde can be placed only in the menu: press Reset first")
        if ghost >= len(self._rules.ghosts):
            raise Refused(f"there is no ghost {ghost}")
        played.place_ghost(ghost, x, y)
        self._show_round(played)

    def assume_role(self, person: str, role: str) -> str:
        if role == "none":
            self.driving.roles.leave(person)
            return ""
        if role == ROBOT and not self.driving.plays_robot:
            self._lives = _LIVES
        self.driving.assume(person, role, len(self._rules.ghosts))
        played = self.round
        if self.state == "menu" and played is not None and played.ticks == 0:
            self.lay_out(played.seed)
        ghosts = self.driving.roles.ghosts()
        waits = any(one == person and (played is None or k not in played.ghost_roles) for k, one in ghosts.items())
        return "yours from the next round on" if waits and self.state != "menu" else ""

    def show(self, what: str, word: str) -> None:
        try:
            self.feedback.show(what, word, time.monotonic())
        except (KeyError, ValueError) as error:
            raise Refused(f"unknown {what} {word!r}") from error

    def readiness(self) -> list[dict[str, str]]:
        if self.round is None:
            return [{"name": "round", "state": "bad", "words": "no round is prepared", "remedy": "choose another map"}]
        assets = self.round.assets
        words, check = f"{assets.occupancy.name}: {assets.pellets} pellets", "check the map: pacman-env map check"
        missing = len(assets.dropped_ids)
        map_row = ("warning", f"{words}, {missing} more cannot be reached", check) if missing else ("ok", words, "")
        rows = (
            ("simulator", "ok", f"pacman_env {__version__}", ""),
            ("map", *map_row),
            ("configuration", "ok", f"hash {self.round.config.hash}", ""),
        )
        return [dict(zip(("name", "state", "words", "remedy"), row, strict=True)) for row in rows]

    def lay_out(self, seed: int | None = None, moves: Moves = NO_MOVES, ticks: int = 0) -> None:
        """Prepare a new round in the menu, or the round of ``seed`` again. After Refused, the former round remains.

        The first ``ticks`` ticks are played with ``moves``.
        """
        level, speed = self._level, self._clyde_mps
        if level > 1:
            step_mps = self._controller.clyde.speed_step_mps
            speed = clyde_speed_mps(self._controller.base_speed_mps, step_mps, level)
        if seed is None:
            seed = self._next_seed if self._next_seed is not None else int(self._seeds.integers(2**53))
        ghost_roles = frozenset(k for k in self.driving.roles.ghosts() if k < len(self._rules.ghosts)) | moves.ghosts
        played = self._laid_out(speed, seed, ghost_roles)
        if self.driving.plays_robot or moves != NO_MOVES:
            played.play_second_policy()
        played.replay(moves, ticks)
        config = played.config
        with self._lock:
            self._next_seed = None
            faster_mps = (level - 1) * config.clyde.speed_step_mps if speed is not None else 0.0
            self._controller.base_clyde_speed(config.clyde.speed_mps - faster_mps)
            self._controller.clyde, self._controller.power = config.clyde, config.power
            ids, power = played.assets.pellet_ids, played.power_pellets
            self._controller.lay_out(ids[played.snapshots[-1].alive].tolist(), ids[power].tolist())
            self.round = played
            self.clock.tick_s = config.execution.tick_s
            self.driving.goals.clear()
            self.feedback.turned = 0.0
            self._show_round(played)

    def _laid_out(self, speed: float | None, seed: int, ghost_roles: frozenset[int] = frozenset()) -> PlayedRound:
        config, source, ghosts = self._choices.prepare(self._rules, speed)
        if config.power.pellets > 0:
            duration_s = frightened_s(config.power, self._level)
            config = config.with_fields(**{"power.duration_s": duration_s})
        try:
            return PlayedRound(config, source, ghosts, (self._rules.policy, self._rules.second), seed, ghost_roles)
        except ValueError as error:
            raise Refused(str(error)) from error

    def demo(self) -> bytes | None:
        """Return the frames of the prepared round as its policy plays it, or None without a round."""
        revision = self.scene.revision
        if self.round is not None and self._demo[0] != revision:
            played = self.round.unplayed((self._rules.policy,))
            played.finish()
            self._demo = revision, encoded(played, revision, self._controller.round)
        return self._demo[1]

    def compile_kernels(self) -> None:
        """Play some ticks of a hidden round, so that kernels are compiled now and not during a round."""
        played = self._laid_out(None, 0, frozenset([0]))
        for _ in range(_HIDDEN_TICKS):
            played.step(Orders())
        played.why_now()
        played.lidar()
        played.step(Orders(robot=True, velocity=(0.1, 0.0), ghosts={0: FOLLOW}))

    def tick(self) -> None:
        with self._lock:
            played = self.round
            if played is None or self.clock.is_held:
                return
            due_s = self.clock.due_s
            self._clock_s += played.config.execution.tick_s
            if self.state != "running":
                self.clock.begin(due_s)
                self._follow_clock()
                self._shown = played.snapshots[-1], played.snapshots[-1]  # nothing moves
                return
            orders = self.driving.orders(played)
        played.step(orders)  # without the lock, so that requests are answered meanwhile
        with self._lock:
            if played is self.round:
                self.clock.begin(due_s)
                before, now = played.snapshots[-2:]
                self._shown = before, now
                self._report(played, before, now)

    def _report(self, played: PlayedRound, before: Frame, now: Frame) -> None:
        ids, score, caught = played.assets.pellet_ids, self._controller.score, self._controller.ghosts_caught
        collected = np.flatnonzero(before.alive & ~now.alive)
        pellets = [f"pellet_collected:{int(ids[pellet])}" for pellet in collected]
        catches = [
            f"ghost_caught:{number}:{GHOST_NAMES[ghost]}" for number, ghost in enumerate(played.caught.new, caught + 1)
        ]
        for word in catches + pellets if played.caught_before_pellets else pellets + catches:
            self._act(self._controller.status(word, self._clock_s))
        self._gained = self._controller.score - score
        if not played.over:
            return
        self._record(played)
        if played.catcher is not None:
            self.show("event", killed_by(GHOST_NAMES[played.catcher]))
            if self.driving.plays_robot:
                self._lives -= 1
                if self._lives > 0:
                    self._retry = self._controller.round, self._level_score
            self._act(self._controller.status("death_detected", self._clock_s))
        elif self.state == "running":  # the time limit, which a robot's referee does not know
            self._news.add(words=f"the time is up after {now.time_s:g} s - Score: {self._controller.score}")
            self.reset()

    def _act(self, actions: Iterable[Action]) -> None:
        for action in actions:
            value = str(action.value)
            if action.kind == "ignored":
                _LOG.info("the referee: %s", value)
            elif action.kind == "event":
                is_short = value == "start theatrical" and self._controller.show.start_s < _THEME_S
                self.show("event", "start" if is_short else value)
            elif action.kind == "state":
                if value in LASTING:
                    self.feedback.ring.command(LASTING[value], time.monotonic())
                self._news.add(state=value)
            elif action.kind == "result" and action.value:
                self._news.add(words=value)
            elif action.kind == "command":
                self._home_due_s = None
                if value == "return_home":
                    over = self.round is not None and self.round.over
                    self._home_due_s = time.monotonic() + (_HOME_S if over else 0.0)

    def _follow_clock(self) -> None:
        """End shows by the clock, and put the robot at home at once, because nothing drives it there."""
        while True:
            state = self.state
            self._act(self._controller.tick(self._clock_s))
            due_s = self._home_due_s
            if due_s is not None and time.monotonic() >= due_s and self.state == "returning_home":
                self._home_due_s = None
                self._act(self._controller.status("home_reached", self._clock_s))
                if self.state == "menu":
                    self._to_menu()
            if self.state == state:
                return
            if self.state == "starting":
                self.clock.begin(time.monotonic())

    def _to_menu(self) -> None:
        self._home_due_s = None
        if self._retry is not None:
            self._controller.round, self._controller.score = self._retry
        elif self._lives == 0:
            self._lives = _LIVES
        self._retry = None
        try:
            self.lay_out()
        except Refused as refused:
            self._news.add(words=str(refused))

    def _record(self, played: PlayedRound) -> None:
        scene = self.scene
        words = self.recordings.keep(
            played,
            map=self._rules.map,
            hash=played.assets.occupancy.hash,
            configuration=played.config.hash,
            round=self._controller.round,
            revision=scene.revision,
            link=scene.facts["link"],
        )
        self._news.add(story=self.recordings.count, words=words)
