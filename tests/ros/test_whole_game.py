"""A complete and a lost game over the simulated robot, from end to end, beside the golden sequence of the recorded one.

Both games of a policy are played once, in lock-step; each test looks at another side of them. Times are simulated.
"""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rclpy")
pytest.importorskip("nav2_msgs")
pytest.importorskip("irobot_create_msgs")

from action_msgs.msg import GoalStatus

from pacman_env.config import ShowConfig, make_config
from pacman_env.game.events import LIGHTS, SOUNDS
from pacman_env.game.sounds import frequency_hz
from pacman_env.ros import topics
from pacman_env.ros.messages import pose_of, seconds_of
from pacman_env.ros.simulated_robot.sim_robot import AUDIO_SHOWN, LIGHT_RING_SHOWN
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
MELODY = {tuple(frequency_hz(note) for note, _ in sound.melody): word for word, sound in SOUNDS.items()}


@pytest.fixture(scope="module", params=["clyde_aware", "ppo"])
def games(
    request: pytest.FixtureRequest, domain: int, tmp_path_factory: pytest.TempPathFactory
) -> dict[str, Recording]:
    """The complete game, then the lost one, which goes on from its score and round."""
    if request.param == "ppo":
        pytest.importorskip("onnxruntime")
    folder = tmp_path_factory.mktemp(request.param)
    extra: dict[str, dict[str, Any]] = {SIMULATOR: {"home": HOME}}
    with session.game(folder, save(folder), request.param, seed=1, settings=SETTINGS, extra=extra) as game:
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


def test_commands_events_states_and_statuses_come_in_the_recorded_order(
    game: Recording, golden: dict[str, Any]
) -> None:
    assert [line for _, line in story(game)] == golden["story"]


def test_each_pellet_is_reported_and_then_removed_once_at_the_same_moment(game: Recording, name: str) -> None:
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


def test_the_result_is_published_and_kept_in_the_menu(game: Recording, golden: dict[str, Any]) -> None:
    results = game.values(topics.GAME_RESULT)
    assert [text for k, text in enumerate(results) if k == 0 or text != results[k - 1]] == golden["results"]


def test_every_pellet_counts_as_spawned_while_the_game_runs(game: Recording) -> None:
    running = next(state for state in game.states if state[0] == "running")
    spawned = game.on(topics.PELLETS_SPAWNED)
    assert [one.value for one in spawned if one.at < running[1]][-1] == PELLETS
    assert not [one.value for one in spawned if running[1] < one.at < running[2]]


@pytest.mark.parametrize("kind", ["lights", "sounds"])
def test_each_event_has_its_light_and_its_sound_at_once(game: Recording, golden: dict[str, Any], kind: str) -> None:
    answers = game.on(topics.GAME_LIGHT if kind == "lights" else topics.GAME_SOUND)
    assert [one.value for one in answers] == golden[kind]
    events = [event for event in game.on(topics.GAME_EVENT) if kind == "lights" or event.value != "reset"]
    order = {id(one): k for k, one in enumerate(game.records)}
    for event, one in zip(events, answers, strict=True):
        assert one.at == event.at
        assert order[id(event)] < order[id(one)]


def test_the_ring_shows_every_light_and_is_let_go(game: Recording) -> None:
    shown = iter([json.loads(text) for text in game.values(LIGHT_RING_SHOWN)])
    for word in game.values(topics.GAME_LIGHT):
        if word != "off":
            rings = [[list(led) for led in ring] for ring in LIGHTS[word].rings]
            assert any(ring["override_system"] and ring["leds"] in rings for ring in shown), word
    assert not json.loads(game.values(LIGHT_RING_SHOWN)[-1])["override_system"]


def test_the_loudspeaker_plays_theme_pellets_and_the_end(game: Recording, golden: dict[str, Any]) -> None:
    played = [json.loads(text) for text in game.values(AUDIO_SHOWN)]
    words = [MELODY[tuple(note for note, _ in one["notes"])] for one in played if one["playing"]]
    assert words == golden["played"]
    assert len(next(one["notes"] for one in played if one["playing"])) == 29
    assert not played[-1]["playing"]


# How long it takes


class Motion:
    """The robot turns on the spot: commands that follow one another, and the one that ended them."""

    def __init__(self, turning: list[Recorded], stop: Recorded) -> None:
        self.at, self.end = turning[0].at, stop.at
        self.turns = [one.message.twist.angular.z for one in turning]
        self.stamps = [seconds_of(one.message.header.stamp) for one in (*turning, stop)]
        self.kind = "spin" if set(self.turns) == {ShowConfig.spin_radps} else "shake"


