"""The simulator's side of the page: a game in a thread, as the referee's rules have it, at any speed."""

from __future__ import annotations

import contextlib
import logging
import queue
import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from concurrent.futures import TimeoutError as Late
from typing import Any, Literal

import numpy as np

from pacman_env import __version__
from pacman_env.config import Config
from pacman_env.game.ghosts import GHOST_NAMES
from pacman_env.game.round import Action, RoundController
from pacman_env.web import messages
from pacman_env.web.feedback import Feedback
from pacman_env.web.frame import Frame
from pacman_env.web.game import Refused, Scene
from pacman_env.web.messages import Message
from pacman_env.web.news import News
from pacman_env.web.played_round import Look, Orders, PlayedRound, between
from pacman_env.web.rules import Choices, Rules
from pacman_env.web.scenes import PREPARING, link_to, scene_of
from pacman_env.web.stories import Stories, in_words
from pacman_env.web.vocabulary import vocabulary

_LOG = logging.getLogger(__name__)
_HAND_S = 0.5  # after so long without a velocity the robot stands (Create 3)
_PATIENCE_S = 300.0  # for an answer: kernels may have to be compiled
_STEPS = 64  # of a tick that frames tell apart
_HOME_S = 2.0  # real time after a round, in which its end is looked at
_REHEARSED = 6  # ticks: the planner plans, goals begin
_LONG = (messages.Setup, messages.ClydeSpeed)  # a map may have to be prepared
_WHY_S = 0.25  # between two tellings of the terms


