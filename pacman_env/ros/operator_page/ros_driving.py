"""Manual driving of a robot, its motions at events, and the operator's stop.

A stop has three immediate effects: zero velocity, the end of all goals in Nav2, and the message that the nodes obey
until the release (``operator_stop.py``). The first two are repeated until then.
"""

import threading
from collections.abc import Collection
from typing import Any

from pacman_env.game.events import FEEDBACK, LIGHTS, SOUNDS
from pacman_env.ros import topics
from pacman_env.ros.message_conversion import twist_message
from pacman_env.ros.operator_page.page_node import PageNode
from pacman_env.ros.operator_stop import OperatorStop
from pacman_env.web.game_interface import Refused
from pacman_env.web.roles import DEAD_MAN_S, ROBOT, Roles

PERIOD_S = 0.05  # between frames, and between zero velocities while stopped; Nav2 publishes velocities as often
_ENDS = 5  # zero velocities at the end of a drive, because one may be lost
_CANCEL_AGAIN_S = 0.2  # between cancel requests while stopped: the base does not report its own motions
_LONGEST_SHOW_S = 30.0
_SHOWN: dict[str, tuple[Collection[str], topics.Topic]] = {  # by kind: allowed words, and topic
    "event": (FEEDBACK, topics.GAME_EVENT),
    "light": (LIGHTS, topics.GAME_LIGHT),
    "sound": (SOUNDS, topics.GAME_SOUND),
}


