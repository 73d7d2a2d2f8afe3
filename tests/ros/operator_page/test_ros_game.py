"""The page over a game of nodes: what it shows, what it asks for, and its STOP. Times are simulated."""

import json
from collections.abc import Callable, Iterator
from contextlib import closing
from typing import Any, TypeVar

import pytest
from nav_msgs.msg import Odometry
from rclpy.action import CancelResponse
from std_msgs.msg import Header

from pacman_env.ros import topics
from pacman_env.ros.game_nodes import GAME
from pacman_env.ros.message_conversion import markers_of, pose_message
from pacman_env.ros.node import BaseNode
from pacman_env.ros.operator_page.page_node import PageNode
from pacman_env.ros.operator_page.ros_driving import PERIOD_S
from pacman_env.ros.operator_page.ros_game import RosGame
from pacman_env.ros.simulated_robot.sim_robot import FAULT
from pacman_env.ros.simulated_robot.sim_sensors import map_message
from pacman_env.web import page_messages
from pacman_env.web.game_interface import Refused
from pacman_env.web.roles import DEAD_MAN_S
from pacman_env.world.maps.occupancy import load_map
from tests.ros import session
from tests.ros.session import Session
from tests.web.game_contract import STILL_MPS, STILL_RADPS, GameContract, Play

MAP, POLICY = "loop", "nearest"
#: Of a game with a Clyde that is no danger.
SETTINGS = ("clyde.speed_mps=0.02", "show.start_s=1", "show.death_s=1")
EXTRA: dict[str, dict[str, Any]] = {GAME: {"diagnostics_rate": 5.0}}
BRAKES_S = 0.4  # from full speed, 0.256 m/s, at the wheels' 0.9 m/s2, and two steps
T = TypeVar("T")


def start_page(session: Session) -> RosGame:
    """Start the page's node in a session; the caller closes it."""
    node = session.start("pacman_page", lambda **options: PageNode(True, lambda: session.now_s, **options))
    page = RosGame(node, wait_for=session.until)
    node.create_timer(PERIOD_S, page.update)
    return page


class PageGame(Play):
    """The page over a session of a whole game."""

    page: RosGame

    def __init__(self, session: Session) -> None:
        self.session = session
        self.page = start_page(session)
        self.wait(lambda: self.ready, "the game")

    def wait(self, condition: Callable[[], Any], what: str) -> Any:
        return self.session.wait_for(condition, what=what)

    def do(self, call: Callable[[], T]) -> T:
        """Have the page do something between two steps of the game, and time go on while it waits for an answer."""
        return self.session.within(call)

    @property
    def ready(self) -> bool:
        frame, facts = self.page.frame(), self.page.scene().facts
        there = frame is not None and frame.believed is not None and len(frame.ghosts) == 1 and frame.alive.any()
        return bool(there and facts["candidates"] and facts["ghosts"] and facts["policy"] == POLICY and self.obeyed)

    @property
    def obeyed(self) -> bool:
        """Whether all nodes that move the robot obey the page's stop."""
        return all(name in self.page.driving.stop_row()["words"] for name in (GAME, "game_event_mapper"))


@pytest.fixture(scope="module")
def whole(domain: int, tmp_path_factory: pytest.TempPathFactory) -> Iterator[PageGame]:
    folder = tmp_path_factory.mktemp("game")
    with session.game(folder, MAP, POLICY, seed=1, settings=SETTINGS, home=(0.0, 0.0, 0.0), extra=EXTRA) as nodes:
        nodes.record(topics.CMD_VEL, topics.ODOMETRY)
        game = PageGame(nodes)
        with closing(game.page):
            yield game


@pytest.fixture
def game(whole: PageGame) -> PageGame:
    whole.release()
    whole.page.watch(why=False, lidar=False)
    whole.handle(page_messages.Arm(on=False))
    return whole


play = game


@pytest.fixture
def page(nodes: Session) -> Iterator[RosGame]:
    """Return a page without a game."""
    with closing(start_page(nodes)) as page:
        yield page


def publish_odometry(nodes: Session) -> None:
    nodes.publish(topics.ODOMETRY, Odometry(header=Header(frame_id="odom", stamp=nodes.stamp())))


class TestRosGameContract(GameContract):
    """The promises of every game."""


