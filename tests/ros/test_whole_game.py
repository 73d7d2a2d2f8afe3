"""A complete and a lost game over the simulated robot, from end to end, beside the golden sequence of the recorded one.

Both games of a policy are played once, in lock-step; each test looks at another side of them. Times are simulated.
"""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import pytest
from action_msgs.msg import GoalStatus

from pacman_env.config import make_config
from pacman_env.ros import topics
from pacman_env.ros.simulated_robot.sim_robot import AUDIO_SHOWN
from pacman_env.ros.supervisor.game_nodes import SIMULATOR
from tests.ros import session
from tests.ros.session import Recorded
from tests.ros.whole_game import CAGE, CLOSET, GOALS, HOME, PELLETS, SETTINGS, Recording, play, save

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


@pytest.fixture(scope="module")
def games(domain: int, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Recording]:
    """The complete game, then the lost one, which goes on from its score and round."""
    folder = tmp_path_factory.mktemp("games")
    extra: dict[str, dict[str, Any]] = {SIMULATOR: {"home": HOME}}
    with session.game(folder, save(folder), "clyde_aware", seed=1, settings=SETTINGS, extra=extra) as game:
        played = {"complete": play(game, CAGE), "lost": play(game, CLOSET)}
        game.observer.get_logger().error("the last line")
        assert game.errors() == ["robot_15.observer: the last line"]
    return played


@pytest.fixture(params=["complete", "lost"])
def name(request: pytest.FixtureRequest) -> str:
    """Of the game."""
    return str(request.param)


@pytest.fixture
def game(games: dict[str, Recording], name: str) -> Recording:
    """What was published in it."""
    return games[name]


@pytest.fixture
def golden(game: Recording, name: str) -> dict[str, Any]:
    """What had to be published in it; a list in a list comes once for each pellet, with number and score filled in."""
    number = {"complete": PELLETS, "lost": 1}[name]
    score = game.before[topics.SCORE.name]

    def filled(value: Any, collected: int) -> Any:
        if isinstance(value, str):
            return value.format(id="{id}", collected=collected, score=score + collected)
        if not isinstance(value, list):
            return value
        lines = []
        for line in value:
            if isinstance(line, list):
                lines += [filled(one, k) for k in range(1, number + 1) for one in line]
            else:
                lines.append(filled(line, number))
        return lines

    return {part: filled(value, number) if isinstance(value, list) else value for part, value in GOLDEN[name].items()}


def number_line(one: Recorded) -> str:
    """As in the golden file."""
    text = f"{one.value:.2f}" if isinstance(one.value, float) else str(one.value)
    return f"{NUMBERS[one.topic]} {text}"


def story(game: Recording) -> list[tuple[float, str]]:
    """Words, and numbers where they change; Clyde's speed also where a round begins."""
    lines: list[tuple[float, str]] = []
    numbers = dict(game.before)
    for one in game.records:
        if one.topic in WORDS:
            word, _, number = one.value.partition(":")
            lines.append((one.at, f"{WORDS[one.topic]} {word}" + (":{id}" if number else "")))
        elif one.topic in NUMBERS and (one.value != numbers[one.topic] or lines[-1][1] == "state starting"):
            numbers[one.topic] = one.value
            lines.append((one.at, number_line(one)))
    return lines


def when(game: Recording, line: str, nth: int = 0) -> float:
    """When a line of the story was published, s."""
    return [at for at, published in story(game) if published == line][nth]


def ids(records: list[Recorded]) -> list[int]:
    """Pellets, of statuses or removals."""
    return [int(str(one.value).rpartition(":")[2]) for one in records]


# What is published


def test_messages_come_in_recorded_order(game: Recording, golden: dict[str, Any]) -> None:
    assert [line for _, line in story(game)] == golden["story"]


def test_each_pellet_is_reported_and_removed_once(game: Recording, name: str) -> None:
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
    assert len(set(ids(reported))) == len(reported) == {"complete": PELLETS, "lost": 1}[name]


def test_result_is_kept_in_menu(game: Recording, golden: dict[str, Any]) -> None:
    results = game.values(topics.GAME_RESULT)
    assert [text for k, text in enumerate(results) if k == 0 or text != results[k - 1]] == golden["results"]


@pytest.mark.parametrize("kind", ["lights", "sounds"])
def test_each_event_has_light_and_sound_at_once(game: Recording, golden: dict[str, Any], kind: str) -> None:
    answers = game.on(topics.GAME_LIGHT if kind == "lights" else topics.GAME_SOUND)
    assert [one.value for one in answers] == golden[kind]
    events = [event for event in game.on(topics.GAME_EVENT) if kind == "lights" or event.value != "reset"]
    order = {id(one): k for k, one in enumerate(game.records)}
    for event, one in zip(events, answers, strict=True):
        assert one.at == event.at
        assert order[id(event)] < order[id(one)]


# How long it takes


def test_shows_last_as_long_as_recorded(game: Recording, golden: dict[str, Any]) -> None:
    audio = game.on(AUDIO_SHOWN)
    spans = {
        "start show": (when(game, "event start theatrical"), when(game, "command enable")),
        "theme": (audio[0].at, audio[1].at),
    }
    if "state dying" in golden["story"]:
        spans["death show"] = when(game, "state dying"), when(game, "command return_home", 1)
    seconds = {name: end - begin for name, (begin, end) in spans.items()}
    assert seconds == pytest.approx({name: golden["seconds"][name] for name in spans}, abs=1e-6)


# What the robot does


def test_goals_are_sent_only_while_robot_may_drive(game: Recording) -> None:
    assert len(game.goals) > 0
    for at, _ in game.goals.values():
        assert game.states_at(at) & DRIVING


def test_no_goal_is_left_when_robot_must_stand(game: Recording) -> None:
    unfinished = {GoalStatus.STATUS_ACCEPTED, GoalStatus.STATUS_EXECUTING, GoalStatus.STATUS_CANCELING}
    statuses = game.on(GOALS)
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


def test_game_ends_in_menu_at_home(game: Recording, golden: dict[str, Any]) -> None:
    kept = {one.topic: number_line(one) for one in game.records if one.topic in NUMBERS}
    assert {*kept.values(), f"state {game.values(topics.GAME_STATE)[-1]}"} == set(golden["finally"])
    assert game.values(topics.PELLETS_SPAWNED)[-1] == PELLETS
    at = game.on(topics.ODOMETRY)[-1].message.pose.pose.position
    assert math.hypot(at.x, at.y) <= make_config("robot").nav2.goal_tolerance_m + 0.06  # as the robot believes