class RosDriving:
    """All means by which the page moves or stops the robot; stops and releases are added to the node's news.

    Velocities are published only while a person drives, and zero while the robot is stopped. The node's thread calls
    ``beat``; all other methods may be called in any thread.
    """

    def __init__(self, node: PageNode) -> None:
        self._node, self._news = node, node.news
        self._roles = Roles()
        self._armed: str | None = None  # the person who switched Armed on
        self._shows_until_s = 0.0  # latest end of a motion that an operator requested
        self._cancelled_s = 0.0
        self._driven: tuple[float, float, float] | None = None  # v (m/s), omega (rad/s) and start (s) of a drive
        self._zeros = 0  # zero velocities left to publish
        self._lock = threading.RLock()  # for velocities
        self._velocity = topics.CMD_VEL.publisher(node)
        names = (topics.NAVIGATE_TO_POSE.name, *topics.MOTIONS)
        self._cancellers = [topics.cancel_client(node, name) for name in names]
        self._publishers = {what: topic.publisher(node) for what, (_, topic) in _SHOWN.items()}
        self._stop = OperatorStop(node, self._on_stop)

    @property
    def stopped(self) -> bool:
        return self._stop.stopped

    def stop(self, person: str) -> None:
        """Stop the robot and forbid goals until the release."""
        try:
            self._halt()
        finally:  # even if that fails
            self._stop.request(True, person)

    def release(self, person: str) -> None:
        self._stop.request(False, person)

    def require_not_stopped(self) -> None:
        if self.stopped:
            raise Refused(f"stopped by {self._stop.who}: release it first")

    def stop_row(self) -> dict[str, str]:
        if obey := self._stop.obeyed_by:
            words = f"obeyed by {', '.join(obey)}{'; the robot is stopped now' if self.stopped else ''}"
            return {"name": "STOP", "state": "ok", "words": words, "remedy": ""}
        remedy = "start the game with pacman-env ros up; until then STOP cancels the goals of Nav2 and holds the wheels"
        return {"name": "STOP", "state": "bad", "words": "no node of the game obeys STOP", "remedy": remedy}

    def _on_stop(self, stopped: bool, by: str) -> None:
        self._news.add(words=f"{'stopped' if stopped else 'released'} by {by}")
        if stopped:
            self._halt()

    def _halt(self) -> None:
        """End a drive, command zero velocity, and cancel all goals in Nav2 and all motions of the base."""
        try:
            with self._lock:
                self._driven = None
                self._publish_velocity(0.0, 0.0)
        finally:
            self._cancelled_s = self._node.monotonic()
            for canceller in self._cancellers:
                if canceller.service_is_ready():
                    canceller.call_async(canceller.srv_type.Request())  # all zero: every goal

    def beat(self) -> None:
        """Publish what is due now; call this every ``PERIOD_S``."""
        now_s = self._node.monotonic()
        with self._lock:
            if self.stopped:
                self._zeros = 0
                self._publish_velocity(0.0, 0.0)
            elif self._driven is not None:
                v, omega, since_s = self._driven
                if now_s - since_s >= DEAD_MAN_S or self._node.game.state != "menu":  # then the game drives
                    self.end_drive()
                else:
                    self._publish_velocity(v, omega)
            elif self._zeros:
                self._zeros -= 1
                self._publish_velocity(0.0, 0.0)
        if self.stopped and now_s - self._cancelled_s >= _CANCEL_AGAIN_S:
            self._halt()

    def end_drive(self) -> None:
        with self._lock:
            if self._driven is not None:
                self._driven, self._zeros = None, _ENDS
                self._publish_velocity(0.0, 0.0)

    def _publish_velocity(self, v: float, omega: float) -> None:
        self._velocity.publish(twist_message(v, omega, self._node.get_clock().now().to_msg()))

    def leave(self, person: str) -> None:
        """End the person's drive, and disarm what the person armed."""
        if self._armed == person:
            self.arm(None)
        if self._roles.leave(person) is not None:
            self.end_drive()

    def assume(self, person: str, role: str) -> None:
        if role == "none":
            self.leave(person)
            return
        if role != ROBOT:
            raise Refused("on a robot the game moves the ghosts; a ghost can be played only in the simulator")
        self._roles.assume(person, role)

    def drive(self, person: str, v: float, omega: float, most: dict[str, Any]) -> None:
        """Drive at ``v`` (m/s) and ``omega`` (rad/s), capped at the limits ``most``, facts of the scene, for 0.5 s.

        Raises Refused if the person may not drive, or something else drives the robot.
        """
        self._roles.require(person, ROBOT)
        with self._lock:
            self.require_not_stopped()
            if self._node.game.state != "menu":
                raise Refused("the game drives the robot; to drive by hand, press Reset first")
            if self._node.robot.navigating:
                raise Refused("Nav2 drives to a goal of another program; press STOP to end that")
            fastest, turn = float(most.get("wheels_mps", 0.0)), float(most.get("turn_radps", 0.0))
            v, omega = min(max(v, -fastest), fastest), min(max(omega, -turn), turn)
            self._driven = v, omega, self._node.monotonic()
            self._publish_velocity(v, omega)

    def show(self, what: str, word: str) -> None:
        """Show a light, a sound, or an event.

        An event is sent to the game only if it moves the robot and a person has switched Armed on. Otherwise only the
        event's light and sound are shown. Raises Refused if the event would move a robot that drives or is stopped.
        """
        if word not in _SHOWN[what][0]:
            raise Refused(f"unknown {what} {word!r}")
        if what != "event":
            self._publish(what, word)
            return
        answer = FEEDBACK[word]
        if self._armed and answer.motion in ("spin", "shake"):
            self.require_not_stopped()
            if self._node.game.state != "menu" or self._driven or self._node.robot.navigating:
                raise Refused("the robot is driving: wait until it stands in the menu, or switch Armed off")
            self._shows_until_s = self._node.monotonic() + _LONGEST_SHOW_S
            self._publish("event", word)
            return
        self._news.add(event=word)
        for kind, shown in (("light", answer.light), ("sound", answer.sound)):
            if shown is not None:
                self._publish(kind, shown.word)

    def arm(self, by: str | None) -> None:
        """Let events move the robot for the person ``by``; None: events move the robot no longer."""
        self._armed = by
        if by is None and self._node.monotonic() < self._shows_until_s and self._node.game.state == "menu":
            self._publish("event", "reset")  # ends the motion
        self._shows_until_s = 0.0

    def _publish(self, what: str, word: str) -> None:
        self._publishers[what].publish(_SHOWN[what][1].type(data=word))
