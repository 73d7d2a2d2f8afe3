"""How nodes of one process are stepped: order, time, faults, and what goes wrong."""

import subprocess
import sys
import textwrap
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from pacman_env.ros import topics
from pacman_env.ros.lock_step import deliveries
from pacman_env.ros.lock_step.deliveries import NodeFailed
from pacman_env.ros.lock_step.members import Member
from pacman_env.ros.lock_step.stepper import LockStep
from pacman_env.ros.lock_step.watchdog import SILENT
from pacman_env.ros.node import BaseNode
from tests.ros import session
from tests.ros.lock_step.losses import HEARTBEAT_S, MessageLosses
from tests.ros.session import Session

ROOT = Path(__file__).resolve().parents[3]
RELIABLE, LATCHED, SENSOR = topics.GAME_EVENT, topics.GAME_STATE, topics.ODOMETRY


class Echo(BaseNode):
    """Answers each event with a light and a sound, in this order, and remembers what it handles and when."""

    def __init__(self, name: str = "echo") -> None:
        super().__init__(name)
        self.handled: list[tuple[float, Any]] = []
        self.light, self.sound = topics.GAME_LIGHT.publisher(self), topics.GAME_SOUND.publisher(self)
        self.listen(RELIABLE, self._event, "bad event")
        self.listen(LATCHED, lambda m: self.handled.append((self.surroundings.monotonic(), m.data)), "bad state")
        self.listen(SENSOR, lambda m: self.handled.append((self.surroundings.monotonic(), m)), "bad odometry")

    def _event(self, message: Any) -> None:
        self.handled.append((self.surroundings.monotonic(), message.data))
        if message.data == "fail":
            raise ZeroDivisionError("a callback that fails")
        self.light.publish(topics.GAME_LIGHT.type(data=message.data))
        self.sound.publish(topics.GAME_SOUND.type(data=message.data))

    @property
    def words(self) -> list[Any]:
        return [value for _, value in self.handled]


def test_messages_are_handled_in_order_of_publication(nodes: Session) -> None:
    nodes.record(topics.GAME_SOUND, topics.GAME_LIGHT)
    nodes.start("one", lambda: Echo("one"))
    nodes.start("two", lambda: Echo("two"))
    event = RELIABLE.publisher(nodes.observer)
    nodes.game.within(nodes.observer, lambda: [event.publish(RELIABLE.type(data=word)) for word in ("a", "b")])
    light, sound = topics.GAME_LIGHT.name, topics.GAME_SOUND.name
    expected = [(topic, word) for word in ("a", "a", "b", "b") for topic in (light, sound)]
    assert [(one.topic, one.value) for one in nodes.records] == expected


def test_time_stands_still_while_messages_are_handled(nodes: Session) -> None:
    echo = nodes.start("echo", Echo).node
    nodes.advance(0.05)  # before the first message of the clock a node's time is 0
    fired: list[tuple[float, float]] = []

    def fire() -> None:
        fired.append((round(nodes.now_s, 6), echo.surroundings.monotonic()))

    echo.create_timer(0.2, fire)
    echo.create_timer(0.5, fire, clock=echo.surroundings.clock())
    began = nodes.now_s
    nodes.publish(RELIABLE, "a")
    assert nodes.now_s == began
    nodes.advance(1.0)
    assert [round(at - began, 6) for at, _ in fired] == [0.2, 0.4, 0.5, 0.6, 0.8, 1.0, 1.0]


def test_late_node_gets_latched_messages_first(nodes: Session) -> None:
    nodes.publish(LATCHED, "menu")
    nodes.publish(LATCHED, "running")
    nodes.publish(RELIABLE, "too early")
    late = nodes.start("late", lambda: Echo("late")).node
    nodes.publish(RELIABLE, "in time")
    assert late.words == ["running", "in time"]


def test_frozen_node_gets_what_its_queues_kept(nodes: Session) -> None:
    member = nodes.start("echo", Echo)
    nodes.freeze(member)
    for number in range(RELIABLE.qos.depth + 3):
        nodes.publish(RELIABLE, str(number))
    nodes.advance(1.0)
    assert member.node.words == []
    nodes.thaw(member)
    nodes.advance(0.05)
    assert member.node.words == [str(number) for number in range(3, RELIABLE.qos.depth + 3)]


def test_removed_node_handles_nothing(nodes: Session) -> None:
    member = nodes.start("echo", Echo)
    nodes.game.remove(member, last_messages=False)
    nodes.publish(RELIABLE, "a")
    assert member.node.handled == []
    assert nodes.game.member("echo") is None


