"""A complete and a lost game over the simulated robot, from end to end, beside the golden sequence of the recorded one.

Both games are played once; each test looks at another side of them. Times are simulated.
"""

import json
import math
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from action_msgs.msg import GoalStatus
from geometry_msgs.msg import PointStamped
from std_msgs.msg import Header

from pacman_env.config import make_config
from pacman_env.ros import topics
from pacman_env.ros.game_nodes import SIMULATOR
from pacman_env.ros.message_conversion import pose_of
from pacman_env.ros.simulated_robot.sim_robot import AUDIO_SHOWN, LIGHT_RING_SHOWN
from pacman_env.world.maps.occupancy import OccupancyMap
from tests.ros import session
from tests.ros.records import Recorded, Records
from tests.ros.session import Session

STEP_S = 0.05
GOLDEN = json.loads(Path(__file__).with_name("golden").joinpath("whole_game.json").read_text())
DRIVING = {"running", "returning_home"}
WORDS = {
    topics.GAME_COMMAND.name: "command",
    topics.GAME_EVENT.name: "event",
    topics.GAME_STATE.name: "state",
    topics.GAME_STATUS.name: "status",
}
NUMBERS = {
    topics.CLYDE_SPEED.name: "speed",
    topics.PELLETS_COLLECTED.name: "collected",
    topics.SCORE.name: "score",
    topics.ROUND.name: "round",
}
GOALS = topics.NAVIGATE_TO_POSE.statuses
RECORDED = (
    *(topics.GAME_STATE, topics.GAME_COMMAND, topics.GAME_EVENT, topics.GAME_STATUS, topics.GAME_RESULT),
    *(topics.SCORE, topics.ROUND, topics.PELLETS_SPAWNED, topics.PELLETS_COLLECTED, topics.CLYDE_SPEED),
    *(topics.GAME_LIGHT, topics.GAME_SOUND, topics.REMOVE_PELLET, topics.CMD_VEL, topics.CLYDE_POSE),
    *(LIGHT_RING_SHOWN, AUDIO_SHOWN, GOALS, topics.ODOMETRY, topics.DIAGNOSTICS),
)

# The map, in pixels of 0.05 m; pellets lie where columns and rows are multiples of 40 and 13 pixels are free.
# Clyde needs 11 pixels, the robot 8. From left to right: a closet with the home pose and the first pellet, from
# which a doorway, too narrow for Clyde, leads to the other pellets; and a cage without a door.
RESOLUTION_M = 0.05
SIZE = 260, 110
FREE = (  # columns from and to, rows from and to
    (30, 46, 34, 46),  # the closet, with a pellet
    (47, 74, 35, 45),  # the rest of it; robot and Clyde do not get past one another
    (75, 83, 36, 44),  # the doorway
    (84, 166, 34, 46),  # two pellets, one after the other
    (154, 166, 34, 86),  # and around the corner another: no two are equally far
    (236, 252, 54, 70),  # the cage
)
PELLETS = 4
HOME_PIXEL = 37, 40  # so that a robot that stops on the way home, 0.30 m before it, is at the closet's pellet
CAGE, CLOSET = (244, 62), (69, 40)  # where Clyde is put: it never gets out, and there is no way past it
SETTINGS = ("localization.sigma_xy_m=0.01", "localization.sigma_yaw_rad=0.02")  # the closet is narrow


def at(column: int, row: int) -> tuple[float, float]:
    """A pixel's place, m."""
    return column * RESOLUTION_M, (SIZE[1] - row) * RESOLUTION_M


HOME = f"{at(*HOME_PIXEL)[0]},{at(*HOME_PIXEL)[1]},0.0"


def closet() -> OccupancyMap:
    pixels = np.zeros(SIZE[::-1], np.uint8)
    for left, right, top, bottom in FREE:
        pixels[top : bottom + 1, left : right + 1] = 254
    return OccupancyMap.from_pixels("closet", pixels, RESOLUTION_M, (0.0, 0.0, 0.0))


class Recording(Records):
    """One game from the call of ``game/start`` on: messages in the order of publication, at simulated times, s.

    Its golden file has it by ``name``; ``before`` are the latched numbers, by topic.
    """

    def __init__(self, name: str, records: list[Recorded], before: dict[str, Any]) -> None:
        super().__init__()
        self.before, self.golden = before, GOLDEN[name]
        for one in records:
            self.add(one)

    @cached_property
    def states(self) -> list[tuple[str, float, float]]:
        """Each state with its begin and end, s."""
        records = self.on(topics.GAME_STATE)
        ends = [*(one.at for one in records[1:]), math.inf]
        return [(one.value, one.at, end) for one, end in zip(records, ends, strict=True)]


def rests(game: Session) -> bool:
    """Whether nothing shines, sounds or moves."""
    ring, audio = (json.loads(game.value(topic) or "{}") for topic in (LIGHT_RING_SHOWN, AUDIO_SHOWN))
    velocity = game.last(topics.ODOMETRY).twist.twist
    still = abs(velocity.linear.x) + abs(velocity.angular.z) < 0.01
    return not ring.get("override_system") and not audio.get("playing") and still


def play(game: Session, name: str, clyde: tuple[int, int]) -> Recording:
    """One game from the menu to the menu, with Clyde put on a pixel before."""
    game.record(*RECORDED)
    game.wait_for(lambda: game.last(topics.CLYDE_POSE) and game.last(topics.ODOMETRY), what="Clyde and the robot")
    point = PointStamped(header=Header(frame_id="map"))
    point.point.x, point.point.y = place = at(*clyde)
    game.publish(topics.CLICKED_POINT, point)
    game.wait_for(lambda: math.dist(pose_of(game.last(topics.CLYDE_POSE))[:2], place) < 0.1, what="Clyde to be placed")
    before = {one.topic: one.value for one in game.records if one.topic in NUMBERS}
    begin = len(game.records)
    assert game.call(topics.START_GAME).success
    for state in ("running", "menu"):
        game.wait_for(lambda state=state: game.value(topics.GAME_STATE) == state, 400.0, f"state {state}")
    game.wait_for(lambda: rests(game), what="the robot to rest")
    game.wait_for(lambda: game.value(topics.PELLETS_SPAWNED) == PELLETS, what="the pellets to be back")
    game.advance(2.0)  # what comes now must not come
    return Recording(name, game.records[begin:], before)


