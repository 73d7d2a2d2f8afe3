"""What the server expects of a game: inherit from ``GameContract`` and provide the fixture ``play``."""

import math
from collections.abc import Callable
from typing import Any, Literal, TypeVar

import cv2
import numpy as np
import pytest

from pacman_env.web import page_messages as m
from pacman_env.web.frame import Frame
from pacman_env.web.game_interface import Refused
from tests.waiting import wait_for
from tests.web.pages import decode

STILL_MPS, STILL_RADPS = 0.005, 0.02
T = TypeVar("T")


class Play:
    """A game on the map ``loop`` with the policy ``nearest`` and a Clyde that is no danger, asked as the server does.

    ``page`` is the game.
    """

    page: Any

    def wait(self, condition: Callable[[], Any], what: str) -> Any:
        """Wait for a condition; ask for frames meanwhile, as the server does."""
        return wait_for(lambda: self.page.frame() and condition(), what)

    def do(self, call: Callable[[], T]) -> T:
        """Call the game between two steps of it."""
        return call()

    def handle(self, message: m.Message, person: str = "guest-1") -> Any:
        return self.do(lambda: self.page.handle(person, message))

    def stop(self, person: str = "guest-1") -> None:
        self.do(lambda: self.page.stop(person))

    def release(self) -> None:
        self.do(lambda: self.page.release("guest-1"))

    def leave(self, person: str = "guest-1") -> None:
        self.do(lambda: self.page.leave(person))

    @property
    def frame(self) -> Frame:
        frame = self.page.frame()
        assert isinstance(frame, Frame)
        return frame

    @property
    def drives(self) -> bool:
        return abs(self.frame.velocity[0]) > 0.1

    @property
    def stands(self) -> bool:
        v, omega = self.frame.velocity
        return abs(v) < STILL_MPS and abs(omega) < STILL_RADPS

    def news_number(self) -> int:
        return max((one["number"] for one in self.page.news(0)), default=0)

    def heard(self, what: str, after: int = 0) -> list[Any]:
        """What the news say under a key."""
        return [one[what] for one in self.page.news(after) if what in one]

    def menu(self) -> None:
        self.release()
        self.leave()
        self.handle(m.Reset())
        self.wait(lambda: self.frame.state == "menu" and not self.frame.stopped, "the menu")
        self.wait(lambda: self.stands, "the robot to stand")

    def round(self) -> None:
        """Begin a new round, and wait until the robot drives."""
        self.menu()
        self.handle(m.Start())
        self.wait(lambda: self.frame.state == "running", "the round")
        self.wait(lambda: self.drives, "the robot to drive")


