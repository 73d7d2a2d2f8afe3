"""A complete and a lost game over the simulated robot, from end to end, beside the golden sequence of the recorded one.

Both games of a policy are played once, in one system of real processes; each test looks at another side of them.
"""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("rclpy")
pytest.importorskip("nav2_msgs")
pytest.importorskip("irobot_create_msgs")

from action_msgs.msg import GoalStatus

from pacman_env.config import ShowConfig, make_config
from pacman_env.game.lights import animations
from pacman_env.game.sounds import MELODIES, frequency_hz
from pacman_env.ros import topics
from pacman_env.ros.messages import pose_of, seconds_of
from pacman_env.ros.simulated_robot.sim_robot import AUDIO_SHOWN, LIGHT_RING_SHOWN
from tests.ros.system import Probe, System
from tests.ros.whole_game import CAGE, CLOSET, GOALS, LATE_S, PELLETS, SPEEDS, WINDOW_S, Recording, Said, Table

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
MELODY = {tuple(frequency_hz(note) for note, _ in melody): word for word, melody in MELODIES.items()}


@pytest.fixture(scope="module", params=["clyde_aware", "ppo"])
def games(
    request: pytest.FixtureRequest, domain: int, tmp_path_factory: pytest.TempPathFactory
) -> dict[str, Recording]:
    """The complete game, then the lost one, which goes on from its score and round; slower on a busy machine."""
    if request.param == "ppo":
        pytest.importorskip("onnxruntime")
    for speed in SPEEDS:
        with System(tmp_path_factory.mktemp(request.param)) as system, Probe(system) as probe:
            table = Table(system, probe, request.param, speed)
            played = {"complete": table.play(CAGE), "lost": table.play(CLOSET)}
        for process in system.processes:
            assert process.popen.returncode == 0, process.output
            assert "Traceback" not in process.output
            assert "[ERROR]" not in process.output
        if max(game.waits.worst for game in played.values()) * speed < LATE_S:
            break
    return played


@pytest.fixture(params=["complete", "lost"])
def name(request: pytest.FixtureRequest) -> str:
    """Of the game."""
    return str(request.param)


@pytest.fixture
def game(games: dict[str, Recording], name: str) -> Recording:
    """What was said in it."""
    return games[name]


@pytest.fixture
def golden(game: Recording, name: str) -> dict[str, Any]:
    """What had to be said in it; a list in a list comes once for each pellet, with number and score filled in."""
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


def number_line(said: Said) -> str:
    """As in the golden file."""
    text = f"{said.value:.2f}" if isinstance(said.value, float) else str(said.value)
    return f"{NUMBERS[said.topic]} {text}"


def story(game: Recording) -> list[tuple[float, str]]:
    """Words, and numbers where they change; Clyde's speed also where a round begins."""
    lines: list[tuple[float, str]] = []
    numbers = dict(game.before)
    for said in game.said:
        if said.topic in WORDS:
            word, _, number = said.value.partition(":")
            lines.append((said.at, f"{WORDS[said.topic]} {word}" + (":{id}" if number else "")))
        elif said.topic in NUMBERS and (said.value != numbers[said.topic] or lines[-1][1] == "state starting"):
            numbers[said.topic] = said.value
            lines.append((said.at, number_line(said)))
    return lines


def when(game: Recording, line: str, nth: int = 0) -> float:
    """When a line of the story was said, wall s."""
    return [at for at, said in story(game) if said == line][nth]


def ids(said: list[Said]) -> list[int]:
    """Pellets, of statuses or removals."""
    return [int(str(one.value).rpartition(":")[2]) for one in said]


# What is said


def test_commands_events_states_and_statuses_come_in_the_recorded_order(
    game: Recording, golden: dict[str, Any]
) -> None:
    assert [line for _, line in story(game)] == golden["story"]


def test_each_pellet_is_reported_and_then_removed_once(game: Recording, name: str) -> None:
    reported = [said for said in game.on(topics.GAME_STATUS) if said.value.startswith("pellet_collected:")]
    removed = game.on(topics.REMOVE_PELLET)
    assert ids(removed) == ids(reported)
    assert len(set(ids(reported))) == len(reported) == {"complete": PELLETS, "lost": 1}[name]
    assert all(a.at < b.at for a, b in zip(reported, removed, strict=True))


