"""A node for the tests of ``run``: reports that it is up, and says its last messages."""

import sys
import time
from collections.abc import Iterable, Sequence
from typing import Any

from std_msgs.msg import String

from pacman_env.ros import topics
from pacman_env.ros.node import BaseNode, parameter
from pacman_env.ros.process import run


class LastMessagesNode(BaseNode):
    """Says where it is on ``game_state``; on stop a burst of commands, and a call that is worth waiting for."""

    def __init__(self) -> None:
        super().__init__("last_messages_node")
        words = parameter(self, "words", 1, "how many words the last messages are", 0, 20)
        self.pause_s = parameter(self, "pause_s", 0.0, "how long the making takes, s", 0.0, 60.0)
        parameter(self, "offset", 0.0, "a number without a range")
        self.call = parameter(self, "call", False, "whether a service is called at the end")
        self.commands = topics.GAME_COMMAND.publisher(self)
        self.words = words
        self.state = topics.GAME_STATE.publisher(self)
        self.reset = topics.RESET_GAME.client(self)
        topics.GAME_EVENT.subscription(self, self._event)
        self.state.publish(String(data="making"))
        time.sleep(self.pause_s)
        self.start_timer = self.create_timer(0.01, self._report_start)

    def _report_start(self) -> None:
        """Say that the node spins, and finds the service that it may have to call."""
        if not self.call or self.reset.service_is_ready():
            self.start_timer.cancel()
            self.commands.publish(String(data="first"))  # a node that gets it will get the last one
            self.state.publish(String(data="here"))

    def _event(self, message: Any) -> None:
        self.once.warning("event", f"event {message.data}")
        if message.data == "over":
            self.once.over("event")
        if message.data == "fail":
            raise ZeroDivisionError("a callback that fails")

    def last_messages(self) -> Iterable[Any]:
        self.state.publish(String(data=f"status {self.status}"))
        for i in range(self.words):
            self.commands.publish(String(data=f"last {i}"))
        return [self.reset.call_async(topics.RESET_GAME.type.Request())] if self.call else []


def main(argv: Sequence[str] | None = None) -> int:
    return run(LastMessagesNode, "last_messages_node", argv)


if __name__ == "__main__":
    sys.exit(main())
