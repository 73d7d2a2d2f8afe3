"""Play recorded transcripts of the original's nodes to ours: two rounds, and every pellet that is reported counts.

``golden/original_games.json`` was recorded once in lock-step, with stand-ins for the original's nodes beside ours. A
line is the time since the line before, s, what happens, the topic or service, and the value. The original says its
lines in order; it waits until it has heard from our nodes what it heard in the recording.
"""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from pacman_env.ros import topics
from pacman_env.ros.game_nodes import REFEREE
from pacman_env.ros.message_conversion import markers_of
from pacman_env.ros.node import BaseNode
from tests.map_parts import part_of_map
from tests.ros import session

Line = list[Any]  # time since the line before (s), what happens, topic or service, value
TRANSCRIPTS: dict[str, list[Line]] = json.loads((Path(__file__).parent / "golden" / "original_games.json").read_text())
SERVICES = {one.name: one for one in vars(topics).values() if isinstance(one, topics.Service)}
TOPICS = {one.name: one for one in vars(topics).values() if isinstance(one, topics.Topic)}
SETTINGS = ("execution.death_radius_m=0.001", "clyde.speed_mps=0.02", "show.start_s=2")  # no round is lost


class Original(BaseNode):
    """Says the original's lines of a transcript."""

    def __init__(self, lines: list[Line], loses_bursts: bool = False) -> None:
        super().__init__("original")
        self.transcript, self.lines = lines, list[Line]()  # the lines that are left
        self.heard: list[tuple[str, Any]] = []
        self.loses_bursts = loses_bursts
        self._since_s = self.now_s()
        self._pellets: Any = None
        says, hears, serves, calls = (
            {name for _, kind, name, _ in lines if kind == wanted} for wanted in ("says", "hears", "serves", "calls")
        )
        self.voices = {name: TOPICS[name].publisher(self) for name in says}
        self.callers = {name: SERVICES[name].client(self) for name in calls}
        for name in hears:
            TOPICS[name].subscription(self, lambda message, name=name: self.heard.append((name, plain(message))))
        for name in serves:
            SERVICES[name].server(self, self._served(name))
        self.create_timer(0.05, self._go_on)
        self.create_timer(1.0, self._show_pellets)

    @property
    def is_asked_to_start(self) -> bool:
        return self.lines[0][1:3] == ["serves", topics.START_GAME.name]

    def begin(self) -> None:
        """Forget what was latched before, and say the first line when it is due."""
        self.heard.clear()
        self.lines, self._since_s = list(self.transcript), self.now_s()

    def _served(self, name: str) -> Callable[[Any, Any], Any]:
        def answer(request: Any, response: Any) -> Any:
            self.heard.append((name, None))
            response.success = True
            return response

        return answer

    def _go_on(self) -> None:
        while self.lines:
            wait_s, kind, name, value = self.lines[0]
            if kind in ("hears", "serves"):
                if (name, value) not in self.heard:
                    return
                self.heard.remove((name, value))
            elif self.now_s() - self._since_s < wait_s - 1e-6:
                return
            elif kind == "calls":
                self.callers[name].call_async(SERVICES[name].type.Request())
            else:
                self._say(name, value)
            self.lines.pop(0)
            self._since_s = self.now_s()

    def _say(self, name: str, value: Any) -> None:
        if name == topics.PELLET_MARKERS.name:
            self._pellets = {int(number): tuple(place) for number, place in value.items()}
            self._show_pellets()
        elif not (self.loses_bursts and name == topics.GAME_COMMAND.name and self._is_followed_at_once(name)):
            self.voices[name].publish(TOPICS[name].type(data=value))

    def _is_followed_at_once(self, name: str) -> bool:
        """Whether the next line on a topic belongs to the same burst, of which a reader may get the last alone."""
        for wait_s, kind, other, _ in self.lines[1:]:
            if wait_s > 0.0 or kind == "hears":
                return False
            if other == name:
                return True
        return False

    def _show_pellets(self) -> None:
        if self._pellets is not None:
            self.voices["pellet_markers"].publish(markers_of(self._pellets, self.get_clock().now().to_msg()))


def plain(message: Any) -> Any:
    return round(message.data, 3) if isinstance(message.data, float) else message.data


def heard_in(name: str, *kinds: str) -> list[tuple[str, Any]]:
    return [(topic, value) for _, kind, topic, value in TRANSCRIPTS[name] if kind in kinds]


def play(nodes: session.Session, original: Original) -> None:
    """Start each of the two rounds where the recording did, until the transcript is over."""
    original.begin()
    started = 0
    while original.lines:
        line = original.lines[0]
        if original.is_asked_to_start or (line[0] >= 2.0 and line[1:] == ["hears", "game_command", "disable"]):
            nodes.advance(2.0)
            assert nodes.call(topics.START_GAME).success
            started += 1
        nodes.wait_for(lambda line=line: original.lines[:1] != [line], 60.0, f"{line}")
    assert started == 2


@pytest.mark.parametrize("loses_bursts", [False, True])
def test_nodes_play_two_rounds_of_original_referee(domain: int, tmp_path: Path, loses_bursts: bool) -> None:
    ground = part_of_map("loop", 3.0).save(tmp_path / "ground.yaml")
    with session.game(tmp_path, ground, "nearest", seed=1, settings=SETTINGS, home=(0.0, 0.0, 0.0)) as nodes:
        nodes.record(topics.GAME_STATUS, topics.GAME_LIGHT)
        nodes.stop(REFEREE)
        original = nodes.start(REFEREE, lambda: Original(TRANSCRIPTS["referee"], loses_bursts)).node
        assert isinstance(original, Original)
        nodes.clear()
        play(nodes, original)
        reports = [(topics.GAME_STATUS.name, word) for word in nodes.values(topics.GAME_STATUS)]
        assert reports == heard_in("referee", "hears")
        assert {"start", "pellet", "win", "off"} == set(nodes.values(topics.GAME_LIGHT))
        assert nodes.errors() == []


def test_referee_counts_reports_of_original_planner(domain: int, tmp_path: Path) -> None:
    """In the second round a pellet is removed uncounted; of that the referee learns by ``game_complete`` alone."""
    name = "planner and pellet manager"
    with session.nodes(tmp_path) as nodes:
        nodes.record(topics.GAME_COMMAND, topics.GAME_EVENT, topics.GAME_RESULT, topics.SCORE, topics.GAME_STATE)
        nodes.start("clyde_ghost_node", map_yaml="loop", settings=list(SETTINGS))
        nodes.start(REFEREE, settings=list(SETTINGS))
        nodes.clear()
        original = nodes.start("original", lambda: Original(TRANSCRIPTS[name])).node
        assert isinstance(original, Original)
        nodes.clear()
        play(nodes, original)
        assert [(one.topic, one.value) for one in nodes.records] == heard_in(name, "hears")
        assert nodes.errors() == []