def test_jumped_pose_is_alert_until_it_is_answered(game: PageGame) -> None:
    def alerts() -> list[dict[str, Any]]:
        found: list[dict[str, Any]] = game.page.scene().facts["alerts"]
        return found

    game.menu()
    assert alerts() == []
    after = game.news_number()
    game.session.publish(FAULT, "pose_jump 0 1.5 0")
    game.wait(alerts, "the alert")
    (alert,) = alerts()
    assert (alert["kind"], alert["asks"]) == ("pose jumped", True)
    assert alert["words"].startswith("pose jumped 1.")
    assert any("pose jumped" in words for words in game.heard("words", after))
    game.handle(page_messages.Continue())
    game.wait(lambda: not alerts(), "its end")
    with pytest.raises(Refused, match="nothing to confirm"):
        game.handle(page_messages.Continue())
    game.session.publish(FAULT, "end pose_jump")
    game.wait(alerts, "the alert")
    x, y, heading = game.frame.true
    game.handle(page_messages.SetPose(x=x, y=y, heading=heading))
    game.wait(lambda: not alerts(), "its end")


def test_stop_acts_at_once_and_repeatedly(game: PageGame) -> None:
    def first_still_s(topic: topics.Topic) -> float:
        for one in game.session.on(topic):
            twist = getattr(one.message.twist, "twist", one.message.twist)
            if abs(twist.linear.x) < STILL_MPS and abs(twist.angular.z) < STILL_RADPS:
                return one.at - began_s
        raise AssertionError(f"no velocity of zero on {topic.name}")

    game.round()
    game.session.clear()
    began_s = game.session.now_s
    game.stop()
    game.session.advance(2.0)
    assert first_still_s(topics.CMD_VEL) == 0.0
    assert first_still_s(topics.ODOMETRY) < BRAKES_S
    assert game.stands
    velocities = [one.twist for one in game.session.messages(topics.CMD_VEL)]
    assert len(velocities) > 5
    assert not any(one.linear.x or one.angular.z for one in velocities)


def test_stop_ends_motions_of_base(game: PageGame) -> None:
    game.menu()
    undock = topics.RosAction("undock", topics.NAVIGATE_TO_POSE.type_name)  # of any type
    ended: list[bool] = []
    base = game.session.start("base", lambda **options: BaseNode("base", **options))
    undock.server(
        base,
        lambda handle: undock.type.Result(),
        cancel_callback=lambda handle: ended.append(True) or CancelResponse.ACCEPT,
        handle_accepted_callback=lambda handle: None,  # it goes on for ever
    )
    client = undock.client(base)
    answer = game.session.within(lambda: client.send_goal_async(undock.type.Goal()))
    game.wait(answer.done, "the goal")
    assert answer.result().accepted
    game.stop()
    assert ended
    game.release()
    game.session.kill("base")


def test_driving_by_hand_needs_menu_and_release(game: PageGame) -> None:
    turn = page_messages.Drive(v=0.0, omega=9.0)
    game.menu()
    game.handle(page_messages.Role(role="robot"))
    game.wait(lambda: game.handle(turn) or game.frame.velocity[1] > 1.0, "a turn")
    assert game.frame.velocity[1] < 2.0
    game.wait(lambda: game.stands, "the dead man's time")
    game.stop("guest-2")
    with pytest.raises(Refused, match="stopped by guest-2"):
        game.handle(turn)
    game.release()
    game.handle(page_messages.Start())
    game.wait(lambda: game.frame.state != "menu", "the start")
    with pytest.raises(Refused, match="the game drives"):
        game.handle(turn)


def test_drive_ends_half_a_second_after_last_command(nodes: Session, page: RosGame) -> None:
    def drive() -> None:
        nodes.within(lambda: page.handle("guest-1", page_messages.Drive(v=0.2, omega=0.1)))

    nodes.record(topics.CMD_VEL)
    nodes.publish(topics.GAME_STATE, "menu")
    nodes.advance(1.0)
    nodes.within(lambda: page.handle("guest-1", page_messages.Role(role="robot")))
    began_s = nodes.now_s
    drive()
    nodes.advance(2.0)
    speeds = [(one.at - began_s, one.message.twist.linear.x) for one in nodes.on(topics.CMD_VEL)]
    assert max(at_s for at_s, v in speeds if v) == pytest.approx(DEAD_MAN_S, abs=0.051)
    assert sum(v == 0.0 for _, v in speeds) > 3  # one may be lost
    drive()
    nodes.within(page.close)
    assert nodes.messages(topics.CMD_VEL)[-1].twist.linear.x == 0.0


