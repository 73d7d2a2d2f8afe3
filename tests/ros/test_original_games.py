"""Play recorded transcripts of the original's nodes to ours: two rounds, and every pellet that is reported counts.

``golden/original_games.json`` was recorded once, with stand-ins for the original's nodes beside our nodes, which were
one for each part then. A line is the time since the line before, s, what happens, the topic or service, and the value.
The original says its lines in order; it waits until it has heard from our nodes what it heard in the recording.
"""

import json
import time
from pathlib import Path
from typing import Any

import pytest

from pacman_env.ros import topics
from pacman_env.ros.game_nodes import (
    GAME,
    LISTENERS,
    ORIGINAL,
    ORIGINAL_SELECTOR,
    SELECTOR,
    SHADOW,
    SIMULATOR,
    GameSetup,
)
from pacman_env.ros.message_conversion import markers_of, pose_message
from pacman_env.ros.node import BaseNode
from pacman_env.ros.observer import ObserverNode
from pacman_env.ros.supervisor.operator import status_rows, wait_for_all
from pacman_env.ros.supervisor.status_line import StatusLine
from tests.map_parts import part_of_map
from tests.ros import session
from tests.ros.selector_game import FAR_AWAY
from tests.waiting import PATIENCE_S

Line = list[Any]  # time since the line before (s), what happens, topic or service, value
Pellets = dict[int, tuple[float, float]]
TRANSCRIPTS: dict[str, list[Line]] = json.loads((Path(__file__).parent / "golden" / "original_games.json").read_text())
PLANNER = "planner and pellet manager"
TOPICS = {one.name: one for one in vars(topics).values() if isinstance(one, topics.Topic)}
SETTINGS = ("execution.death_radius_m=0.001", "clyde.speed_mps=0.02", "show.start_s=2")  # no round is lost


class Original(BaseNode):
    """Says the original's lines of a transcript; if ``pellets`` are given, it also shows these pellets and Clyde."""

    def __init__(
        self, lines: list[Line], pellets: Pellets | None = None, loses_bursts: bool = False, **options: Any
    ) -> None:
        super().__init__("original", **options)
        self.transcript, self.lines = lines, list[Line]()  # the lines that are left
        self.heard: list[tuple[str, Any]] = []
        self.loses_bursts = loses_bursts
        self._since_s = self.now_s()
        says, hears = ({name for _, kind, name, _ in lines if kind == wanted} for wanted in ("says", "hears"))
        self.voices = {name: TOPICS[name].publisher(self) for name in says}
        for name in hears:
            TOPICS[name].subscription(self, lambda message, name=name: self.heard.append((name, plain(message))))
        if pellets is not None:
            self._all, self._left = pellets, dict(pellets)
            self._markers, self._clyde = topics.PELLET_MARKERS.publisher(self), topics.CLYDE_POSE.publisher(self)
            topics.REMOVE_PELLET.subscription(self, self._remove)
            topics.START_GAME.server(self, self._start)
            self.create_timer(1.0, self._show)
        self.create_timer(0.05, self._go_on)

    @property
    def is_asked_to_start(self) -> bool:
        return self.lines[0][1:3] == ["serves", topics.START_GAME.name]

    def begin(self) -> None:
        """Forget what was latched before, and say the first line when it is due."""
        self.heard.clear()
        self.lines, self._since_s = list(self.transcript), self.now_s()

    def _start(self, request: Any, response: Any) -> Any:
        self.heard.append((topics.START_GAME.name, None))
        response.success = True
        return response

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
                self._left = dict(self._all)
                self._show()
            elif not (self.loses_bursts and name == topics.GAME_COMMAND.name and self._is_followed_at_once(name)):
                self.voices[name].publish(TOPICS[name].type(data=value))
            self.lines.pop(0)
            self._since_s = self.now_s()

    def _is_followed_at_once(self, name: str) -> bool:
        """Whether the next line on a topic belongs to the same burst, of which a reader may get the last alone."""
        for wait_s, kind, other, _ in self.lines[1:]:
            if wait_s > 0.0 or kind == "hears":
                return False
            if other == name:
                return True
        return False

    def _remove(self, message: Any) -> None:
        self._left.pop(message.data, None)
        self._show()

    def _show(self) -> None:
        stamp = self.get_clock().now().to_msg()
        self._markers.publish(markers_of(self._left, stamp))
        self._clyde.publish(pose_message(*FAR_AWAY, 0.0, stamp))


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
def test_our_selector_plays_two_rounds_of_original_game(domain: int, tmp_path: Path, loses_bursts: bool) -> None:
    map_yaml = str(part_of_map("loop", 3.0).save(tmp_path / "ground.yaml"))
    pellets = {int(number): tuple(place) for number, place in TRANSCRIPTS[PLANNER][0][3].items()}
    common: dict[str, Any] = {"map_yaml": map_yaml, "settings": list(SETTINGS)}
    with session.nodes(tmp_path, seed=1) as nodes:
        nodes.record(topics.GAME_STATUS, topics.GAME_LIGHT)
        nodes.start(SIMULATOR, **common, home="0.0,0.0,0.0")
        for name in LISTENERS:
            nodes.start(name)
        nodes.start(SELECTOR, **common, policy="nearest", home=[0.0, 0.0, 0.0])
        lines = TRANSCRIPTS["referee"]
        original = nodes.start("original", lambda **options: Original(lines, pellets, loses_bursts, **options))
        nodes.clear()
        play(nodes, original)
        reports = [(topics.GAME_STATUS.name, word) for word in nodes.values(topics.GAME_STATUS)]
        assert reports == heard_in("referee", "hears")
        assert {"start", "pellet", "win", "off"} == set(nodes.values(topics.GAME_LIGHT))
        assert nodes.errors() == []


