"""The page over a game of nodes in lock-step: what it shows, what it asks for, and its STOP. Times are simulated."""

import json
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest
from nav_msgs.msg import Odometry
from rclpy.action import CancelResponse
from std_msgs.msg import Header

from pacman_env.ros import topics
from pacman_env.ros.message_conversion import markers_of, pose_message
from pacman_env.ros.simulated_robot.sim_robot import FAULT
from pacman_env.ros.simulated_robot.sim_sensors import map_message
from pacman_env.web import page_messages
from pacman_env.web.game_interface import Refused
from pacman_env.world.maps.occupancy import load_map
from tests.ros import session
from tests.ros.operator_page.page_game import EXTRA, HOME, MAP, POLICY, SETTINGS, PageGame, start_page
from tests.web.game_contract import STILL_MPS, STILL_RADPS, GameContract

BRAKES_S = 0.4  # from full speed, 0.256 m/s, at the wheels' 0.9 m/s2, and two steps


@pytest.fixture(scope="module")
def whole(domain: int, tmp_path_factory: pytest.TempPathFactory) -> Iterator[PageGame]:
    folder = tmp_path_factory.mktemp("game")
    with session.game(folder, MAP, POLICY, seed=1, settings=SETTINGS, home=HOME, extra=EXTRA) as nodes:
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


@pytest.fixture
def play(game: PageGame) -> PageGame:
    return game


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
        """When a topic first had a velocity of zero since what was recorded was forgotten, s."""

        def still() -> float | None:
            for one in game.session.on(topic):
                twist = getattr(one.message.twist, "twist", one.message.twist)
                if abs(twist.linear.x) < STILL_MPS and abs(twist.angular.z) < STILL_RADPS:
                    return one.at
            return None

        return float(game.wait(still, f"a velocity of zero on {topic.name}"))

    game.round()
    game.session.clear()
    began_s = game.session.now_s
    game.stop()
    assert first_still_s(topics.CMD_VEL) == began_s
    assert first_still_s(topics.ODOMETRY) - began_s < BRAKES_S
    game.session.advance(2.0)
    assert game.stands
    velocities = [one.twist for one in game.session.messages(topics.CMD_VEL)]
    assert len(velocities) > 5
    assert not any(one.linear.x or one.angular.z for one in velocities)


def test_stop_ends_motions_of_base(game: PageGame) -> None:
    game.menu()
    undock = topics.RosAction("undock", topics.NAVIGATE_TO_POSE.type_name)  # of any type
    ended: list[bool] = []
    nodes, observer = game.session.game, game.session.observer
    server = undock.server(
        observer,
        lambda handle: undock.type.Result(),
        cancel_callback=lambda handle: ended.append(True) or CancelResponse.ACCEPT,
        handle_accepted_callback=lambda handle: None,  # it goes on for ever
    )
    client = undock.client(observer)
    answer = nodes.within(observer, lambda: client.send_goal_async(undock.type.Goal()))
    game.wait(answer.done, "the goal")
    assert answer.result().accepted
    game.stop()
    assert ended
    game.release()
    client.destroy()
    server.destroy()


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


def test_settings_change_or_are_refused_with_reason(game: PageGame) -> None:
    game.menu()
    facts = game.page.scene().facts
    assert (facts["preset"], facts["settings"]) == (
        "robot",
        {"clyde.speed_mps": 0.02, "show.start_s": 1, "show.death_s": 1},
    )
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
        (page_messages.Pause(on=True), "STOP"),
        (page_messages.Speed(times=2), "--speed"),
        (page_messages.Role(role="ghost-0"), "ghosts"),
        (page_messages.Goal(candidate=1), "arrow keys"),
        (page_messages.Why(story=1, tick=1), "record"),
    ):
        with pytest.raises(Refused, match=words):
            game.handle(message)
    with pytest.raises(Refused, match="map"):
        game.page.add_map("mine", "", b"")
    assert game.handle(page_messages.Stories()) == []


def test_page_without_game_keeps_map_of_robot(domain: int, tmp_path: Path) -> None:
    with session.nodes(tmp_path) as nodes, closing(start_page(nodes)) as page:
        nodes.publish(topics.MAP, map_message(load_map(MAP), nodes.stamp()))
        nodes.advance(5.0)
        assert page.scene().facts["map"]["name"] == "map"
        assert "no game is found in /robot_15" in page.scene().facts["notice"]
        assert page.frame() is None
        nodes.publish(topics.ODOMETRY, Odometry(header=Header(frame_id="odom", stamp=nodes.stamp())))
        nodes.advance(2.0)
        assert page.scene().facts["map"] is not None
        nodes.advance(5.0)
        assert page.scene().facts["map"] is None


def test_page_shows_power_pellets_of_topics(domain: int, tmp_path: Path) -> None:
    def report(harmless: list[float], caught: int, pellets: dict[int, Any]) -> dict[str, Any]:
        nodes.publish(topics.HARMLESS_GHOSTS, harmless)
        nodes.publish(topics.GHOSTS_CAUGHT, caught)
        nodes.publish(topics.PELLET_MARKERS, markers_of(pellets, nodes.stamp(), power=[7]))
        nodes.publish(topics.GHOST_POSES[0], pose_message(1.0, 2.0, 0.0, nodes.stamp()))
        nodes.advance(0.8)
        frame = page.frame()
        assert frame is not None
        return json.loads(frame.encode())

    with session.nodes(tmp_path) as nodes, closing(start_page(nodes)) as page:
        nodes.publish(topics.MAP, map_message(load_map(MAP), nodes.stamp()))
        nodes.publish(topics.ODOMETRY, Odometry(header=Header(frame_id="odom", stamp=nodes.stamp())))
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


def test_page_tells_that_referee_is_gone(game: PageGame) -> None:
    game.menu()
    after = game.news_number()
    game.session.kill("game_controller")
    game.wait(lambda: any("the game is gone" in words for words in game.heard("words", after)), "its end to be said")
    with pytest.raises(Refused, match="game_controller"):
        game.handle(page_messages.Start())
    game.stop()  # works all the same
    game.wait(lambda: game.frame.stopped, "the stop")
    game.release()
    game.session.start("game_controller", settings=list(SETTINGS))
    game.wait(lambda: any("is running" in words for words in game.heard("words", after)), "it to be back")
    game.wait(lambda: game.frame.state == "menu", "the menu")
    game.wait(lambda: game.obeyed, "the referee to know the page")
    game.round()