def test_settings_change_or_are_refused_with_reason(game: PageGame) -> None:
    game.menu()
    facts = game.page.scene().facts
    assert facts["preset"] == "robot"
    assert facts["settings"] == {"clyde.speed_mps": 0.02, "show.start_s": 1, "show.death_s": 1}
    game.handle(page_messages.ClydeSpeed(mps=0.03))
    game.wait(lambda: game.page.scene().facts["clyde_speed_mps"] == pytest.approx(0.03), "the speed")
    game.handle(page_messages.Setup(policy="lookahead", second="nearest"))
    game.wait(lambda: game.page.scene().facts["policy"] == "lookahead", "the policy")
    game.handle(page_messages.Setup(policy="nearest"))
    game.wait(lambda: game.page.scene().facts["policy"] == "nearest", "the policy")
    for message, words in (
        (page_messages.Setup(map="house"), "only the policy"),
        (page_messages.PlaceClyde(x=500.0, y=0.0), "wide enough"),
        (page_messages.PlaceClyde(x=0.0, y=0.0, ghost=1), "only Clyde"),
        (page_messages.Pause(on=True), "only in the simulator"),
        (page_messages.Speed(times=2), "only in the simulator"),
        (page_messages.Role(role="ghost-0"), "ghosts"),
        (page_messages.Goal(candidate=1), "only in the simulator"),
        (page_messages.Why(story=1, tick=1), "only in the simulator"),
    ):
        with pytest.raises(Refused, match=words):
            game.handle(message)
    with pytest.raises(Refused, match="map"):
        game.page.add_map("mine", "", b"")
    assert game.handle(page_messages.Stories()) == []


def test_page_without_game_keeps_map_of_robot(nodes: Session, page: RosGame) -> None:
    nodes.publish(topics.MAP, map_message(load_map(MAP), nodes.stamp()))
    nodes.advance(5.0)
    assert page.scene().facts["map"]["name"] == "map"
    assert "no game is found in /robot_15" in page.scene().facts["notice"]
    assert page.frame() is None
    publish_odometry(nodes)
    nodes.advance(1.0)
    assert page.scene().facts["map"] is not None
    nodes.advance(5.0)
    assert page.scene().facts["map"] is None


def test_page_shows_power_pellets_of_topics(nodes: Session, page: RosGame) -> None:
    def report(harmless: list[float], caught: int, pellets: dict[int, Any]) -> dict[str, Any]:
        nodes.publish(topics.HARMLESS_GHOSTS, harmless)
        nodes.publish(topics.GHOSTS_CAUGHT, caught)
        nodes.publish(topics.PELLET_MARKERS, markers_of(pellets, nodes.stamp(), power=[7]))
        nodes.publish(topics.GHOST_POSES[0], pose_message(1.0, 2.0, 0.0, nodes.stamp()))
        nodes.advance(0.8)
        frame = page.frame()
        assert frame is not None
        return json.loads(frame.encode())

    nodes.publish(topics.MAP, map_message(load_map(MAP), nodes.stamp()))
    publish_odometry(nodes)
    nodes.publish(topics.GAME_STATE, "running")
    nodes.advance(1.0)
    frame = report([0.0, 0.0], 0, {3: (0.0, 0.0), 7: (1.0, 0.0)})
    assert (frame["harmless_s"], frame["ghosts_caught"], frame["points"]) == ([0], 0, [])
    assert page.scene().facts["power"]["pellets"] == [1]
    until_s = page.node.robot.clock_s + 20.0
    frame = report([until_s, 0.0], 0, {3: (0.0, 0.0)})
    assert 18.0 < frame["harmless_s"][0] < 20.0
    until_s = page.node.robot.clock_s + 5.0
    frame = report([until_s, until_s], 1, {3: (0.0, 0.0)})
    assert 4.0 < frame["away_s"][0] < 5.0
    assert (frame["ghosts_caught"], frame["points"]) == (1, [[1.0, 2.0, 20.0]])