def test_our_game_counts_reports_of_original_planner(domain: int, tmp_path: Path) -> None:
    """In the second round a pellet is removed uncounted; of that the game learns by ``game_complete`` alone."""
    map_yaml = str(part_of_map("loop", 3.0).save(tmp_path / "ground.yaml"))
    lines = [line for line in TRANSCRIPTS[PLANNER] if line[1] != "serves" and line[2] != "pellet_markers"]
    with session.nodes(tmp_path) as nodes:
        nodes.start(GAME, map_yaml=map_yaml, selector=ORIGINAL, settings=list(SETTINGS))
        nodes.record(topics.GAME_COMMAND, topics.GAME_EVENT, topics.GAME_RESULT, topics.SCORE, topics.GAME_STATE)
        original = nodes.start("original", lambda **options: Original(lines, **options))
        nodes.clear()
        play(nodes, original)
        assert [(one.topic, one.value) for one in nodes.records] == heard_in(PLANNER, "hears")
        assert nodes.errors() == []


def test_status_knows_original_planner_and_shadow(domain: int, tmp_path: Path) -> None:
    """The original's nodes have no namespace; a policy that is shown but drives nothing is called a shadow."""
    with session.nodes(tmp_path, alone=False) as nodes:
        nodes.setup = GameSetup("house", sim=True, selector=ORIGINAL, shadow="nearest")
        for name in (GAME, SHADOW):
            nodes.start(name)
        with ObserverNode(ORIGINAL_SELECTOR, "/") as planner:
            nodes.advance(1.0)  # diagnostics
            planner.create_publisher(topics.GAME_STATUS.type, f"{session.NAMESPACE}/{topics.GAME_STATUS.name}", 1)
            with StatusLine(session.NAMESPACE, sim=True) as status_line:
                assert status_line.spin_until(lambda: status_line.originals and status_line.game.condition, PATIENCE_S)
                missing = wait_for_all(status_line, time.monotonic() + 1.0)
                rows = dict(line.split(None, 1) for line in status_rows(status_line, missing).splitlines())
    assert not {SELECTOR, ORIGINAL_SELECTOR} & set(missing["absent"]["nodes"])
    assert ORIGINAL_SELECTOR in rows["nodes"]
    assert ORIGINAL in rows["selector"]
    assert SHADOW in rows["selector"]