@pytest.fixture(scope="module")
def games(domain: int, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Recording]:
    """The complete game, then the lost one, which goes on from its score and round."""
    folder = tmp_path_factory.mktemp("games")
    extra: dict[str, dict[str, Any]] = {SIMULATOR: {"home": HOME}}
    map_yaml = closet().save(folder / "closet.yaml")
    with session.game(folder, map_yaml, "clyde_aware", seed=1, settings=SETTINGS, extra=extra) as game:
        played = {name: play(game, name, clyde) for name, clyde in (("complete", CAGE), ("lost", CLOSET))}
        game.observer.get_logger().error("the last line")
        assert game.errors() == ["robot_15.observer: the last line"]
    return played


@pytest.fixture(params=["complete", "lost"])
def game(games: dict[str, Recording], request: pytest.FixtureRequest) -> Recording:
    """What was published in one of them."""
    return games[request.param]


def number_line(one: Recorded) -> str:
    """As in the golden file."""
    text = f"{one.value:.2f}" if isinstance(one.value, float) else str(one.value)
    return f"{NUMBERS[one.topic]} {text}"


def story(game: Recording) -> list[str]:
    """Words, and numbers where they change; Clyde's speed also where a round begins."""
    lines: list[str] = []
    numbers = dict(game.before)
    for one in game.records:
        if one.topic in WORDS:
            word, _, number = one.value.partition(":")
            lines.append(f"{WORDS[one.topic]} {word}" + (":{id}" if number else ""))
        elif one.topic in NUMBERS and (one.value != numbers[one.topic] or lines[-1] == "state starting"):
            numbers[one.topic] = one.value
            lines.append(number_line(one))
    return lines


def ids(records: list[Recorded]) -> list[int]:
    """Pellets, of statuses or removals."""
    return [int(str(one.value).rpartition(":")[2]) for one in records]


# What is published


def test_messages_come_in_recorded_order(game: Recording) -> None:
    assert story(game) == game.golden["story"]


def test_each_pellet_is_reported_and_removed_once(game: Recording) -> None:
    reports_and_removals = [
        one
        for one in game.on(topics.GAME_STATUS, topics.REMOVE_PELLET)
        if one.topic == topics.REMOVE_PELLET.name or one.value.startswith("pellet_collected:")
    ]
    reported, removed = reports_and_removals[::2], reports_and_removals[1::2]
    assert {one.topic for one in reported} == {topics.GAME_STATUS.name}
    assert {one.topic for one in removed} == {topics.REMOVE_PELLET.name}
    assert [one.at for one in removed] == [one.at for one in reported]
    assert ids(removed) == ids(reported)
    assert len(set(ids(reported))) == len(reported) == game.golden["story"].count("event pellet")


def test_result_is_kept_in_menu(game: Recording) -> None:
    results = game.values(topics.GAME_RESULT)
    assert [text for k, text in enumerate(results) if k == 0 or text != results[k - 1]] == game.golden["results"]


@pytest.mark.parametrize("kind", ["lights", "sounds"])
def test_each_event_has_light_and_sound_at_once(game: Recording, kind: str) -> None:
    answers = game.on(topics.GAME_LIGHT if kind == "lights" else topics.GAME_SOUND)
    assert [one.value for one in answers] == game.golden[kind]
    events = [event for event in game.on(topics.GAME_EVENT) if kind == "lights" or event.value != "reset"]
    order = {id(one): k for k, one in enumerate(game.records)}
    for event, one in zip(events, answers, strict=True):
        assert one.at == event.at
        assert order[id(event)] < order[id(one)]


# What the robot does


def test_goals_are_there_only_while_robot_may_drive(game: Recording) -> None:
    unfinished = {GoalStatus.STATUS_ACCEPTED, GoalStatus.STATUS_EXECUTING, GoalStatus.STATUS_CANCELING}
    statuses = game.on(GOALS)
    assert any(goal.status in unfinished for one in statuses for goal in one.message.status_list)
    for one, until in zip(statuses, [*(later.at for later in statuses[1:]), math.inf], strict=True):
        if unfinished & {goal.status for goal in one.message.status_list}:
            for word, begin, end in game.states:
                if word not in DRIVING:
                    assert min(until, end) - max(one.at, begin) < STEP_S + 1e-6, word


def test_robot_stands_while_it_may_not_drive(game: Recording) -> None:
    for word, begin, end in game.states:
        if word not in DRIVING:
            for one in game.on(topics.ODOMETRY):
                if begin + 0.8 < one.at < end:
                    assert abs(one.message.twist.twist.linear.x) < 0.01, word


# What is left


def test_game_ends_in_menu_at_home(game: Recording) -> None:
    kept = {one.topic: number_line(one) for one in game.records if one.topic in NUMBERS}
    assert {*kept.values(), f"state {game.values(topics.GAME_STATE)[-1]}"} == set(game.golden["finally"])
    assert game.values(topics.PELLETS_SPAWNED)[-1] == PELLETS
    at = game.on(topics.ODOMETRY)[-1].message.pose.pose.position
    assert math.hypot(at.x, at.y) <= make_config("robot").nav2.goal_tolerance_m + 0.06  # as the robot believes
