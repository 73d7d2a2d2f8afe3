"""Keys of a person at the terminal of a game."""

import io
from types import SimpleNamespace

import pytest

from pacman_env.ros import topics
from pacman_env.ros.supervisor.console import Console
from pacman_env.ros.supervisor.terminal import LineWriter


class Operator:
    stopped, who = False, ""

    def request(self, stopped: bool, who: str) -> None:
        self.stopped, self.who = stopped, who


@pytest.mark.parametrize(
    ("keys", "other", "stands"),
    [("r", False, False), (" r", False, True), ("r ", False, True), ("rg", False, False), ("r", True, True)],
)
def test_reset_stops_robot_until_referee_answers(keys: str, other: bool, stands: bool) -> None:
    pressed, halts = list(keys), []
    operator = Operator()
    status_line = SimpleNamespace(operator=operator, halt=lambda: halts.append(operator.stopped))
    rounds = SimpleNamespace(wanted=[], requested=[topics.RESET_GAME])
    writer = LineWriter(io.StringIO())
    console = Console(status_line, rounds, writer, SimpleNamespace(), lambda: "".join(pressed))  # type: ignore[arg-type]
    console.handle_keys()
    assert all(halts)
    assert halts
    assert operator.stopped == (keys != "rg")
    assert rounds.wanted == [topics.RESET_GAME]
    pressed.clear()
    if other:
        operator.request(True, "a terminal")
    console.handle_keys()
    assert operator.stopped == (keys != "rg")
    rounds.requested.clear()
    console.handle_keys()
    assert operator.stopped == stands