class SimulatedGame:
    """A :class:`~pacman_env.web.game.Game` that a thread plays."""

    source: Literal["simulator", "ros"] = "simulator"

    def __init__(
        self,
        rules: Rules | None = None,
        *,
        maps: Sequence[str] = (),
        policies: Sequence[str] = (),
        seed: int | None = None,
        speed: float = 1.0,
    ) -> None:
        """Begin to prepare the first round.

        Args:
            rules: to begin with.
            maps: files of maps that can be chosen beside those that ship.
            policies: files of policies, likewise.
            seed: of the first round; those of the others follow from it. None: drawn.
            speed: times real time.

        Raises:
            MapError, ValueError: a file that cannot be used.
            Refused: rules that cannot be chosen.
        """
        self._choices = Choices(maps, policies)
        self._rules = rules or Rules()
        self._choices.check(self._rules)
        self._lock = threading.RLock()  # of what follows
        self._seeds = np.random.default_rng(seed)
        self._next_seed: int | None = seed
        self._speed, self._paused, self._stopped = speed, False, False
        self._round: PlayedRound | None = None
        self._scene = PREPARING
        self._before: Look | None = None
        self._now: Look | None = None
        self._tick_began_s = time.monotonic()
        self._stood_s: float | None = None  # the time at which it was held
        self._ticks, self._changes = 0, 0
        self._last_key: Any = None
        self._news = News()
        self._stories = Stories()
        self._why, self._lidar = False, False
        self._why_told_s = 0.0
        self._seats: dict[str, str] = {}  # person by seat
        self._goals: dict[str, int | None] = {}  # by seat
        self._hand: tuple[float, float, float] | None = None  # v, omega, when
        self._clock_s = 0.0  # simulated, shows included
        self._home_due_s: float | None = None  # real time
        self._clyde_mps: float | None = None
        self._controller = RoundController(self._config().clyde)
        self._feedback = Feedback(self._config().show)
        self._orders: queue.SimpleQueue[tuple[Callable[[], Any], Future[Any], bool] | None] = queue.SimpleQueue()
        self._closed = False
        self._thread = threading.Thread(target=self._run, name="game", daemon=True)
        self._thread.start()

    # What the server asks

    def close(self) -> None:
        """End the thread."""
        self._closed = True
        self._orders.put(None)
        self._thread.join(10.0)

    def hello(self) -> dict[str, Any]:
        """Choices, words, melodies."""
        return {"version": __version__, "choices": self._choices.facts(), **vocabulary()}

    def scene(self) -> Scene:
        """The scene now."""
        with self._lock:
            return self._scene

    def frame(self) -> Frame | None:
        """How it stands now, on the way from tick to tick."""
        real_s = time.monotonic()
        with self._lock:
            if self._now is None or self._round is None:
                return None
            share = int(self._share(real_s) * _STEPS) / _STEPS
            self._tell(self._feedback.go_on(real_s))
            ring = self._feedback.ring(real_s)
            key = (self._ticks, share, ring, self._feedback.turned, self._paused, self._stopped)
            if key != self._last_key:
                self._last_key = key
                self._changes += 1
            return self._framed(share, ring)

    def _framed(self, share: float, ring: Any) -> Frame:
        old, new, controller = self._before or self._now, self._now, self._controller
        assert old is not None
        assert new is not None
        assert self._round is not None
        fields = between(old, new, share)
        stands = self._paused or self._stopped or controller.state != "running"
        if stands:
            fields["velocity"] = (0.0, 0.0)
        if self._feedback.turned:
            fields |= {
                name: (*fields[name][:2], fields[name][2] + self._feedback.turned) for name in ("true", "believed")
            }
        return Frame(
            state=controller.state,
            revision=self._scene.revision,
            number=self._changes,
            speed=self._speed,
            score=controller.score - (new.collected - fields["collected"] if controller.state == "running" else 0),
            spawned=len(new.alive),
            round=controller.round,
            paused=self._paused,
            stopped=self._stopped,
            over=self._round.over,
            ring=ring,
            scan=self._round.lidar() if self._lidar else np.zeros(0),
            **fields,
        )

    def news(self, after: int) -> list[dict[str, Any]]:
        """What has happened since."""
        return self._news.after(after)

    def watched(self, *, why: bool, lidar: bool) -> None:
        """Whether anybody looks at them."""
        with self._lock:
            if self._lidar != lidar:
                self._changed()
            self._why, self._lidar = why, lidar
            self._why_told_s = 0.0

    def tell(self, person: str, message: Message) -> Any:
        """See :meth:`pacman_env.web.game.Game.tell`."""
        if isinstance(message, messages.Drive):  # at once: the newest counts
            self._require_seat(person, "robot")
            with self._lock:
                self._hand = (message.v, message.omega, time.monotonic())
            return None
        if isinstance(message, messages.Why):  # nothing of a round that has ended changes: the game goes on meanwhile
            return self._stories.why(message.story, message.tick)
        return self._ask(lambda: self._obey(person, message), waits=isinstance(message, _LONG))

    def stop(self, person: str) -> None:
        """Time stands still, and with it the robot."""
        with self._lock:
            if not self._stopped:
                self._stopped = True
                self._hold_time()
                self._tell([{"words": f"stopped by {person}"}])

    def release(self, person: str) -> None:
        """Time goes on."""
        with self._lock:
            if self._stopped:
                self._stopped = False
                self._hand = None
                self._go_on()
                self._tell([{"words": f"released by {person}"}])
        self._orders.put(None)

    def left(self, person: str) -> None:
        """His seats are free."""
        with self._lock:
            for seat in [seat for seat, who in self._seats.items() if who == person]:
                self._free(seat)

    def add_map(self, name: str, yaml: str, image: bytes) -> dict[str, Any]:
        """A map of somebody's own."""
        return self._choices.add_map(name, yaml, image)

    def story(self, number: int) -> bytes | None:
        """The frames of a round that has ended."""
        return self._stories.frames(number)

    # The thread

    def _run(self) -> None:
        try:
            self._tell([{"words": "preparing the first round; its rules are compiled if they have not been before"}])
            try:
                self._rehearse()
                self._lay_out()
            except ValueError as refused:  # of the command line: nobody else has chosen yet
                self._tell([{"words": str(refused)}])
            while not self._closed:
                self._take_order(self._wait_s())
                if not self._closed and self._wait_s() == 0.0:
                    self._tick()
        except Exception:
            _LOG.exception("the simulated game has ended")
            self._tell([{"words": "internal error: the simulated game has ended; start the server again"}])
            self._closed = True

    def _wait_s(self) -> float | None:
        """How long until the next tick is due; None: none is."""
        with self._lock:
            state = self._controller.state
            if self._paused or self._stopped or state == "menu" or self._round is None:
                return None
            return max(0.0, self._tick_began_s + self._tick_s - time.monotonic())

    @property
    def _tick_s(self) -> float:
        """Real time of a tick."""
        return self._round_config.execution.tick_s / self._speed

    def _take_order(self, wait_s: float | None) -> None:
        try:
            order = self._orders.get(timeout=wait_s) if wait_s is None or wait_s > 0 else self._orders.get_nowait()
        except queue.Empty:
            return
        if order is None:
            return
        what, answer, waits = order
        try:
            with contextlib.nullcontext() if waits else self._lock:
                result = what()
            answer.set_result(result)
        except Exception as error:
            answer.set_exception(error)

    def _ask(self, what: Callable[[], Any], waits: bool = False) -> Any:
        """Have the thread do something between two ticks; ``waits``: it may take long, frames and STOP go on."""
        if self._closed:
            raise Refused("the simulated game has ended")
        answer: Future[Any] = Future()
        self._orders.put((what, answer, waits))
        try:
            return answer.result(_PATIENCE_S)
        except Late:
            raise Refused("the simulator is busy; try again") from None

    def _share(self, real_s: float) -> float:
        """How much of the last tick is shown."""
        at_s = real_s if self._stood_s is None else self._stood_s
        return min(max((at_s - self._tick_began_s) / self._tick_s, 0.0), 1.0)

    def _hold_time(self) -> None:
        if self._stood_s is None:
            self._stood_s = time.monotonic()
        self._changed()

    def _go_on(self) -> None:
        if self._stood_s is not None and not (self._paused or self._stopped):
            self._tick_began_s += time.monotonic() - self._stood_s
            self._stood_s = None
        self._changed()

    def _changed(self) -> None:
        """Another frame is due."""
        self._ticks += 1

    def _tell(self, news: Sequence[dict[str, Any]]) -> None:
        for one in news:
            self._news.add(**one)

    # What people ask, in the thread

    def _obey(self, person: str, message: Message) -> Any:
        match message:
            case messages.Start():
                self._require_round()
                if self._stopped:
                    raise Refused("stopped: release first")
                self._act(self._controller.start(self._clock_s), refuse=True)
                self._follow_clock()
            case messages.Reset():
                self._act(self._controller.reset(self._clock_s))
                self._to_menu()
            case messages.Pause(on=on):
                self._paused = on
                if on:
                    self._hold_time()
                else:
                    self._go_on()
            case messages.Speed(times=times):
                share = self._share(time.monotonic())
                self._speed = times
                self._tick_began_s = (self._stood_s or time.monotonic()) - share * self._tick_s
                self._changed()
            case messages.Setup():
                return self._set_up(message)
            case messages.ClydeSpeed(mps=mps):
                self._clyde_mps = mps
                self._controller.base_clyde_speed(mps)
                if self._controller.state == "menu":
                    self._lay_out(self._round.seed if self._round is not None else None)
            case messages.PlaceClyde(x=x, y=y, ghost=ghost):
                self._place(ghost, x, y)
            case messages.Seat(who=who):
                return self._sit(person, who)
            case messages.Goal():
                self._choose(person, message)
            case messages.Event(word=word, what=what):
                try:
                    self._tell(self._feedback.show(what, word, time.monotonic()))
                except (KeyError, ValueError) as error:
                    raise Refused(f"{what} {word!r}: there is none") from error
            case messages.Arm(on=on):
                self._feedback.armed = on
            case messages.Stories():
                return self._stories.all()
            case messages.Ready():
                return self._ready()
            case _:
                raise Refused(f"{type(message).__name__}: not in the simulator")
        return None

    def _require_round(self) -> PlayedRound:
        if self._round is None:
            raise Refused("no round could be laid out; choose another map or other settings")
        return self._round

    def _require_seat(self, person: str, seat: str) -> None:
        if self._seats.get(seat) != person:
            raise Refused(f"the seat {seat} is not yours")

    def _set_up(self, setup: messages.Setup) -> Any:
        rules = self._rules.changed(setup)
        clyde_mps = self._clyde_mps if setup.clyde_mps is None else setup.clyde_mps
        self._choices.prepare(rules, clyde_mps)
        if self._seats.get("robot") is not None and setup.finish:
            raise Refused("somebody plays the robot: a round to be finished is played by a policy")
        self._rules, self._clyde_mps = rules, clyde_mps
        if setup.seed is not None:
            self._next_seed = setup.seed
            self._seeds = np.random.default_rng(setup.seed)
        if (self._controller.state, self._controller.round, self._controller.score) != ("menu", 1, 0):
            self._act(self._controller.reset(self._clock_s))
        self._lay_out()
        if setup.finish:
            return self._finish()
        return None

    def _finish(self) -> dict[str, int]:
        """Play the round to its end as fast as can be; returns its story's number."""
        played = self._require_round()
        while not played.over:
            played.step(Orders())
        self._keep_story(played)
        self._lay_out(played.seed)
        return {"story": self._stories.count}

    def _place(self, ghost: int, x: float, y: float) -> None:
        played = self._require_round()
        if self._controller.state != "menu":
            raise Refused("Clyde is placed in the menu, before a round")
        if ghost >= len(self._rules.ghosts):
            raise Refused(f"there is no ghost {ghost}")
        played.place_ghost(ghost, x, y)
        self._show(played)
        self._set_scene()

    def _sit(self, person: str, who: str) -> dict[str, Any]:
        if who == "none":
            self.left(person)
            return {"words": ""}
        if who.startswith("ghost-") and int(who[-1]) >= len(self._rules.ghosts):
            raise Refused(f"{who}: there are {len(self._rules.ghosts)} ghosts")
        if self._seats.get(who) not in (None, person):
            raise Refused(f"the seat {who} is taken")
        self._seats[who] = person
        self._goals[who] = None
        in_menu = self._controller.state == "menu"
        if in_menu and self._round is not None and self._round.ticks == 0:
            self._lay_out(self._round.seed)
        now = in_menu or (who == "robot") or (self._round is not None and int(who[-1]) in self._round.seats)
        return {"words": "" if now else "yours from the next round on"}

    def _free(self, seat: str) -> None:
        self._seats.pop(seat, None)
        self._goals.pop(seat, None)
        if seat == "robot":
            self._hand = None

    def _choose(self, person: str, goal: messages.Goal) -> None:
        seats = [seat for seat, who in self._seats.items() if who == person]
        if not seats:
            raise Refused("take a seat first")
        played = self._require_round()
        candidate = goal.candidate
        if candidate is None:
            if goal.x is None or goal.y is None:
                raise Refused("goal: give a candidate, or x and y")
            candidate = played.nearest(goal.x, goal.y)
            if candidate is None:
                raise Refused("no pellet or refuge within 1 m")
        elif candidate > played.hold:
            raise Refused(f"candidate {candidate}: there are 0 to {played.hold}")
        for seat in seats:
            self._goals[seat] = None if candidate in (-1, played.hold) else candidate
        if "robot" in seats:
            self._hand = None

    def _ready(self) -> list[dict[str, str]]:
        played = self._round
        if played is None:
            return [{"name": "round", "state": "bad", "words": "none is laid out", "cure": "choose another map"}]
        dropped = len(played.assets.dropped_ids)
        return [
            {"name": "simulator", "state": "ok", "words": f"pacman_env {__version__}", "cure": ""},
            {
                "name": "map",
                "state": "warning" if dropped else "ok",
                "words": f"{played.assets.occupancy.name}: {played.assets.pellets} pellets"
                + (f", {dropped} more cannot be reached" if dropped else ""),
                "cure": "look at the map: pacman-env map check" if dropped else "",
            },
            {"name": "configuration", "state": "ok", "words": f"hash {played.config.hash}", "cure": ""},
        ]

    # The round

    def _config(self) -> Config:
        return self._choices.prepare(self._rules, self._clyde_mps)[0]

    @property
    def _round_config(self) -> Config:
        assert self._round is not None
        return self._round.config

    def _lay_out(self, seed: int | None = None) -> None:
        """A new round in the menu; ``seed``: the same once more.

        Raises:
            Refused: it cannot be played; the round before is still there.
        """
        speed = self._controller.clyde_speed if self._controller.round > 1 else self._clyde_mps
        config, source, ghosts = self._choices.prepare(self._rules, speed)
        if seed is None:
            seed = self._next_seed if self._next_seed is not None else int(self._seeds.integers(2**53))
        seats = frozenset(int(seat[-1]) for seat in self._seats if seat.startswith("ghost-"))
        try:
            played = PlayedRound(
                config,
                source,
                ghosts,
                (self._rules.policy, self._rules.second),
                seed,
                frozenset(k for k in seats if k < len(self._rules.ghosts)),
            )
        except ValueError as error:
            raise Refused(str(error)) from error
        if "robot" in self._seats:
            played.play_beside()
        with self._lock:
            self._next_seed = None
            self._controller.base_clyde_speed(config.clyde.speed_mps if speed is None else self._base_mps(config))
            self._round = played
            self._goals = dict.fromkeys(self._goals)
            self._feedback.turned = 0.0
            self._show(played)
            self._set_scene()

    def _rehearse(self) -> None:
        """Some ticks of a round that nobody sees: what has to be compiled is compiled now, not while one is played."""
        config, source, ghosts = self._choices.prepare(self._rules, None)
        played = PlayedRound(config, source, ghosts, (self._rules.policy, self._rules.second), 0)
        for _ in range(_REHEARSED):
            played.step(Orders())
        played.why_now()
        played.lidar()
        played.step(Orders(robot=True, velocity=(0.1, 0.0)))

    def _base_mps(self, config: Config) -> float:
        """Clyde's speed of round 1, of a configuration that has that of this round."""
        return config.clyde.speed_mps - (self._controller.round - 1) * config.clyde.speed_step_mps

    def _show(self, played: PlayedRound) -> None:
        self._before = self._now = played.looks[-1]
        self._changed()

    def _set_scene(self) -> None:
        self._scene = scene_of(self._require_round(), self._rules, self._scene.revision % 65535 + 1)

    def _tick(self) -> None:
        """The next tick of the clock, of the round too where one is played."""
        with self._lock:
            if self._paused or self._stopped or self._round is None:
                return
            began_s = self._tick_began_s + self._tick_s
            self._clock_s += self._round_config.execution.tick_s
            controller, played = self._controller, self._round
            if controller.state == "running":
                orders = self._orders_now()
            else:
                self._tick_began_s = self._not_long_ago(began_s)
                self._follow_clock()
                self._before = self._now
                self._changed()
                return
        played.step(orders)  # people are heard and frames are made meanwhile
        with self._lock:
            if played is not self._round:
                return
            self._tick_began_s = self._not_long_ago(began_s)
            before, now = played.looks[-2], played.looks[-1]
            self._before, self._now = before, now
            self._changed()
            self._report(played, before, now)
            real_s = time.monotonic()
            if self._why and real_s - self._why_told_s >= _WHY_S:
                self._why_told_s = real_s
                self._tell([{"why": played.why_now()}])

    def _not_long_ago(self, began_s: float) -> float:
        """The beginning of a tick: late, time is not made good; held, nothing of it is shown yet."""
        return max(began_s, time.monotonic() - self._tick_s, self._stood_s or 0.0)

    def _orders_now(self) -> Orders:
        orders = Orders(robot="robot" in self._seats, goal=self._goals.get("robot"))
        if orders.robot and self._hand is not None:
            v, omega, at_s = self._hand
            orders.velocity = (v, omega) if time.monotonic() - at_s < _HAND_S else (0.0, 0.0)
        assert self._round is not None
        for k in self._round.seats:
            if f"ghost-{k}" in self._seats:
                orders.ghosts[k] = self._goals.get(f"ghost-{k}")
        return orders

    def _report(self, played: PlayedRound, before: Look, now: Look) -> None:
        """Tell the referee what the tick brought, as the robot's goal selector does."""
        ids = played.assets.pellet_ids
        for pellet in np.flatnonzero(before.alive & ~now.alive).tolist():
            self._act(self._controller.status(f"pellet_collected:{int(ids[pellet])}", self._clock_s))
        if not played.over:
            return
        self._keep_story(played)
        if played.outcome == "caught":
            self._show_event(f"{GHOST_NAMES[max(played.catcher, 0)]} killed")
            self._act(self._controller.status("death_detected", self._clock_s))
        elif self._controller.state == "running":  # the time limit: the referee on a robot has none
            self._tell([{"words": f"the time is up after {now.time_s:g} s - Score: {self._controller.score}"}])
            self._act(self._controller.reset(self._clock_s))
            self._to_menu()

    def _show_event(self, word: str) -> None:
        self._tell(self._feedback.show("event", word, time.monotonic()))

    def _act(self, actions: Sequence[Action], refuse: bool = False) -> None:
        """Do what the referee wants done."""
        for action in actions:
            if action.kind == "ignored":
                if refuse:
                    raise Refused(str(action.value))
                _LOG.info("the referee: %s", action.value)
            elif action.kind == "event":
                self._show_event(str(action.value))
            elif action.kind == "state":
                self._feedback.state(str(action.value), time.monotonic())
                self._tell([{"state": str(action.value)}])
            elif action.kind == "result" and action.value:
                self._tell([{"words": str(action.value)}])
            elif action.kind == "command":
                self._home_due_s = None
                if action.value == "return_home":
                    played = self._round
                    self._home_due_s = time.monotonic() + (_HOME_S if played is not None and played.over else 0.0)
        self._changed()

    def _follow_clock(self) -> None:
        """Shows end by the clock, and the robot is home at once: nobody drives it there."""
        while True:
            state = self._controller.state
            self._act(self._controller.tick(self._clock_s))
            due_s = self._home_due_s
            if due_s is not None and time.monotonic() >= due_s and self._controller.state == "returning_home":
                self._home_due_s = None
                self._act(self._controller.status("home_reached", self._clock_s))
                if self._controller.state == "menu":
                    self._to_menu()
            if self._controller.state == state:
                return
            if self._controller.state == "running":
                self._begin_round()
            elif self._controller.state == "starting":
                self._tick_began_s = time.monotonic()

    def _begin_round(self) -> None:
        assert self._round is not None
        ids = [int(number) for number in self._round.assets.pellet_ids]
        for _ in range(2):  # what two reports show is of this round
            self._act(self._controller.pellets_left(ids, self._clock_s))

    def _to_menu(self) -> None:
        """Another round is laid out."""
        self._home_due_s = None
        try:
            self._lay_out()
        except Refused as refused:
            self._tell([{"words": str(refused)}])

    def _keep_story(self, played: PlayedRound) -> None:
        facts = {
            "map": self._rules.map,
            "round": self._controller.round,
            "revision": self._scene.revision,
            "link": link_to(played, self._rules),
        }
        told = self._stories.keep(played, facts)
        self._tell([{"story": told["story"], "words": in_words(told)}])
