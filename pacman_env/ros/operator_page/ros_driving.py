"""Who drives a robot by hand, what moves it at events, and the operator's stop.

A stop goes three ways at once: zero velocity from a thread that does nothing else (``wheels.py``), the end of every
goal that Nav2 pursues, and the message that the nodes obey until the release (``operator_stop.py``).
"""

from __future__ import annotations

from typing import Any

from pacman_env.game.events import FEEDBACK
from pacman_env.game.lights import LIGHTS
from pacman_env.game.sounds import MELODIES
from pacman_env.ros import topics
from pacman_env.ros.messages import twist_message
from pacman_env.ros.operator_page.page_node import PageNode
from pacman_env.ros.operator_page.wheels import PERIOD_S, Wheels
from pacman_env.ros.operator_stop import OperatorStop
from pacman_env.web.game import Refused
from pacman_env.web.news import News
from pacman_env.web.roles import ROBOT, Roles

_CANCEL_AGAIN_S = 0.2  # while stopped and a goal still runs
_CANCEL_UNSEEN_S = 0.5  # while stopped and none is seen: nobody publishes the base's own motions
_LONGEST_SHOW_S = 30.0


class RosDriving:
    """Everything by which the page moves the robot, or holds it.

    Args:
        node: publishes.
        news: stops and releases are added to it.
    """

    def __init__(self, node: PageNode, news: News) -> None:
        self._node, self._news = node, news
        self._surroundings = node.surroundings
        self._roles = Roles()
        self._armed: str | None = None  # by whom
        self._shows_until_s = 0.0  # a motion that an operator has asked for
        self._cancelled_s = 0.0
        self._velocity = topics.CMD_VEL.publisher(node)
        lock_step = self._surroundings.lock_step
        self._wheels = Wheels(self._publish_velocity, self._surroundings.monotonic, own_thread=not lock_step)
        if lock_step:
            node.create_timer(PERIOD_S, self._wheels.beat, clock=self._surroundings.clock())
        self._cancellers = [
            topics.NAVIGATE_TO_POSE.cancel_client(node),
            *(topics.motion_canceller(node, name) for name in topics.MOTIONS),
        ]
        shown = (topics.GAME_EVENT, topics.GAME_LIGHT, topics.GAME_SOUND)
        self._publishers = {topic.name: topic.publisher(node) for topic in shown}
        self._stop = OperatorStop(node, self._on_stop)

    def close(self) -> None:
        """What was driven by hand stands."""
        self._wheels.close()

    # Stop

    @property
    def stopped(self) -> bool:
        """Whether the robot is to stand until the release."""
        return self._stop.stopped

    def stop(self, person: str) -> None:
        """Zero velocity, no goal, and no other until the release; from any thread."""
        try:
            self._wheels.stop()
        finally:  # each way for itself, whatever becomes of the others
            try:
                self._stop.request(True, person)
            finally:
                self._cancel_goals()

    def release(self, person: str) -> None:
        """The game goes on where it stands."""
        self._stop.request(False, person)

    def keep_stopped(self) -> None:
        """While stopped, end goals again and again."""
        again_s = _CANCEL_AGAIN_S if self._node.robot.navigating else _CANCEL_UNSEEN_S
        if self.stopped and self._surroundings.monotonic() - self._cancelled_s >= again_s:
            self._cancel_goals()

    def require_not_stopped(self) -> None:
        """Raise Refused while the robot is stopped."""
        if self.stopped:
            raise Refused(f"stopped by {self._stop.who}: release it first")

    def stop_row(self) -> dict[str, str]:
        """Who obeys a stop, as one row of the readiness list."""
        obey = self._stop.obeyed_by if self._stop.known else []
        if obey:
            words = f"obeyed by {', '.join(obey)}{'; the robot is stopped now' if self._stop.stopped else ''}"
            return {"name": "STOP", "state": "ok", "words": words, "remedy": ""}
        remedy = "start the game by pacman-env ros up; until then STOP ends Nav2's goals and holds the wheels by itself"
        return {"name": "STOP", "state": "bad", "words": "no node of the game obeys it", "remedy": remedy}

    def _on_stop(self, stopped: bool, who: str) -> None:
        """From here or from elsewhere."""
        self._news.add(words=f"{'stopped' if stopped else 'released'} by {who}")
        if stopped:
            self._wheels.stop()
            self._cancel_goals()
        else:
            self._wheels.release()

    def _cancel_goals(self) -> None:
        """End every goal that Nav2 pursues and every motion of the base's own, whoever asked for it."""
        self._cancelled_s = self._surroundings.monotonic()
        for canceller in self._cancellers:
            if canceller.service_is_ready():
                canceller.call_async(canceller.srv_type.Request())  # all zero: every goal

    def _publish_velocity(self, v: float, omega: float) -> None:
        self._velocity.publish(twist_message(v, omega, self._node.get_clock().now().to_msg()))

    # Roles, and what they do

    def leave(self, person: str) -> None:
        """What the person drove by hand stands, and what the person armed is not armed any more."""
        if self._armed == person:
            self.arm(None)
        if self._roles.leave(person) is not None:
            self._wheels.let_go()

    def let_go(self) -> None:
        """Nobody drives by hand any more."""
        self._wheels.let_go()

    def assume(self, person: str, role: str) -> None:
        """Drive the robot by hand from now on.

        Raises:
            Refused: a ghost's role, or somebody else drives.
        """
        if role != ROBOT:
            raise Refused("ghosts are moved by the game here: roles of ghosts are the simulator's")
        if self._roles.person(role) not in (None, person):
            raise Refused("somebody else drives")
        self._roles.assume(person, role)

    def require_role(self, person: str) -> None:
        """Raise Refused unless the person drives the robot."""
        self._roles.require(person, ROBOT)

    def drive(self, v: float, omega: float, fastest: float, turn: float) -> None:
        """By hand only while nobody else drives: in the menu, without a goal of Nav2's, not stopped.

        Args:
            v: m/s.
            omega: rad/s.
            fastest: m/s, that the wheels can.
            turn: rad/s, that the robot can.

        Raises:
            Refused: somebody else drives.
        """
        if self._node.game.state != "menu":
            raise Refused("the game drives: by hand in the menu alone; Reset leads there")
        if self._node.robot.navigating:
            raise Refused("Nav2 drives to a goal that somebody has sent it; STOP ends that")
        if not self._wheels.drive(min(max(v, -fastest), fastest), min(max(omega, -turn), turn)):
            self.require_not_stopped()

    def show(self, word: str, what: str) -> None:
        """A light or a sound; an event is sent to the game only when it may move the robot."""
        if what != "event":
            self._publish(topics.GAME_LIGHT if what == "light" else topics.GAME_SOUND, word)
            return
        answer = FEEDBACK[word]
        if self._armed and answer.motion in ("spin", "shake"):
            self.require_not_stopped()
            if self._node.game.state != "menu" or self._wheels.driven or self._node.robot.navigating:
                raise Refused("somebody else drives: an event moves the robot in the menu alone; disarm first")
            self._shows_until_s = self._surroundings.monotonic() + _LONGEST_SHOW_S
            self._publish(topics.GAME_EVENT, word)
            return
        self._news.add(event=word)
        if answer.light is not None:
            self._publish(topics.GAME_LIGHT, answer.light)
        if answer.sound is not None:
            self._publish(topics.GAME_SOUND, answer.sound)

    def arm(self, by: str | None) -> None:
        """Events move the robot from now on, or, with None, no more."""
        self._armed = by
        if by is None and self._surroundings.monotonic() < self._shows_until_s and self._node.game.state == "menu":
            self._publish(topics.GAME_EVENT, "reset")  # ends the motion
        self._shows_until_s = 0.0

    def _publish(self, topic: topics.Topic, word: str) -> None:
        self._publishers[topic.name].publish(topic.type(data=word))


def require_word(word: str, what: str) -> None:
    """Raise Refused for an event, a light or a sound that there is not."""
    known: dict[str, Any] = {"event": FEEDBACK, "light": LIGHTS, "sound": MELODIES}
    if word not in known[what]:
        raise Refused(f"{what} {word!r}: there is none")