def test_the_result_is_said_once_and_kept_in_the_menu(game: Recording, golden: dict[str, Any]) -> None:
    results = game.values(topics.GAME_RESULT)
    assert [text for k, text in enumerate(results) if k == 0 or text != results[k - 1]] == golden["results"]


def test_every_pellet_counts_as_spawned_while_the_game_runs(game: Recording) -> None:
    running = next(state for state in game.states if state[0] == "running")
    spawned = game.on(topics.PELLETS_SPAWNED)
    assert [said.value for said in spawned if said.at < running[1]][-1] == PELLETS
    assert not [said.value for said in spawned if running[1] < said.at < running[2]]


@pytest.mark.parametrize("kind", ["lights", "sounds"])
def test_each_event_has_its_light_and_its_sound(game: Recording, golden: dict[str, Any], kind: str) -> None:
    said = game.on(topics.GAME_LIGHT if kind == "lights" else topics.GAME_SOUND)
    assert [one.value for one in said] == golden[kind]
    events = [event for event in game.on(topics.GAME_EVENT) if kind == "lights" or event.value != "reset"]
    assert all(event.at < one.at for event, one in zip(events, said, strict=True))


def test_the_ring_shows_every_light_and_is_let_go(game: Recording) -> None:
    shown = iter([json.loads(text) for text in game.values(LIGHT_RING_SHOWN)])
    for word in game.values(topics.GAME_LIGHT):
        if word != "off":
            rings = [[list(led) for led in ring] for ring in animations(ShowConfig())[word].rings]
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
    """The robot turns on the spot: commands that follow one another, and what ended them."""

    def __init__(self, turning: list[Said], stop: Said) -> None:
        self.at, self.end = turning[0].at, stop.at
        self.turns = [said.message.twist.angular.z for said in turning]
        self.stamps = [seconds_of(said.message.header.stamp) for said in turning]
        self.seconds = seconds_of(stop.message.header.stamp) - self.stamps[0]
        self.pause = max(
            b - a for a, b in zip(self.stamps, [*self.stamps[1:], self.stamps[0] + self.seconds], strict=True)
        )
        self.kind = "spin" if set(self.turns) == {ShowConfig.spin_radps} else "shake"


def motions(game: Recording) -> list[Motion]:
    """In order: what was told the wheels from a spin's or a shake's event on, until the next one's."""
    said = game.on(topics.CMD_VEL)
    turns = [k for k, one in enumerate(said) if one.message.twist.angular.z]
    begins = [0.0, *(at for at, line in story(game) if line in ("event start theatrical", "event clyde killed"))]
    parts = [
        [k for k in turns if begin < said[k].at < end]
        for begin, end in zip(begins, [*begins[1:], math.inf], strict=True)
    ]
    return [Motion([said[k] for k in part], said[part[-1] + 1]) for part in parts if part]


def slack_s(game: Recording, *ends: float, begin: float | None = None) -> float:
    """How late this machine lets things be, s of simulated time.

    That is by the pauses of a node that speaks every 0.05 s, and by what the nodes waited for a core before each of
    ``ends``, wall s: for half a second, or since ``begin``. On an idle machine it is 0.3 s.
    """
    waited_s = sum(game.waits.between(min(end - WINDOW_S, begin or end), end) for end in ends)
    return 0.2 + 2 * max(motion.pause for motion in motions(game)) + game.speed * waited_s


def test_shows_last_as_long_as_recorded(game: Recording, golden: dict[str, Any]) -> None:
    audio = game.on(AUDIO_SHOWN)
    spans = {
        "start show": (when(game, "event start theatrical"), when(game, "command enable")),
        "theme": (audio[0].at, audio[1].at),
        **{motion.kind: (motion.at, motion.end) for motion in motions(game)},
    }
    if "state dying" in golden["story"]:
        spans["death show"] = when(game, "state dying"), when(game, "command return_home", 1)
    seconds = {name: game.clock(end) - game.clock(begin) for name, (begin, end) in spans.items()}
    seconds |= {motion.kind: motion.seconds for motion in motions(game)}
    assert seconds == {
        name: pytest.approx(of, abs=slack_s(game, *spans[name])) for name, of in golden["seconds"].items()
    }
    notes = json.loads(audio[0].value)["notes"]
    assert sum(length for _, length in notes) == pytest.approx(golden["seconds"]["theme"])


