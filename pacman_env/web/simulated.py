"""Game of the page in the simulator: a thread that plays a match and executes requests between ticks."""

import contextlib
import logging
import queue
import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from concurrent.futures import TimeoutError as Late
from typing import Any, Literal

from pacman_env.web import page_messages
from pacman_env.web.frame import Frame
from pacman_env.web.game_interface import News, Refused, Scene
from pacman_env.web.match import START_S, Match
from pacman_env.web.page_messages import Message
from pacman_env.web.rules import Choices, Rules

_LOG = logging.getLogger(__name__)
_PATIENCE_S = 300.0  # longest wait for an answer: kernels may have to be compiled
_LONG = (page_messages.Setup, page_messages.ClydeSpeed, page_messages.Compare)  # prepare a map, or play a round
_WHY_S = 0.25  # time between two messages with terms


class SimulatedGame:
    """A ``Game`` played by a thread. Raises ValueError for an unusable file, and Refused for unusable rules."""

    source: Literal["simulator", "ros"] = "simulator"

    def __init__(
        self,
        rules: Rules | None = None,
        *,
        maps: Sequence[str] = (),  # map files, in addition to the shipped maps
        policies: Sequence[str] = (),  # policies, in addition to the installed ones
        seed: int | None = None,  # seed of the first round, which decides later seeds; None: random
        speed: float = 1.0,  # relative to real time
        start_s: float = START_S,  # length of the show before each round, simulated
    ) -> None:
        choices, self._news = Choices(maps, policies), News()
        self._speed = speed
        self._lock = threading.RLock()  # protects the match and the attributes below
        self._match = Match(rules or Rules(), choices, seed, speed, self._news, self._lock, start_s)
        self.choices, self.add_map, self.news = choices.facts, choices.add_map, self._news.after
        self._why = False
        self._why_sent_s = 0.0
        self._orders: queue.SimpleQueue[tuple[Callable[[], Any], Future[Any], bool] | None] = queue.SimpleQueue()
        self._closed = False
        self._thread = threading.Thread(target=self._run, name="game", daemon=True)
        self._thread.start()

    def close(self) -> None:
        self._closed = True
        self._orders.put(None)
        self._thread.join(10.0)

    def scene(self) -> Scene:
        with self._lock:
            return self._match.scene

    def frame(self) -> Frame | None:
        with self._lock:
            return self._match.frame()

    def watch(self, *, why: bool, lidar: bool) -> None:
        with self._lock:
            self._why, self._match.lidar = why, lidar
            self._why_sent_s = 0.0

    def handle(self, person: str, message: Message) -> Any:
        if isinstance(message, page_messages.Drive):
            with self._lock:
                self._match.driving.steer(person, message.v, message.omega)
            return None
        if isinstance(message, page_messages.Why):  # a finished round is constant, so no tick has to wait
            return self._match.recordings.why(message.story, message.tick)
        return self._ask(lambda: self._do(person, message), waits=isinstance(message, _LONG))

    def story(self, number: int) -> bytes | None:
        return self._match.recordings.frames(number) if number else self._ask(self._match.demo, waits=True)

    def stop(self, person: str) -> None:
        self._hold(True, person)

    def release(self, person: str) -> None:
        self._hold(False, person)
        self._orders.put(None)

    def _hold(self, stopped: bool, person: str) -> None:
        with self._lock:
            if self._match.clock.stopped != stopped:
                self._match.clock.hold(stopped=stopped)
                if not stopped:
                    self._match.driving.hand = None
                self._news.add(words=f"{'stopped' if stopped else 'released'} by {person}")

    def reset_options(self) -> None:
        with self._lock:
            self._match.clock.set_speed(self._speed)
            self._match.feedback.armed = False

    def leave(self, person: str) -> None:
        with self._lock:
            self._match.driving.roles.leave(person)

    # The thread

    def _run(self) -> None:
        try:
            self._news.add(words="preparing the first round; on a new computer the rules are compiled once")
            try:
                self._match.compile_kernels()
                self._match.lay_out()
            except ValueError as refused:  # unusable rules of the command line
                self._news.add(words=str(refused))
            while not self._closed:
                self._do_order(self._wait_s())
                if not self._closed and self._wait_s() == 0.0:
                    self._match.tick()
                    self._send_why()
        except Exception:
            _LOG.exception("the simulated game has ended")
            self._news.add(words="internal error: the simulated game has ended; start the server again")
            self._closed = True

    def _wait_s(self) -> float | None:
        """Return the time until the next tick is due, s, or None if no tick is due."""
        game = self._match
        with self._lock:
            runs = game.round is not None and game.state != "menu" and not game.clock.is_held
            return max(0.0, game.clock.due_s - time.monotonic()) if runs else None

    def _send_why(self) -> None:
        with self._lock:
            real_s, played = time.monotonic(), self._match.round
            is_due = self._why and self._match.state == "running" and real_s - self._why_sent_s >= _WHY_S
            if is_due and played is not None:
                self._why_sent_s = real_s
                self._news.add(why=played.why_now())

    def _do_order(self, wait_s: float | None) -> None:
        order = None
        with contextlib.suppress(queue.Empty):
            order = self._orders.get(block=wait_s != 0.0, timeout=wait_s)
        if order is None:
            return
        what, answer, waits = order
        try:
            with contextlib.nullcontext() if waits else self._lock:
                answer.set_result(what())
        except Exception as error:
            answer.set_exception(error)

    def _ask(self, what: Callable[[], Any], waits: bool) -> Any:
        """Run ``what`` in the game's thread between two ticks, and return its result.

        With ``waits``, frames and STOP continue while it runs.
        """
        if self._closed:
            raise Refused("the simulated game has ended")
        answer: Future[Any] = Future()
        self._orders.put((what, answer, waits))
        try:
            return answer.result(_PATIENCE_S)
        except Late:
            raise Refused("the simulator is busy; try again") from None

    def _do(self, person: str, message: Message) -> Any:
        game = self._match
        match message:
            case page_messages.Start(same=same):
                game.start(same)
            case page_messages.Reset():
                game.reset()
            case page_messages.Pause(on=on):
                game.clock.hold(paused=on)
            case page_messages.Speed(times=times):
                game.clock.set_speed(times)
            case page_messages.Setup():
                return game.set_up(message)
            case page_messages.ClydeSpeed(mps=mps):
                game.set_clyde_speed(mps)
            case page_messages.PlaceClyde(x=x, y=y, ghost=ghost):
                game.place_ghost(ghost, x, y)
            case page_messages.Role(role=role):
                return {"words": game.assume_role(person, role)}
            case page_messages.Goal():
                game.driving.choose(person, message, game.require_round())
            case page_messages.Event(word=word, what=what):
                game.show(what, word)
            case page_messages.Arm(on=on):
                game.feedback.armed = on
            case page_messages.Compare(story=story):
                return game.recordings.compare(story)
            case page_messages.Stories():
                return game.recordings.summaries()
            case page_messages.Ready():
                return game.readiness()
            case _:
                raise Refused(f"{type(message).__name__}: not in the simulator")
        return None
