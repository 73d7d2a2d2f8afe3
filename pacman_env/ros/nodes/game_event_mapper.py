"""Node ``game_event_mapper``: turns an event into a light, a sound and a motion of the robot (Algorithm 6)."""

import sys
from collections.abc import Iterable
from functools import partial
from typing import Any

from pacman_env.game.events import FEEDBACK, Motion, angular_velocity

from .. import topics
from ..configured_node import ConfiguredNode
from ..message_conversion import twist_message, word_of
from ..operator_stop import OperatorStop
from ..process import run

NAME = "game_event_mapper"
_PERIOD_S = 0.05  # the base stops by itself 0.5 s after the last command
#: The command with which the planner takes over from a motion. Other commands do not end the motion: they may arrive
#: after an event that was sent later.
_TAKES_OVER: dict[Motion, str] = {"spin": "enable", "shake": "return_home"}


class GameEventMapper(ConfiguredNode):
    """Node that listens for events and drives only during a motion."""

    def __init__(self, **options: Any) -> None:
        super().__init__(NAME, **options)
        self._light = topics.GAME_LIGHT.publisher(self)
        self._sound = topics.GAME_SOUND.publisher(self)
        self._velocity = topics.CMD_VEL.publisher(self)
        self._motion: Motion = "stop"
        self._since_s = 0.0
        self._command = ""  # the last command
        self._timer = self.create_timer(_PERIOD_S, self._move)
        self._timer.cancel()
        self._operator = OperatorStop(self, self._on_stop)
        self.listen(topics.GAME_EVENT, self._on_event, "bad event")
        topics.GAME_COMMAND.subscription(self, self._on_command)

    def _on_event(self, message: Any) -> None:
        answer = FEEDBACK[word_of(message, FEEDBACK)]
        if answer.light is not None:
            self._light.publish(topics.GAME_LIGHT.type(data=answer.light.word))
        if answer.sound is not None:
            self._sound.publish(topics.GAME_SOUND.type(data=answer.sound.word))
        if answer.motion == "stop":
            self._stop()
        elif answer.motion is not None and answer.motion != self._motion:  # repeated events do not prolong a motion
            self._begin(answer.motion)

    def _begin(self, motion: Motion) -> None:
        if self._command != _TAKES_OVER[motion] and not self._operator.stopped:  # else the planner drives
            self._motion, self._since_s = motion, self.now_s()
            self._timer.reset()
            self._move()

    def _on_stop(self, stopped: bool, who: str) -> None:
        if stopped:  # the release does not resume the motion
            self._stop()

    def _on_command(self, message: Any) -> None:
        self._command = message.data
        if self._command == _TAKES_OVER.get(self._motion):  # the motion takes longer than the referee's show
            self._stop()

    def _move(self) -> None:
        turn = angular_velocity(self._motion, self.now_s() - self._since_s, self.config.show)
        if turn is None:
            self._stop()
        elif turn:  # 0 before a shake: the planner has stopped the robot
            self._drive(turn)

    def _stop(self) -> None:
        self._motion = "stop"
        self._timer.cancel()
        self._drive(0.0)

    def _drive(self, w_radps: float) -> None:
        self._velocity.publish(twist_message(0.0, w_radps, self.get_clock().now().to_msg()))

    def last_messages(self) -> Iterable[Any]:
        self._stop()
        return ()


main = partial(run, GameEventMapper, NAME)

if __name__ == "__main__":
    sys.exit(main())