def test_the_robot_spins_before_a_round_and_shakes_after_a_death(game: Recording, golden: dict[str, Any]) -> None:
    assert [motion.kind for motion in motions(game)] == golden["motions"]
    for motion in motions(game):
        sides = {"spin": {ShowConfig.spin_radps}, "shake": {ShowConfig.spin_radps, -ShowConfig.spin_radps}}[motion.kind]
        assert set(motion.turns) == sides
        assert motion.turns[0] == ShowConfig.spin_radps
        assert motion.stamps[-1] - motion.stamps[0] < golden["seconds"][motion.kind] + 0.1  # never beyond its time
    assert all(said.message.twist.linear.x == 0.0 for said in game.on(topics.CMD_VEL))


def test_a_pellet_is_answered_at_once(game: Recording) -> None:
    """Recorded: within 12 ms."""
    reported = [said.at for said in game.on(topics.GAME_STATUS) if said.value.startswith("pellet_collected:")]
    for topic, word in ((topics.GAME_EVENT, "pellet"), (topics.GAME_LIGHT, "pellet"), (topics.GAME_SOUND, "pellet")):
        answers = [said.at for said in game.on(topic) if said.value == word]
        for a, b in zip(reported, answers, strict=True):
            assert game.clock(b) - game.clock(a) <= slack_s(game, b, begin=a)


# What the robot does


def test_goals_are_sent_only_while_the_robot_may_drive(game: Recording) -> None:
    assert len(game.goals) > 0
    for at, _ in game.goals.values():
        word, begin, _ = [state for state in game.states if state[1] < at][-1]
        assert word in DRIVING or game.clock(at) - game.clock(begin) < slack_s(game, at, begin=begin), word


def test_no_goal_is_left_when_the_robot_may_not_drive(game: Recording) -> None:
    unfinished = {GoalStatus.STATUS_ACCEPTED, GoalStatus.STATUS_EXECUTING, GoalStatus.STATUS_CANCELING}
    said = game.on(GOALS)
    for one, until in zip(said, [*(later.at for later in said[1:]), math.inf], strict=True):
        if unfinished & {goal.status for goal in one.message.status_list}:
            for word, begin, end in game.states:
                if word not in DRIVING and one.at < end and until > begin:
                    last = min(until, end)
                    assert game.clock(last) - game.clock(begin) <= slack_s(game, last, begin=begin), word


def test_the_robot_stands_while_it_may_not_drive(game: Recording) -> None:
    for word, begin, end in game.states:
        if word not in DRIVING:
            stands_s = game.clock(begin) + 1.0 + slack_s(game, begin + 0.5)
            for said in game.on(topics.ODOMETRY):
                if begin < said.at < end and game.clock(said.at) > stands_s:
                    assert abs(said.message.twist.twist.linear.x) < 0.01, word


def test_clyde_walks_only_while_the_game_runs(game: Recording) -> None:
    _, begin, end = next(state for state in game.states if state[0] == "running")
    poses: dict[str, set[Any]] = {"before": set(), "running": set(), "after": set()}
    for said in game.on(topics.CLYDE_POSE):
        if game.clock(said.at) - game.clock(begin) < 0:
            part = "before"
        elif said.at > end and game.clock(said.at) - game.clock(end) > slack_s(game, end + 0.5):
            part = "after"
        else:
            part = "running"
        poses[part].add(pose_of(said.message)[:2])
    assert len(poses["before"]) <= 2  # where he was, and where the reset put him
    assert len(poses["running"]) > 5
    assert len(poses["after"]) <= 2  # likewise


# What is left


def test_the_game_ends_in_the_menu_with_the_robot_at_home(game: Recording, golden: dict[str, Any]) -> None:
    kept = {said.topic: number_line(said) for said in game.said if said.topic in NUMBERS}
    assert {*kept.values(), f"state {game.values(topics.GAME_STATE)[-1]}"} == set(golden["finally"])
    assert game.values(topics.PELLETS_SPAWNED)[-1] == PELLETS
    at = game.on(topics.ODOMETRY)[-1].message.pose.pose.position
    assert math.hypot(at.x, at.y) <= make_config("robot").nav2.goal_tolerance_m + 0.06  # as the robot believes
