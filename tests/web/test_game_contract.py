"""What the server expects of a game, the simulator's and the robot's alike."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Any

import cv2
import numpy as np
import pytest

from pacman_env.web import messages as m
from pacman_env.web.frame import Frame
from pacman_env.web.game import Refused
from pacman_env.web.rules import Rules
from pacman_env.web.simulated import SimulatedGame
from tests.waiting import wait_for
from tests.web.frames import decode


class SimulatedPlay:
    """The simulated game, with the interface of the robot's (``PageGame``)."""

    def __init__(self) -> None:
        self.page = SimulatedGame(Rules(policy="nearest", second="nearest", map="loop"), seed=3)
        self.page.handle("guest-1", m.ClydeSpeed(mps=0.05))

    def handle(self, message: m.Message, person: str = "guest-1") -> Any:
        return self.page.handle(person, message)

    def stop(self, person: str = "guest-1") -> None:
        self.page.stop(person)

    def release(self) -> None:
        self.page.release("guest-1")

    def do(self, call: Callable[[], Any]) -> Any:
        return call()

    def wait(self, condition: Callable[[], Any], what: str) -> Any:
        return wait_for(condition, what)

    @property
    def frame(self) -> Frame:
        frame = self.page.frame()
        assert frame is not None
        return frame

    @property
    def drives(self) -> bool:
        return abs(self.frame.velocity[0]) > 0.1

    @property
    def stands(self) -> bool:
        return self.frame.velocity == (0.0, 0.0)

    def menu(self) -> None:
        self.release()
        self.page.leave("guest-1")
        self.handle(m.Reset())

    def round(self) -> None:
        self.menu()
        self.handle(m.Speed(times=50))
        self.handle(m.Start())
        self.wait(lambda: self.frame.state == "running", "the round")
        self.handle(m.Speed(times=1))
        self.wait(lambda: self.drives, "the robot to drive")


@pytest.fixture(scope="module", params=["simulator", "robot"])
def game(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    if request.param == "simulator":
        play = SimulatedPlay()
        yield play
        play.page.close()
        return
    pytest.importorskip("rclpy")
    pytest.importorskip("irobot_create_msgs")
    from tests.ros import session
    from tests.ros.operator_page.page_game import EXTRA, HOME, MAP, POLICY, SETTINGS, PageGame

    request.getfixturevalue("domain")
    folder = tmp_path_factory.mktemp("game")
    with session.game(folder, MAP, POLICY, seed=1, settings=SETTINGS, home=HOME, extra=EXTRA) as nodes:
        play = PageGame(nodes)
        yield play
        play.page.close()


def test_frame_matches_scene(game: Any) -> None:
    game.menu()
    scene, frame = game.page.scene(), decode(game.frame.encode())
    facts = scene.facts
    picture = cv2.imdecode(np.frombuffer(scene.picture, np.uint8), cv2.IMREAD_UNCHANGED)
    assert picture.shape == (facts["map"]["height"], facts["map"]["width"])
    assert (frame.revision, facts["map"]["name"], facts["policy"]) == (scene.revision, "loop", "nearest")
    assert facts["pellets"] == facts["candidates"][: facts["first_refuge"]]
    assert frame.alive.tolist() == [True] * len(facts["pellets"])
    assert [ghost["role"] for ghost in facts["ghosts"]] == ["ghost-0"]
    assert frame.true is not None
    assert frame.believed is not None
    assert math.dist(frame.believed[:2], frame.true[:2]) < 0.3


def test_start_message_begins_round_and_sends_news(game: Any) -> None:
    game.menu()
    after = max((one["number"] for one in game.page.news(0)), default=0)
    game.round()
    game.wait(lambda: game.frame.goal >= 0 and np.isfinite(game.frame.scores).any(), "a choice")
    assert len(game.frame.scores) == len(game.page.scene().facts["candidates"]) + 1
    news = game.page.news(after)
    assert {"starting", "running"} <= {one["state"] for one in news if "state" in one}
    assert [one["number"] for one in news] == sorted({one["number"] for one in news})
    with pytest.raises(Refused, match="the game is in state"):
        game.handle(m.Start())


def test_stop_holds_the_robot_until_release(game: Any) -> None:
    game.round()
    game.stop("guest-2")
    game.wait(lambda: game.frame.stopped and game.stands, "the robot to stand")
    with pytest.raises(Refused, match="stopped"):
        game.handle(m.Start())
    game.stop("guest-1")
    assert game.frame.stopped
    game.release()
    game.wait(lambda: not game.frame.stopped and game.drives, "the robot to drive")


def test_robot_is_driven_by_its_person_only(game: Any) -> None:
    game.menu()
    with pytest.raises(Refused, match="role"):
        game.handle(m.Drive(v=0.0, omega=0.5))
    game.handle(m.Role(role="robot"))
    with pytest.raises(Refused):
        game.handle(m.Role(role="robot"), "guest-2")
    game.handle(m.Drive(v=0.0, omega=0.5))
    game.do(lambda: game.page.leave("guest-1"))
    game.handle(m.Role(role="robot"), "guest-2")
    game.do(lambda: game.page.leave("guest-2"))


def test_lidar_scan_is_sent_only_while_watched(game: Any) -> None:
    game.menu()
    game.page.watch(why=False, lidar=True)
    game.wait(lambda: np.isfinite(game.frame.scan).any(), "a scan")
    game.page.watch(why=False, lidar=False)
    game.wait(lambda: not len(game.frame.scan), "no scan")


def test_clyde_is_placed_only_in_menu(game: Any) -> None:
    game.menu()
    x, y = game.page.scene().facts["pellets"][3]
    game.handle(m.PlaceClyde(x=x, y=y))
    game.wait(lambda: math.dist(game.frame.ghosts[0], (x, y)) < 0.5, "Clyde")
    with pytest.raises(Refused):
        game.handle(m.PlaceClyde(x=x, y=y, ghost=3))
    game.round()
    with pytest.raises(Refused, match="in the menu"):
        game.handle(m.PlaceClyde(x=x, y=y))


@pytest.mark.parametrize(
    "message", [m.Event(word="birthday"), m.Setup(map="nowhere"), m.Setup(policy="nobody"), m.Setup(level=3)]
)
def test_impossible_request_is_refused(game: Any, message: m.Message) -> None:
    game.menu()
    before = game.page.scene()
    with pytest.raises(Refused):
        game.handle(message)
    assert game.page.scene() == before
    assert game.page.story(99) is None
