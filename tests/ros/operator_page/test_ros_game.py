"""The page over a game of nodes in lock-step: what it shows, what it asks for, and its STOP. Times are simulated."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from nav_msgs.msg import Odometry
from rclpy.action import CancelResponse
from std_msgs.msg import Header

from pacman_env.ros import topics
from pacman_env.ros.node import BaseNode
from pacman_env.ros.operator_page.ros_game import RosGame
from pacman_env.ros.simulated_robot.sim_robot import FAULT
from pacman_env.ros.simulated_robot.sim_sensors import map_message
from pacman_env.web import messages
from pacman_env.web.game import Refused
from pacman_env.world.maps.occupancy import load_map
from tests.ros import session
from tests.ros.operator_page.page_game import EXTRA, HOME, MAP, POLICY, SETTINGS, STILL_MPS, STILL_RADPS, PageGame
from tests.web.frames import decode

STOPS = 3
BRAKES_S = 0.4  # from full speed, 0.256 m/s, at the wheels' 0.9 m/s2, and two steps
CANCELED = 5  # action_msgs/GoalStatus


@pytest.fixture(scope="module")
def whole(domain: int, tmp_path_factory: pytest.TempPathFactory) -> Iterator[PageGame]:
    folder = tmp_path_factory.mktemp("game")
    with session.game(folder, MAP, POLICY, seed=1, settings=SETTINGS, home=HOME, extra=EXTRA) as nodes:
        nodes.record(topics.CMD_VEL, topics.ODOMETRY, topics.DIAGNOSTICS)
        game = PageGame(nodes)
        try:
            yield game
        finally:
            game.page.close()


@pytest.fixture
def game(whole: PageGame) -> PageGame:
    whole.release()
    whole.page.watch(why=False, lidar=False)
    whole.handle(messages.Arm(on=False))
    return whole


def test_scene_shows_map_pellets_and_robot_at_home(game: PageGame) -> None:
    game.menu()
    scene = game.page.scene()
    facts = scene.facts
    picture = cv2.imdecode(np.frombuffer(scene.picture, np.uint8), cv2.IMREAD_UNCHANGED)
    assert picture.shape == (facts["map"]["height"], facts["map"]["width"])
    assert {0, 254} <= set(np.unique(picture).tolist()) <= {0, 205, 254}
    assert facts["map"]["name"] == "loop"
    assert facts["policy"] == "nearest"
    assert facts["settings"] == {"clyde.speed_mps": 0.02, "show.start_s": 1, "show.death_s": 1}
    assert facts["preset"] == "robot"
    assert facts["pellets"] == facts["candidates"][: facts["first_refuge"]]
    frame = decode(game.frame.encode())
    assert frame.revision == scene.revision
    assert frame.alive.all()
    assert frame.alive.shape == (len(facts["pellets"]),)
    assert frame.believed is not None
    assert frame.true is not None
    assert math.dist(frame.believed[:2], frame.true[:2]) < 0.3
    assert [ghost["role"] for ghost in facts["ghosts"]] == ["ghost-0"]


def test_start_leads_to_score_and_shown_choice(game: PageGame) -> None:
    game.menu()
    game.page.watch(why=True, lidar=True)
    number, after = game.frame.number, game.news_number()
    game.handle(messages.Start())
    game.wait(lambda: game.frame.score > 0, "a pellet")
    game.wait(lambda: game.frame.goal >= 0 and np.isfinite(game.frame.scores).any(), "a choice")
    game.wait(lambda: np.isfinite(game.frame.scan).any(), "a scan")
    game.wait(lambda: any("why" in one for one in game.page.news(after)), "reasons")
    frame, facts = game.frame, game.page.scene().facts
    assert frame.number > number
    assert frame.state == "running"
    assert frame.time_s > 0.0
    assert len(frame.scores) == len(facts["candidates"]) + 1
    assert int((~frame.alive).sum()) >= 1
    assert frame.ring is not None
    said = game.page.news(after)
    assert {"starting", "running"} <= {one["state"] for one in said if "state" in one}
    assert {"pellet"} <= {one["event"] for one in said if "event" in one}
    game.page.watch(why=False, lidar=False)
    game.wait(lambda: not len(game.frame.scan), "no scan")
    with pytest.raises(Refused, match="the game is in state"):
        game.handle(messages.Start())


def first_still_s(game: PageGame, topic: topics.Topic, twist: Any) -> float:
    """When a topic first had a velocity of zero since what was recorded was forgotten, s."""

    def still() -> float | None:
        for one in game.session.on(topic):
            it = twist(one.message)
            if abs(it.linear.x) < STILL_MPS and abs(it.angular.z) < STILL_RADPS:
                return one.at
        return None

    return float(game.wait(still, f"a velocity of zero on {topic.name}"))


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
    assert any("pose jumped" in one.get("words", "") for one in game.page.news(after))
    game.handle(messages.Continue())
    game.wait(lambda: not alerts(), "its end")
    with pytest.raises(Refused, match="nothing to continue from"):
        game.handle(messages.Continue())
    game.session.publish(FAULT, "end pose_jump")
    game.wait(alerts, "the alert")
    x, y, heading = game.frame.true
    game.handle(messages.SetPose(x=x, y=y, heading=heading))
    game.wait(lambda: not alerts(), "its end")


def test_stop_acts_at_once_and_holds_until_release(game: PageGame) -> None:
    for _ in range(STOPS):
        game.round()
        game.session.forget()
        began_s = game.session.now_s
        game.stop()
        assert first_still_s(game, topics.CMD_VEL, lambda m: m.twist) == began_s
        assert first_still_s(game, topics.ODOMETRY, lambda m: m.twist.twist) - began_s < BRAKES_S
        game.wait(lambda: game.frame.stopped and game.stands, "the page to show it")
        velocities = [one.twist for one in game.session.messages(topics.CMD_VEL)]
        assert len(velocities) > 5  # again and again
        assert not any(one.linear.x or one.angular.z for one in velocities)
        game.session.advance(2.0)
        assert game.stands
        game.release()
        game.wait(lambda: not game.frame.stopped, "the release")


def test_stopped_game_refuses_goals_and_starts(game: PageGame) -> None:
    game.round()
    game.stop("guest-2")
    game.wait(lambda: game.stands, "the robot to stand")
    with pytest.raises(Refused, match="stopped by guest-2"):
        game.handle(messages.Start())
    place = game.frame.true
    nodes, observer = game.session.game, game.session.observer
    client = topics.NAVIGATE_TO_POSE.client(observer)
    goal = topics.NAVIGATE_TO_POSE.type.Goal()
    goal.pose.header.frame_id = "map"
    goal.pose.pose.position.x, goal.pose.pose.orientation.w = 3.0, 1.0
    answer = nodes.within(observer, lambda: client.send_goal_async(goal))  # of RViz, say
    game.wait(answer.done, "the answer to a goal")
    assert answer.result().accepted
    ended = nodes.within(observer, answer.result().get_result_async)
    game.wait(ended.done, "its end")
    assert ended.result().status == CANCELED
    game.session.advance(3.0)
    assert game.frame.state == "running"
    assert place is not None
    assert game.frame.true is not None
    assert math.dist(place[:2], game.frame.true[:2]) < 0.02
    game.release()
    game.wait(lambda: game.drives, "the round to go on")
    client.destroy()


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


def test_restarted_goal_selector_stays_stopped(game: PageGame) -> None:
    game.round()
    game.stop()
    game.wait(lambda: game.stands, "the robot to stand")
    place = game.frame.true
    game.session.kill("goal_selector")
    game.session.forget()
    game.start("goal_selector")

    def condition() -> dict[str, object]:
        return json.loads((game.session.values(topics.DIAGNOSTICS) or ["{}"])[-1])

    fresh = {"active": True, "stopped": True, "task": "play", "goals_sent": 0}  # not a word of the one before it
    game.wait(lambda: fresh.items() <= condition().items(), "the goal selector, stopped")
    game.session.advance(3.0)
    assert place is not None
    assert game.frame.true is not None
    assert math.dist(place[:2], game.frame.true[:2]) < 0.05
    game.release()
    game.wait(lambda: game.drives, "the round to go on")


def test_driving_by_hand_needs_menu_and_repeated_words(game: PageGame) -> None:
    game.menu()
    with pytest.raises(Refused, match="role"):
        game.handle(messages.Drive(v=0.2, omega=0.0))
    game.handle(messages.Role(role="robot"))
    with pytest.raises(Refused, match="another person drives"):
        game.handle(messages.Role(role="robot"), "guest-2")
    game.handle(messages.Drive(v=0.0, omega=9.0))
    game.wait(lambda: game.handle(messages.Drive(v=0.0, omega=9.0)) or game.frame.velocity[1] > 1.0, "a turn")
    assert game.frame.velocity[1] < 2.0
    game.wait(lambda: game.stands, "the dead man's time")
    game.stop("guest-2")
    with pytest.raises(Refused, match="stopped by guest-2"):
        game.handle(messages.Drive(v=0.2, omega=0.0))
    game.release()
    game.handle(messages.Start())
    game.wait(lambda: game.frame.state != "menu", "the start")
    with pytest.raises(Refused, match="the game drives"):
        game.handle(messages.Drive(v=0.2, omega=0.0))


def test_clyde_is_placed_in_menu_alone(game: PageGame) -> None:
    game.menu()
    x, y = game.page.scene().facts["pellets"][-1]
    game.handle(messages.PlaceClyde(x=x, y=y))
    game.wait(lambda: math.dist(game.frame.ghosts[0], (x, y)) < 0.5, "Clyde")
    with pytest.raises(Refused, match="wide enough"):
        game.handle(messages.PlaceClyde(x=x + 50.0, y=y))
    with pytest.raises(Refused, match="only Clyde"):
        game.handle(messages.PlaceClyde(x=x, y=y, ghost=1))
    game.round()
    with pytest.raises(Refused, match="menu"):
        game.handle(messages.PlaceClyde(x=x, y=y))


def test_events_move_robot_only_when_armed(game: PageGame) -> None:
    game.menu()
    after = game.news_number()
    game.session.forget()
    game.handle(messages.Event(word="death"))
    game.wait(lambda: {"event", "light", "sound"} <= {key for one in game.page.news(after) for key in one}, "the show")
    game.wait(lambda: game.frame.ring is not None, "the ring")
    game.session.advance(2.0)
    assert not any(message.twist.angular.z for message in game.session.messages(topics.CMD_VEL))
    game.handle(messages.Arm(on=True))
    game.handle(messages.Event(word="start theatrical"))
    game.wait(lambda: any(m.twist.angular.z for m in game.session.messages(topics.CMD_VEL)), "the spin")
    game.handle(messages.Arm(on=False))
    game.wait(lambda: not game.session.messages(topics.CMD_VEL)[-1].twist.angular.z, "its end")
    for what, word in (("light", "pink"), ("sound", "win")):
        after = game.news_number()
        game.handle(messages.Event(word=word, what=what))
        game.wait(
            lambda after=after, what=what, word=word: (
                {what: word}.items() <= dict(item for one in game.page.news(after) for item in one.items()).items()
            ),
            word,
        )
    with pytest.raises(Refused, match="unknown event"):
        game.handle(messages.Event(word="dance"))


def test_settings_change_or_are_refused_with_reason(game: PageGame) -> None:
    game.menu()
    game.handle(messages.ClydeSpeed(mps=0.03))
    game.wait(lambda: game.page.scene().facts["clyde_speed_mps"] == pytest.approx(0.03), "the speed")
    game.handle(messages.Setup(policy="lookahead", second="nearest"))
    game.wait(lambda: game.page.scene().facts["policy"] == "lookahead", "the policy")
    game.handle(messages.Setup(policy="nearest"))
    game.wait(lambda: game.page.scene().facts["policy"] == "nearest", "the policy")
    for message, words in (
        (messages.Setup(policy="brave"), "brave"),
        (messages.Setup(map="house"), "only the policy"),
        (messages.Pause(on=True), "STOP"),
        (messages.Speed(times=2), "--speed"),
        (messages.Role(role="ghost-0"), "ghosts"),
        (messages.Goal(candidate=1), "arrow keys"),
        (messages.Why(story=1, tick=1), "record"),
    ):
        with pytest.raises(Refused, match=words):
            game.handle(message)
    with pytest.raises(Refused, match="map"):
        game.page.add_map("mine", "", b"")
    assert game.handle(messages.Stories()) == []
    assert game.page.story(1) is None


def test_early_map_is_kept_while_robot_is_there(domain: int, tmp_path: Path) -> None:
    with session.nodes(tmp_path) as nodes:
        pages: list[RosGame] = []

        def make() -> BaseNode:
            pages.append(RosGame(session.NAMESPACE, domain, True, MAP))
            return pages[0].node

        nodes.start("pacman_page", make)
        try:
            nodes.publish(topics.MAP, map_message(load_map(MAP), nodes.stamp()))
            nodes.advance(5.0)
            assert pages[0].scene().facts["map"]["name"] == "map"
            nodes.publish(topics.ODOMETRY, Odometry(header=Header(frame_id="odom", stamp=nodes.stamp())))
            nodes.advance(2.0)
            assert pages[0].scene().facts["map"] is not None
            nodes.advance(5.0)
            assert pages[0].scene().facts["map"] is None
        finally:
            pages[0].close()


def test_page_tells_that_referee_is_gone(game: PageGame) -> None:
    game.menu()
    after = game.news_number()
    game.session.kill("game_controller")
    game.wait(lambda: any("the game is gone" in words for words in game.words(after)), "its end to be said")
    with pytest.raises(Refused, match="game_controller"):
        game.handle(messages.Start())
    game.stop()  # works all the same
    game.wait(lambda: game.frame.stopped, "the stop")
    game.release()
    game.start("game_controller")
    game.wait(lambda: any("is running" in words for words in game.words(after)), "it to be back")
    game.wait(lambda: game.frame.state == "menu", "the menu")
    game.wait(lambda: game.obeyed, "the referee to know the page")
    game.round()
