"""Manual driving of a robot, its motions at events, and the operator's stop.

A stop has three immediate effects: zero velocity from a thread with no other task (``Wheels``), the end of all goals in
Nav2, and the message that the nodes obey until the release (``operator_stop.py``).
"""

import threading
import time
from collections.abc import Callable, Collection
from typing import Any

from pacman_env.game.events import FEEDBACK, LIGHTS, SOUNDS
from pacman_env.ros import topics
from pacman_env.ros.message_conversion import twist_message
from pacman_env.ros.operator_page.page_node import PageNode
from pacman_env.ros.operator_stop import OperatorStop
from pacman_env.web.game_interface import News, Refused
from pacman_env.web.roles import DEAD_MAN_S, ROBOT, Roles

PERIOD_S = 0.05  # between zero velocities while stopped; Nav2 publishes velocities as often
_ENDS = 5  # zero velocities at the end of a drive, because one may be lost
_CANCEL_AGAIN_S = 0.2  # between cancel requests while stopped, if a goal runs
_CANCEL_UNSEEN_S = 0.5  # and if no goal is visible: the base does not report its own motions
_LONGEST_SHOW_S = 30.0
_SHOWN: dict[str, tuple[Collection[str], topics.Topic]] = {  # by kind: allowed words, and topic
    "event": (FEEDBACK, topics.GAME_EVENT),
    "light": (LIGHTS, topics.GAME_LIGHT),
    "sound": (SOUNDS, topics.GAME_SOUND),
}


class Wheels:
    """Publisher of velocities while a person drives, and of zero while the robot is stopped; no other messages."""

    def __init__(
        self,
        publish: Callable[[float, float], None],  # v (m/s) and omega (rad/s), from any thread
        monotonic: Callable[[], float] = time.monotonic,
        own_thread: bool = True,  # False: no thread; the caller calls ``beat`` every ``PERIOD_S``
    ) -> None:
        self._publish, self._monotonic = publish, monotonic
        self.driven: tuple[float, float, float] | None = None  # v (m/s), omega (rad/s) and start (s) of a drive by hand
        self._lock = threading.RLock()
        self._stopped = False
        self._zeros = 0  # zero velocities left to publish
        self._closed = threading.Event()
        self._thread = threading.Thread(target=self._run, name="wheels", daemon=True)
        if own_thread:
            self._thread.start()

    def stop(self) -> None:
        """End a drive and publish zero velocity now and repeatedly until ``release``."""
        with self._lock:
            self._stopped, self.driven = True, None
            self._publish(0.0, 0.0)

    def release(self) -> None:
        with self._lock:
            self._stopped = False

    def drive(self, v: float, omega: float) -> bool:
        """Drive at ``v`` (m/s) and ``omega`` (rad/s) for at most 0.5 s; return False if the robot is stopped."""
        with self._lock:
            if self._stopped or self._closed.is_set():
                return False
            self.driven = v, omega, self._monotonic()
            self._publish(v, omega)
        return True

    def end_drive(self) -> None:
        with self._lock:
            if self.driven is not None:
                self.driven, self._zeros = None, _ENDS
                self._publish(0.0, 0.0)

    def close(self) -> None:
        """End a drive by hand, and publish nothing afterwards."""
        with self._lock:
            self.end_drive()
            self._closed.set()
        if self._thread.is_alive():
            self._thread.join()

    def _run(self) -> None:
        while not self._closed.wait(PERIOD_S):
            self.beat()

    def beat(self) -> None:
        with self._lock:
            if self._closed.is_set():
                return
            if self._stopped:
                self._zeros = 0
                self._publish(0.0, 0.0)
            elif self.driven is not None:
                v, omega, since_s = self.driven
                if self._monotonic() - since_s >= DEAD_MAN_S:
                    self.end_drive()
                else:
                    self._publish(v, omega)
            elif self._zeros:
                self._zeros -= 1
                self._publish(0.0, 0.0)