def test_message_for_destroyed_entity_is_lost(nodes: Session) -> None:
    class Leaver(BaseNode):
        def __init__(self) -> None:
            super().__init__("leaver")
            self.handled: list[str] = []
            self.events = topics.GAME_EVENT.subscription(self, lambda message: self.handled.append(message.data))
            self.listen(topics.GAME_LIGHT, lambda message: self.destroy_subscription(self.events), "bad light")

    leaver = nodes.start("leaver", Leaver).node
    light, event = topics.GAME_LIGHT.publisher(nodes.observer), RELIABLE.publisher(nodes.observer)

    def publish() -> None:
        event.publish(RELIABLE.type(data="before"))
        light.publish(topics.GAME_LIGHT.type(data="off"))
        event.publish(RELIABLE.type(data="after"))

    nodes.game.within(nodes.observer, publish)
    assert leaver.handled == ["before"]  # type: ignore[attr-defined]


def lossy(nodes: Session, percent: float, count: int, seed: int = 0) -> tuple[Member, MessageLosses]:
    """An echo that loses so many per cent of so many events and odometry messages, one of each in a step."""
    member = nodes.start("echo", Echo)
    losses = MessageLosses(nodes.game, seed)
    losses.begin("echo", percent)
    for number in range(count):
        nodes.publish(SENSOR, SENSOR.type(child_frame_id=str(number)))
        nodes.publish(RELIABLE, str(number))
        nodes.advance(0.05)
    return member, losses


def test_lost_reliable_messages_come_later_in_order(nodes: Session) -> None:
    member, losses = lossy(nodes, 50, 9)
    losses.end("echo")
    nodes.advance(HEARTBEAT_S + 0.1)
    words = [value for value in member.node.words if isinstance(value, str)]
    assert words == [str(number) for number in range(9)]
    times = {value: at for at, value in member.node.handled if isinstance(value, str)}
    assert max(times.values()) >= HEARTBEAT_S
    assert 0 < len(member.node.handled) - len(words) < 9


def test_only_latched_messages_survive_lease(nodes: Session) -> None:
    member, losses = lossy(nodes, 100, 3)
    nodes.publish(LATCHED, "running")
    nodes.advance(21.0)
    assert member.node.handled == []
    losses.end("echo")
    nodes.advance(HEARTBEAT_S + 0.1)
    assert member.node.words == ["running"]


def test_same_seed_loses_same_packets(domain: int, tmp_path: Path) -> None:
    def lost(seed: int) -> list[Any]:
        with session.nodes(tmp_path, seed) as found:
            member, _ = lossy(found, 50, 20, seed)
            return [(at, value if isinstance(value, str) else "odometry") for at, value in member.node.handled]

    first, again, other = lost(1), lost(1), lost(2)
    assert first == again != other


def test_exception_in_callback_names_its_node(nodes: Session) -> None:
    nodes.start("echo", Echo)
    with pytest.raises(NodeFailed, match="echo: ZeroDivisionError: a callback that fails"):
        nodes.publish(RELIABLE, "fail")


def test_endless_answers_name_their_nodes(nodes: Session, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(deliveries, "MOST_DELIVERIES", 100)

    class Loop(BaseNode):
        def __init__(self) -> None:
            super().__init__("loop")
            out = RELIABLE.publisher(self)
            self.listen(RELIABLE, out.publish, "bad event")

    nodes.start("loop", Loop)
    with pytest.raises(
        NodeFailed, match=r"no end to messages in one step, 100 so far; waiting: loop \(/robot_15/game_event\)"
    ):
        nodes.publish(RELIABLE, "a")


def test_silent_node_is_named_and_process_ends(domain: int) -> None:
    script = """
        import time
        from pacman_env.ros import topics
        from pacman_env.ros.lock_step.stepper import LockStep
        from pacman_env.ros.node import BaseNode

        class Sleeper(BaseNode):
            def __init__(self):
                super().__init__("sleeper")
                self.create_timer(0.05, lambda: time.sleep(3600), clock=self.surroundings.clock())

        game = LockStep(silence_s=10.0)  # it watches the making of the node, too
        game.add(Sleeper, ["--ros-args"])
        game.advance(10.0)
    """
    command = [sys.executable, "-c", textwrap.dedent(script)]
    ended = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False, cwd=ROOT)
    assert ended.returncode == SILENT
    assert "sleeper has not answered for 10 s of real time: the game ends" in ended.stderr


def test_service_is_answered_in_same_step(nodes: Session) -> None:
    nodes.start("pellet_manager", map_yaml="house")
    began = nodes.now_s
    assert nodes.call(topics.RESET_PELLETS).message == "13 pellets"
    assert nodes.now_s == began


def test_second_game_in_process_receives_no_old_messages(domain: int, tmp_path: Path) -> None:
    make: Callable[[], LockStep] = LockStep
    for _ in range(2):
        game = make()
        member = game.add(Echo, ["--ros-args", "-r", f"__ns:={session.NAMESPACE}"])
        assert member.node.words == []  # type: ignore[attr-defined]
        game.close()