def test_clock_of_round_is_that_of_game(nodes: Session, page: RosGame) -> None:
    def time_s(**condition: Any) -> float:
        nodes.publish(topics.DIAGNOSTICS, json.dumps(condition))
        nodes.advance(0.5)
        frame = page.frame()
        assert frame is not None
        return frame.time_s

    nodes.advance(0.5)
    nodes.publish(topics.GAME_STATE, "running")
    assert time_s() == pytest.approx(0.5, abs=0.1)  # a game that does not say
    assert time_s(round_s=100.0) == pytest.approx(100.5, abs=0.1)
    assert time_s(round_s=100.4) == pytest.approx(101.0, abs=0.1)  # a delayed message does not set it back
    assert time_s(round_s=40.0) == pytest.approx(40.5, abs=0.1)
    nodes.publish(topics.GAME_STATE, "complete")
    assert time_s(round_s=None) == pytest.approx(40.5, abs=0.1)


def test_processes_are_shown_and_their_ends_told(nodes: Session, page: RosGame) -> None:
    def processes(number: int, event: str, **reasons: str) -> dict[str, str]:
        started = {**dict.fromkeys(("sim_robot", "watcher", "pacman_game", "operator_page"), ""), **reasons}
        nodes.publish(topics.PROCESSES, json.dumps({"processes": started, "event": event, "number": number}))
        return plays(1.0, policy_ready=True)

    def plays(seconds: float, odometry: bool = True, **condition: Any) -> dict[str, str]:
        """Let the robot report, and the game if it has a condition; return the processes that do not run."""
        for _ in range(int(2 * seconds)):
            if odometry:
                publish_odometry(nodes)
            if condition:
                nodes.publish(topics.DIAGNOSTICS, json.dumps(condition))
            nodes.advance(0.5)
        shown = page.scene().facts["processes"]
        assert {"robot", "game", "policy", "watcher"} >= set(shown)
        return {name: why for name, why in shown.items() if why}

    def told(after: int) -> list[str]:
        return [one["words"] for one in page.news(after) if "words" in one]

    nodes.publish(topics.GAME_STATE, "menu")
    assert processes(0, "") == {}
    assert processes(1, "watcher was killed; again in 2 s", watcher="was killed") == {"watcher": "was killed"}
    assert told(0)[-1] == "watcher was killed; again in 2 s"
    assert processes(1, "watcher was killed; again in 2 s") == {}
    assert "watcher" in told(0)[-1]
    number, (trouble,) = len(page.news(0)), ["the policy raises"]
    failing = {"troubles": {"policy fails": 1}, "trouble_texts": {"policy fails": trouble}}
    assert plays(1.0, policy_ready=False, **failing) == {"policy": trouble}
    assert told(number) == [trouble]
    assert plays(1.0, policy_ready=True) == {}
    number = len(page.news(0))
    assert set(plays(3.0)) == {"game", "policy"}
    assert [words.partition(":")[0] for words in told(number)] == ["game"]
    revision = page.scene().revision
    plays(3.0)
    assert page.scene().revision == revision
    assert set(plays(3.0, odometry=False, policy_ready=True)) == {"robot"}


def test_untrusted_pose_is_part_of_scene(nodes: Session, page: RosGame) -> None:
    for trouble, lost in (("Nav2 fails", False), ("another map", True), ("pose lost", True)):
        nodes.publish(topics.DIAGNOSTICS, json.dumps({"troubles": {trouble: 1}, "trouble_texts": {}}))
        nodes.advance(1.0)
        assert page.scene().facts["pose_lost"] is lost


def test_clock_goes_on_after_crash_of_game(game: PageGame) -> None:
    game.round()
    game.session.advance(5.0)
    before_s, killed_s = game.frame.time_s, game.session.now_s
    game.session.kill(GAME)
    game.session.start(GAME)
    game.wait(lambda: game.frame.state == "running" and game.drives, "the round to go on")
    passed_s = game.frame.time_s - before_s
    assert -4.0 < passed_s < game.session.now_s - killed_s + 1.0  # the saved game may be one second old


def test_page_tells_that_referee_is_gone(game: PageGame) -> None:
    game.menu()
    after = game.news_number()
    game.session.kill(GAME)
    game.wait(lambda: any(words.startswith("game: ") for words in game.heard("words", after)), "its end to be said")
    with pytest.raises(Refused, match="pacman_game"):
        game.handle(page_messages.Start())
    game.stop()  # works all the same
    game.wait(lambda: game.frame.stopped, "the stop")
    game.release()
    game.session.start(GAME)
    game.wait(lambda: any(words.startswith("game runs") for words in game.heard("words", after)), "it to be back")
    game.wait(lambda: game.frame.state == "menu", "the menu")
    game.wait(lambda: game.obeyed, "the referee to know the page")
    game.round()