def motions(game: Recording) -> list[Motion]:
    """In order: the velocities from a spin's or a shake's event on, until the next one's."""
    velocities = game.on(topics.CMD_VEL)
    turns = [k for k, one in enumerate(velocities) if one.message.twist.angular.z]
    begins = [0.0, *(at for at, line in story(game) if line in ("event start theatrical", "event clyde killed"))]
    parts = [
        [k for k in turns if begin <= velocities[k].at < end]
        for begin, end in zip(begins, [*begins[1:], math.inf], strict=True)
    ]
    return [Motion([velocities[k] for k in part], velocities[part[-1] + 1]) for part in parts if part]


def test_shows_last_as_long_as_recorded(game: Recording, golden: dict[str, Any]) -> None:
    audio = game.on(AUDIO_SHOWN)
    spans = {
        "start show": (when(game, "event start theatrical"), when(game, "command enable")),
        "theme": (audio[0].at, audio[1].at),
        **{motion.kind: (motion.at, motion.end) for motion in motions(game)},
    }
    if "state dying" in golden["story"]:
        spans["death show"] = when(game, "state dying"), when(game, "command return_home", 1)
    seconds = {name: end - begin for name, (begin, end) in spans.items()}
    assert seconds == pytest.approx(golden["seconds"], abs=1e-6)
    notes = json.loads(audio[0].value)["notes"]
    assert sum(length for _, length in notes) == pytest.approx(golden["seconds"]["theme"])


def test_the_robot_spins_before_a_round_and_shakes_after_a_death(game: Recording, golden: dict[str, Any]) -> None:
    assert [motion.kind for motion in motions(game)] == golden["motions"]
    for motion in motions(game):
        sides = {"spin": {ShowConfig.spin_radps}, "shake": {ShowConfig.spin_radps, -ShowConfig.spin_radps}}[motion.kind]
        assert set(motion.turns) == sides
        assert motion.turns[0] == ShowConfig.spin_radps
        pauses = np.diff(motion.stamps)
        assert pauses == pytest.approx(STEP_S, abs=1e-6)  # as often as the base wants it
        assert motion.stamps[-1] - motion.stamps[0] == pytest.approx(golden["seconds"][motion.kind], abs=1e-6)
    assert all(one.message.twist.linear.x == 0.0 for one in game.on(topics.CMD_VEL))


def test_a_pellet_is_answered_at_once(game: Recording) -> None:
    """Recorded: within 12 ms; here no simulated time passes at all."""
    reported = [one.at for one in game.on(topics.GAME_STATUS) if one.value.startswith("pellet_collected:")]
    for topic, word in ((topics.GAME_EVENT, "pellet"), (topics.GAME_LIGHT, "pellet"), (topics.GAME_SOUND, "pellet")):
        assert [one.at for one in game.on(topic) if one.value == word] == reported


# What the robot does


def test_goals_are_sent_only_while_the_robot_may_drive(game: Recording) -> None:
    assert len(game.goals) > 0
    for at, _ in game.goals.values():
        assert game.states_at(at) & DRIVING


def test_no_goal_is_left_when_the_robot_may_not_drive(game: Recording) -> None:
    unfinished = {GoalStatus.STATUS_ACCEPTED, GoalStatus.STATUS_EXECUTING, GoalStatus.STATUS_CANCELING}
    statuses = game.on(GOALS)
    for one, until in zip(statuses, [*(later.at for later in statuses[1:]), math.inf], strict=True):
        if unfinished & {goal.status for goal in one.message.status_list}:
            for word, begin, end in game.states:
                if word not in DRIVING:
                    assert min(until, end) - max(one.at, begin) < STEP_S + 1e-6, word


def test_the_robot_stands_while_it_may_not_drive(game: Recording) -> None:
    for word, begin, end in game.states:
        if word not in DRIVING:
            for one in game.on(topics.ODOMETRY):
                if begin + 0.8 < one.at < end:
                    assert abs(one.message.twist.twist.linear.x) < 0.01, word


def test_clyde_walks_only_while_the_game_runs(game: Recording) -> None:
    _, begin, end = next(state for state in game.states if state[0] == "running")
    poses: dict[str, set[Any]] = {"before": set(), "running": set(), "after": set()}
    for one in game.on(topics.CLYDE_POSE):
        part = "before" if one.at < begin else "running" if one.at <= end else "after"
        poses[part].add(pose_of(one.message)[:2])
    assert len(poses["before"]) <= 2  # where it was, and where the reset put it
    assert len(poses["running"]) > 5
    assert len(poses["after"]) <= 2  # likewise


# What is left


def test_the_game_ends_in_the_menu_with_the_robot_at_home(game: Recording, golden: dict[str, Any]) -> None:
    kept = {one.topic: number_line(one) for one in game.records if one.topic in NUMBERS}
    assert {*kept.values(), f"state {game.values(topics.GAME_STATE)[-1]}"} == set(golden["finally"])
    assert game.values(topics.PELLETS_SPAWNED)[-1] == PELLETS
    at = game.on(topics.ODOMETRY)[-1].message.pose.pose.position
    assert math.hypot(at.x, at.y) <= make_config("robot").nav2.goal_tolerance_m + 0.06  # as the robot believes