class GameContract:
    """Tests of what a game promises the server."""

    def test_frame_matches_scene(self, play: Play) -> None:
        play.menu()
        scene, frame = play.page.scene(), decode(play.frame.encode())
        facts = scene.facts
        picture = cv2.imdecode(np.frombuffer(scene.picture, np.uint8), cv2.IMREAD_UNCHANGED)
        assert picture.shape == (facts["map"]["height"], facts["map"]["width"])
        assert {0, 254} <= set(np.unique(picture).tolist()) <= {0, 205, 254}
        assert (frame.revision, facts["map"]["name"], facts["policy"]) == (scene.revision, "loop", "nearest")
        assert facts["pellets"] == facts["candidates"][: facts["first_refuge"]]
        assert frame.alive.tolist() == [True] * len(facts["pellets"])
        assert [ghost["role"] for ghost in facts["ghosts"]] == ["ghost-0"]
        assert frame.true is not None
        assert frame.believed is not None
        assert math.dist(frame.believed[:2], frame.true[:2]) < 0.3

    def test_start_message_begins_round_and_sends_news(self, play: Play) -> None:
        play.menu()
        after = play.news_number()
        play.round()
        play.wait(lambda: play.frame.goal >= 0 and np.isfinite(play.frame.scores).any(), "a choice")
        assert len(play.frame.scores) == len(play.page.scene().facts["candidates"]) + 1
        assert {"starting", "running"} <= set(play.heard("state", after))
        numbers = [one["number"] for one in play.page.news(after)]
        assert numbers == sorted(set(numbers))
        with pytest.raises(Refused, match="a round is in progress"):
            play.handle(m.Start())
        play.wait(lambda: play.frame.score > 0, "a pellet")
        assert "pellet" in play.heard("event", after)
        assert not play.frame.alive.all()

    def test_stop_holds_the_robot_until_release(self, play: Play) -> None:
        play.round()
        play.stop("guest-2")
        play.wait(lambda: play.frame.stopped and play.stands, "the robot to stand")
        with pytest.raises(Refused, match="stopped"):
            play.handle(m.Start())
        play.stop("guest-1")
        assert play.frame.stopped
        play.release()
        play.wait(lambda: not play.frame.stopped and play.drives, "the robot to drive")

    def test_robot_is_driven_by_its_person_only(self, play: Play) -> None:
        play.menu()
        with pytest.raises(Refused, match="role"):
            play.handle(m.Drive(v=0.0, omega=0.5))
        play.handle(m.Role(role="robot"))
        with pytest.raises(Refused):
            play.handle(m.Role(role="robot"), "guest-2")
        play.handle(m.Drive(v=0.0, omega=0.5))
        play.leave("guest-1")
        play.handle(m.Role(role="robot"), "guest-2")
        play.leave("guest-2")

    def test_scan_and_reasons_are_sent_while_watched(self, play: Play) -> None:
        play.round()
        after = play.news_number()
        play.page.watch(why=True, lidar=True)
        play.wait(lambda: np.isfinite(play.frame.scan).any(), "a scan")
        play.wait(lambda: play.heard("why", after), "reasons")
        play.page.watch(why=False, lidar=False)
        play.wait(lambda: not len(play.frame.scan), "no scan")

    def test_clyde_is_placed_only_in_menu(self, play: Play) -> None:
        play.menu()
        x, y = play.page.scene().facts["pellets"][3]
        play.handle(m.PlaceClyde(x=x, y=y))
        play.wait(lambda: math.dist(play.frame.ghosts[0], (x, y)) < 0.5, "Clyde")
        with pytest.raises(Refused):
            play.handle(m.PlaceClyde(x=x, y=y, ghost=3))
        play.round()
        with pytest.raises(Refused, match="in the menu"):
            play.handle(m.PlaceClyde(x=x, y=y))

    def test_event_moves_robot_only_when_armed(self, play: Play) -> None:
        def turned() -> float:
            assert play.frame.true is not None
            return abs(math.remainder(play.frame.true[2] - heading, 2 * math.pi))

        play.menu()
        after, number = play.news_number(), play.frame.number
        assert play.frame.true is not None
        heading = play.frame.true[2]
        play.handle(m.Event(word="death"))
        play.wait(lambda: play.frame.ring is not None and play.frame.number > number + 5, "later frames")
        play.wait(lambda: all(play.heard(what, after) for what in ("event", "light", "sound")), "the show")
        assert turned() < 0.01
        play.handle(m.Arm(on=True))
        play.handle(m.Event(word="start theatrical"))
        play.wait(lambda: turned() > 0.1, "the spin")
        play.handle(m.Arm(on=False))

    @pytest.mark.parametrize(("what", "word"), [("light", "pink"), ("sound", "win")])
    def test_light_or_sound_is_shown_alone(self, play: Play, what: Literal["light", "sound"], word: str) -> None:
        play.menu()
        after = play.news_number()
        play.handle(m.Event(word=word, what=what))
        play.wait(lambda: word in play.heard(what, after), word)

    def test_impossible_request_is_refused(self, play: Play) -> None:
        play.menu()
        before = play.page.scene()
        for message in (m.Event(word="birthday"), m.Setup(map="nowhere"), m.Setup(policy="nobody"), m.Setup(level=3)):
            with pytest.raises(Refused):
                play.handle(message)
        assert play.page.scene() == before
        assert play.page.story(99) is None