class RosDriving:
    """All means by which the page moves or stops the robot; stops and releases are added to ``news``."""

    def __init__(self, node: PageNode, news: News) -> None:
        self._node, self._news = node, news
        self._surroundings = node.surroundings
        self.roles = Roles()
        self._armed: str | None = None  # the person who switched Armed on
        self._shows_until_s = 0.0  # latest end of a motion that an operator requested
        self._cancelled_s = 0.0
        self._velocity = topics.CMD_VEL.publisher(node)
        lock_step = self._surroundings.lock_step
        self.wheels = Wheels(self._publish_velocity, self._surroundings.monotonic, own_thread=not lock_step)
        if lock_step:
            node.create_timer(PERIOD_S, self.wheels.beat, clock=self._surroundings.clock())
        names = (topics.NAVIGATE_TO_POSE.name, *topics.MOTIONS)
        self._cancellers = [topics.cancel_client(node, name) for name in names]
        self._publishers = {what: topic.publisher(node) for what, (_, topic) in _SHOWN.items()}
        self._stop = OperatorStop(node, self._on_stop)

    @property
    def stopped(self) -> bool:
        return self._stop.stopped

    def stop(self, person: str) -> None:
        """Stop the robot and forbid goals until the release; may be called in any thread."""
        try:
            self.wheels.stop()
        finally:  # do all three even if one fails
            try:
                self._stop.request(True, person)
            finally:
                self._cancel_goals()

    def release(self, person: str) -> None:
        self._stop.request(False, person)

    def keep_stopped(self) -> None:
        again_s = _CANCEL_AGAIN_S if self._node.robot.navigating else _CANCEL_UNSEEN_S
        if self.stopped and self._surroundings.monotonic() - self._cancelled_s >= again_s:
            self._cancel_goals()

    def require_not_stopped(self) -> None:
        if self.stopped:
            raise Refused(f"stopped by {self._stop.who}: release it first")

    def stop_row(self) -> dict[str, str]:
        obey = self._stop.obeyed_by if self._stop.known else []
        if obey:
            words = f"obeyed by {', '.join(obey)}{'; the robot is stopped now' if self._stop.stopped else ''}"
            return {"name": "STOP", "state": "ok", "words": words, "remedy": ""}
        remedy = "start the game with pacman-env ros up; until then STOP cancels the goals of Nav2 and holds the wheels"
        return {"name": "STOP", "state": "bad", "words": "no node of the game obeys STOP", "remedy": remedy}

    def _on_stop(self, stopped: bool, by: str) -> None:
        self._news.add(words=f"{'stopped' if stopped else 'released'} by {by}")
        if stopped:
            self.wheels.stop()
            self._cancel_goals()
        else:
            self.wheels.release()

    def _cancel_goals(self) -> None:
        """Cancel all goals in Nav2 and all motions of the base, whichever program sent them."""
        self._cancelled_s = self._surroundings.monotonic()
        for canceller in self._cancellers:
            if canceller.service_is_ready():
                canceller.call_async(canceller.srv_type.Request())  # all zero: every goal

    def _publish_velocity(self, v: float, omega: float) -> None:
        self._velocity.publish(twist_message(v, omega, self._node.get_clock().now().to_msg()))

    def leave(self, person: str) -> None:
        """End the person's drive, and disarm what the person armed."""
        if self._armed == person:
            self.arm(None)
        if self.roles.leave(person) is not None:
            self.wheels.end_drive()

    def assume(self, person: str, role: str) -> None:
        if role == "none":
            self.leave(person)
            return
        if role != ROBOT:
            raise Refused("on a robot the game moves the ghosts; a ghost can be played only in the simulator")
        if self.roles.people.get(role, person) != person:
            raise Refused("another person drives the robot")
        self.roles.assume(person, role)

    def drive(self, v: float, omega: float, most: dict[str, Any]) -> None:
        """Drive by hand at ``v`` (m/s) and ``omega`` (rad/s), capped at the limits ``most``, facts of the scene.

        Raises Refused if something else drives the robot.
        """
        if self._node.game.state != "menu":
            raise Refused("the game drives the robot; to drive by hand, press Reset first")
        if self._node.robot.navigating:
            raise Refused("Nav2 drives to a goal of another program; press STOP to end that")
        fastest, turn = float(most.get("wheels_mps", 0.0)), float(most.get("turn_radps", 0.0))
        if not self.wheels.drive(min(max(v, -fastest), fastest), min(max(omega, -turn), turn)):
            self.require_not_stopped()

    def show(self, what: str, word: str) -> None:
        """Show a light, a sound, or an event.

        An event is sent to the game only if it moves the robot and a person has switched Armed on. Otherwise only the
        event's light and sound are shown. Raises Refused if the event would move a robot that drives or is stopped.
        """
        if what != "event":
            self._publish(what, word)
            return
        answer = FEEDBACK[word]
        if self._armed and answer.motion in ("spin", "shake"):
            self.require_not_stopped()
            if self._node.game.state != "menu" or self.wheels.driven or self._node.robot.navigating:
                raise Refused("the robot is driving: wait until it stands in the menu, or switch Armed off")
            self._shows_until_s = self._surroundings.monotonic() + _LONGEST_SHOW_S
            self._publish("event", word)
            return
        self._news.add(event=word)
        if answer.light is not None:
            self._publish("light", answer.light.word)
        if answer.sound is not None:
            self._publish("sound", answer.sound.word)

    def arm(self, by: str | None) -> None:
        """Let events move the robot for the person ``by``; None: events move the robot no longer."""
        self._armed = by
        if by is None and self._surroundings.monotonic() < self._shows_until_s and self._node.game.state == "menu":
            self._publish("event", "reset")  # ends the motion
        self._shows_until_s = 0.0

    def _publish(self, what: str, word: str) -> None:
        self._publishers[what].publish(_SHOWN[what][1].type(data=word))


def require_word(what: str, word: str) -> None:
    if word not in _SHOWN[what][0]:
        raise Refused(f"unknown {what} {word!r}")
