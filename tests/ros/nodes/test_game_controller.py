"""The referee: his services, what he says and in which order, and what he is not impressed by."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

pytest.importorskip("rclpy")

from rclpy.duration import Duration
from rclpy.time import Time
from rosgraph_msgs.msg import Clock

from pacman_env.game.round import RoundController
from pacman_env.ros import topics
from pacman_env.ros.messages import markers_of

if TYPE_CHECKING:
    from tests.ros.system import Probe, Process, System

NODE = "pacman_env.ros.nodes.game_controller"
SAID = (
    *(topics.GAME_STATE, topics.GAME_COMMAND, topics.GAME_RESULT, topics.GAME_EVENT),
    *(topics.SCORE, topics.ROUND, topics.PELLETS_SPAWNED, topics.PELLETS_COLLECTED, topics.CLYDE_SPEED),
)


class SimulatedClock:
    """Publishes the time from now on, twice as fast as it is; may be set."""

    def __init__(self, probe: Probe) -> None:
        self.now_s = 1000.0
        self._clock = probe.publisher(topics.CLOCK)
        probe.node.create_timer(0.01, self._tick)

    def _tick(self) -> None:
        self.now_s += 0.02
        self._clock.publish(Clock(clock=Time(seconds=self.now_s).to_msg()))


def up(probe: Probe, system: System, *settings: str, **parameters: Any) -> Process:
    quick = ["show.start_s=0.2", "show.death_s=0.2", "show.home_retry_s=0.1"]
    process = system.start(NODE, settings=[*quick, *settings], **parameters)
    probe.record(*SAID)
    probe.wait_for(
        lambda: all(probe.values(topic) for topic in SAID if topic is not topics.GAME_EVENT), what="the announcement"
    )
    return process


def serve(probe: Probe, called: list[str]) -> None:
    """Be pellet manager and Clyde: note who is asked to reset."""
    for service in (topics.RESET_PELLETS, topics.RESET_CLYDE):

        def answer(request: Any, response: Any, name: str = service.name) -> Any:
            called.append(name)
            response.success = True
            return response

        service.server(probe.node, answer)


def pellets(probe: Probe, ids: Sequence[int]) -> None:
    probe.publish(topics.PELLET_MARKERS, markers_of({i: (float(i), 0.0) for i in ids}, probe.stamp()))


def status(probe: Probe, word: str) -> None:
    probe.publish(topics.GAME_STATUS, word)


def wait_state(probe: Probe, state: str) -> None:
    probe.wait_for(lambda: probe.values(topics.GAME_STATE)[-1:] == [state], what=f"state {state}")


def running(probe: Probe, count: int = 3) -> None:
    """One round, begun; the pellets are known."""
    assert probe.call(topics.START_GAME).success
    wait_state(probe, "returning_home")
    pellets(probe, range(count))
    probe.wait_for(lambda: probe.values(topics.PELLETS_SPAWNED)[-1] == count, what="the pellets to be counted")
    status(probe, "home_reached")
    wait_state(probe, "running")


def test_everything_latched_is_there_for_whoever_comes_late(probe: Probe, system: System) -> None:
    up(probe, system, "clyde.speed_mps=0.3")
    latest = {topic.name: probe.values(topic)[-1] for topic in SAID if topic is not topics.GAME_EVENT}
    assert latest.pop("clyde/speed") == pytest.approx(0.3)
    assert latest == {
        "game_state": "menu",
        "game_command": "disable",
        "game_result": "",
        "game/score": 0,
        "game/round": 1,
        "game/pellets_spawned": 0,
        "game/pellets_collected": 0,
    }


def test_a_start_resets_pellets_and_clyde_and_is_refused_during_a_game(probe: Probe, system: System) -> None:
    called: list[str] = []
    serve(probe, called)
    up(probe, system)
    assert probe.call(topics.START_GAME).success
    probe.wait_for(lambda: len(called) == 2, what="both resets")
    assert sorted(called) == ["reset_clyde", "reset_pellets"]
    again = probe.call(topics.START_GAME)
    assert not again.success
    assert "returning_home" in again.message
    back = probe.call(topics.RESET_GAME)
    assert back.success
    assert "menu" in back.message
    wait_state(probe, "menu")


def test_pellets_and_clyde_that_come_late_are_reset_all_the_same(probe: Probe, system: System) -> None:
    up(probe, system)
    assert probe.call(topics.START_GAME).success
    called: list[str] = []
    serve(probe, called)
    probe.wait_for(lambda: sorted(called) == ["reset_clyde", "reset_pellets"], what="both resets")


def test_a_report_from_before_the_pellets_were_put_back_is_none_of_the_new_round(probe: Probe, system: System) -> None:
    asked = 0

    def put_back(request: Any, response: Any) -> Any:
        nonlocal asked
        out = probe.publisher(topics.PELLET_MARKERS)
        out.publish(markers_of({4: (4.0, 0.0)}, probe.stamp()))
        assert out.wait_for_all_acked(Duration(seconds=60))  # the referee has it before the answer
        asked += 1
        response.success = True
        return response

    def counted() -> bool:
        pellets(probe, range(3))
        return probe.values(topics.PELLETS_SPAWNED)[-1:] == [3]

    up(probe, system)
    reports = probe.publisher(topics.PELLET_MARKERS)
    probe.wait_for(reports.get_subscription_count, what="the referee's ear")
    topics.RESET_PELLETS.server(probe.node, put_back)
    for called in (1, 3):  # at a start and at each reset
        for topic in SAID:
            probe.heard(topic).clear()
        assert probe.call(topics.START_GAME).success
        probe.wait_for(lambda called=called: asked >= called, what="the pellets to be put back")
        probe.wait_for(counted, what="the pellets to be counted")
        assert probe.call(topics.RESET_GAME).success
        probe.wait_for(lambda called=called: asked > called, what="the pellets to be put back again")
        probe.wait_for(counted, what="the pellets to be counted again")
    assert set(probe.values(topics.PELLETS_SPAWNED)) <= {0, 3}


def test_commands_sent_in_a_burst_all_arrive_even_for_who_comes_late_fault_1(probe: Probe, system: System) -> None:
    up(probe, system)
    for _ in range(4):  # disable, reset_round, return_home; disable, reset_round
        probe.call(topics.START_GAME)
        probe.call(topics.RESET_GAME)
    commands = ["disable", *["disable", "reset_round", "return_home", "disable", "reset_round"] * 4]
    probe.wait_for(lambda: len(probe.values(topics.GAME_COMMAND)) >= len(commands), what="all commands")
    assert probe.values(topics.GAME_COMMAND) == commands
    late: list[str] = []
    topics.GAME_COMMAND.subscription(probe.node, lambda message: late.append(message.data))
    probe.wait_for(lambda: len(late) >= len(commands), what="all commands again")
    assert late == commands


def test_a_stale_report_of_pellets_does_not_keep_the_round_from_completing_fault_7(
    probe: Probe, system: System
) -> None:
    up(probe, system)
    assert probe.call(topics.START_GAME).success
    wait_state(probe, "returning_home")
    pellets(probe, range(9))  # of another map, or of the round before
    probe.wait_for(lambda: probe.values(topics.PELLETS_SPAWNED)[-1] == 9, what="the stale report")
    pellets(probe, (0, 1))
    probe.wait_for(lambda: probe.values(topics.PELLETS_SPAWNED)[-1] == 2, what="the report after it")
    status(probe, "home_reached")
    wait_state(probe, "running")
    status(probe, "pellet_collected:0")
    status(probe, "pellet_collected:1")
    probe.wait_for(lambda: "win" in probe.values(topics.GAME_EVENT), what="the end of the round")
    wait_state(probe, "returning_home")
    assert probe.values(topics.SCORE)[-1] == 2


def test_a_way_home_that_fails_is_tried_again_and_in_the_end_reported_fault_9(probe: Probe, system: System) -> None:
    up(probe, system, "show.home_retries=2")
    running(probe)
    status(probe, "death_detected")
    wait_state(probe, "returning_home")
    for tries in (1, 2, 3):
        probe.wait_for(lambda n=tries: probe.values(topics.GAME_COMMAND).count("return_home") == n + 1, what="a try")
        status(probe, "home_failed")
    wait_state(probe, "menu")
    probe.wait_for(lambda: "home_failed" in probe.values(topics.GAME_RESULT), what="the result")


def test_the_base_speed_of_clyde_can_be_set_in_the_menu(probe: Probe, system: System) -> None:
    up(probe, system)
    for speed in (math.nan, -1.0, 1e30, 0.5):
        probe.publish(topics.BASE_CLYDE_SPEED, speed)
    probe.wait_for(lambda: probe.values(topics.CLYDE_SPEED)[-1] == 0.5, what="Clyde's speed")
    assert all(speed in (0.25, 0.5) for speed in probe.values(topics.CLYDE_SPEED))


def test_messages_that_make_no_sense_change_nothing_and_do_not_fill_the_log(probe: Probe, system: System) -> None:
    process = up(probe, system)
    running(probe)
    for word in ("", "home_reached", "pellet_collected", "pellet_collected:-1", "pellet_collected:1e9", "ä" * 5000) * 3:
        status(probe, word)
    pellets(probe, range(10_001))
    pellets(probe, (-1,))
    probe.publish(topics.PELLET_MARKERS, markers_of({5: (math.nan, 0.0)}, probe.stamp()))
    probe.publish(topics.PELLET_MARKERS, markers_of({5: (1.0, 0.0)}, probe.stamp(), frame="odom"))
    status(probe, "pellet_collected:2")
    probe.wait_for(lambda: probe.values(topics.SCORE)[-1] == 1, what="the one good status")
    probe.wait_for(lambda: "pellet" in probe.values(topics.GAME_EVENT), what="its event")
    assert probe.values(topics.PELLETS_SPAWNED)[-1] == 3
    assert probe.values(topics.GAME_EVENT) == ["reset", "start theatrical", "pellet"]
    assert probe.values(topics.GAME_STATE)[-1] == "running"
    assert process.output.count("\n") < 6
    assert process.stop() == 0


@pytest.mark.parametrize("number", [2, 15])
def test_the_robot_is_told_to_stop_before_the_referee_leaves_fault_13(
    probe: Probe, system: System, number: int
) -> None:
    process = up(probe, system)
    running(probe)
    process.send(number)
    probe.wait_for(lambda: process.popen.poll() is not None, what="the end")
    wait_state(probe, "menu")
    probe.wait_for(lambda: probe.values(topics.GAME_COMMAND)[-1] == "disable", what="the last command")
    probe.wait_for(lambda: probe.values(topics.GAME_EVENT)[-1] == "reset", what="the last event")
    assert process.wait() == 0


def test_a_show_is_not_prolonged_by_a_clock_that_is_set_back(probe: Probe, system: System) -> None:
    clock = SimulatedClock(probe)
    up(probe, system, "show.start_s=2.0", use_sim_time=True)
    assert probe.call(topics.START_GAME).success
    wait_state(probe, "returning_home")
    status(probe, "home_reached")
    wait_state(probe, "starting")
    clock.now_s -= 900.0
    wait_state(probe, "running")
    assert clock.now_s < 500.0  # it would last until 1000


# A game that outlives its node


def killed(process: Process, system: System) -> None:
    process.popen.kill()
    process.popen.wait()
    system.processes.remove(process)


def again(probe: Probe, system: System, **parameters: Any) -> list[tuple[str, Any]]:
    """Start another one and wait for all that it says at first."""
    for topic in SAID:
        probe.heard(topic).clear()
    probe.all.clear()
    up(probe, system, **parameters)
    return [(name, heard.message.data) for name, heard in probe.all]


def test_a_killed_referee_goes_on_with_the_round(probe: Probe, system: System, tmp_path: Path) -> None:
    process = up(probe, system)
    running(probe)
    status(probe, "pellet_collected:1")
    probe.wait_for(lambda: probe.values(topics.SCORE)[-1] == 1, what="the score")
    probe.wait_for(lambda: "pellet" in probe.values(topics.GAME_EVENT), what="the event")
    (kept,) = (tmp_path / "state").rglob("*.json")
    assert kept.name.startswith("robot_15-")
    killed(process, system)
    said = dict(again(probe, system))
    assert said == {
        "game_state": "running",
        "game_command": "enable",
        "game_result": "",
        "game/score": 1,
        "game/round": 1,
        "game/pellets_spawned": 3,
        "game/pellets_collected": 1,
        "clyde/speed": 0.25,
    }
    status(probe, "pellet_collected:1")  # reported once more: it counts once
    for pellet in (0, 2):
        status(probe, f"pellet_collected:{pellet}")
    probe.wait_for(lambda: "win" in probe.values(topics.GAME_EVENT), what="the end of the round")
    assert probe.values(topics.SCORE)[-1] == 3
    status(probe, "home_reached")
    wait_state(probe, "menu")
    killed(system.processes[-1], system)  # between two rounds
    said = dict(again(probe, system))
    assert (said["game_state"], said["game/score"], said["game/round"]) == ("menu", 3, 2)
    assert said["clyde/speed"] == pytest.approx(0.3)
    assert said["game_result"] == "Complete - Score: 3"
    assert probe.call(topics.RESET_GAME).success
    probe.wait_for(lambda: not kept.exists(), what="the game to be forgotten")


def test_a_referee_who_has_not_gone_on_yet_takes_no_report_for_that_of_a_new_game(
    probe: Probe, system: System, tmp_path: Path, domain: int
) -> None:
    file = tmp_path / "game.json"
    game = a_game()
    game["owner"] |= {"domain": str(domain), "simulated": True}
    file.write_text(json.dumps(game))
    probe.record(*SAID)
    system.start(NODE, state_file=str(file), use_sim_time=True)  # there is no clock yet
    pellets(probe, (0, 1))
    status(probe, "home_reached")
    assert probe.publisher(topics.PELLET_MARKERS).wait_for_all_acked(Duration(seconds=60))
    answer = probe.call(topics.START_GAME)
    assert (answer.success, answer.message) == (False, "start: a game is about to be gone on with")
    assert not probe.values(topics.GAME_STATE)
    SimulatedClock(probe)
    wait_state(probe, "returning_home")
    probe.wait_for(lambda: probe.values(topics.PELLETS_SPAWNED), what="the pellets")
    assert set(probe.values(topics.PELLETS_SPAWNED)) == {3}


def test_pellets_reported_to_a_referee_who_has_not_gone_on_yet_count_before_the_end_of_the_round(
    probe: Probe, system: System, tmp_path: Path, domain: int
) -> None:
    file = tmp_path / "game.json"
    referee = RoundController()
    referee.start(0.0)
    for second in (1, 2):
        referee.pellets_left([0, 1, 2], second)
    referee.status("home_reached", 3.0)
    referee.tick(100.0)
    game = a_game(state=referee.snapshot(100.0))
    game["owner"] |= {"domain": str(domain), "simulated": True}
    file.write_text(json.dumps(game))
    probe.record(*SAID)
    system.start(NODE, state_file=str(file), use_sim_time=True)  # there is no clock yet
    for pellet in (0, 1, 2):
        status(probe, f"pellet_collected:{pellet}")
    assert probe.publisher(topics.GAME_STATUS).wait_for_all_acked(Duration(seconds=60))
    assert not probe.call(topics.START_GAME).success  # answered after them
    SimulatedClock(probe)
    status(probe, "game_complete")
    results = lambda: [text for text in probe.values(topics.GAME_RESULT) if text]  # noqa: E731
    probe.wait_for(results, what="the result")
    assert results() == ["Complete - Score: 3"]


@pytest.mark.parametrize("number", [2, 15])
def test_a_referee_who_was_stopped_has_nothing_to_go_on_with(
    probe: Probe, system: System, tmp_path: Path, number: int
) -> None:
    process = up(probe, system)
    running(probe)
    probe.wait_for(lambda: list((tmp_path / "state").rglob("*.json")), what="the file")
    process.send(number)
    probe.wait_for(lambda: process.popen.poll() is not None, what="the end")
    assert not list((tmp_path / "state").rglob("*.json"))


def a_game(**changes: Any) -> dict[str, Any]:
    """A file's content, of a robot on its way home."""
    game = RoundController()
    game.start(0.0)
    game.pellets_left([0, 1, 2], 0.0)
    state = game.snapshot(0.0)
    domain = {"namespace": "/robot_15", "domain": "", "simulated": False}
    return {"format": 3, "written_s": time.time(), "owner": domain, "state": state} | changes


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        ({"written_s": 1.0}, ""),
        ({"owner": {"namespace": "/robot_7"}}, ""),
        ({"state": {"state": "running"}}, "snapshot.score is missing"),
        ({"state": [1]}, "snapshot = [1]: must be an object"),
        ({"format": 1}, "another version"),
    ],
)
def test_a_game_that_is_old_or_strange_is_not_gone_on_with(
    probe: Probe, system: System, tmp_path: Path, domain: int, change: dict[str, Any], complaint: str
) -> None:
    file = tmp_path / "game.json"
    game = a_game(**change)
    if "namespace" not in change.get("owner", {}):
        game["owner"]["domain"] = str(domain)
    text = json.dumps(game)
    file.write_text(text)
    process = up(probe, system, state_file=str(file))
    wait_state(probe, "menu")
    assert process.output.count("is left alone") == bool(complaint)
    assert complaint in process.output
    if complaint:
        running(probe)
        assert file.read_text() == text
    else:
        assert not file.exists()


def test_nothing_is_kept_where_none_is_wanted_and_no_folder_stops_a_game(
    probe: Probe, system: System, tmp_path: Path
) -> None:
    process = up(probe, system, state_file="''")
    running(probe)
    assert not list(tmp_path.rglob("*.json"))
    assert process.stop() == 0
    (tmp_path / "file").touch()
    process = up(probe, system, state_file=str(tmp_path / "file" / "game.json"))
    probe.wait_for(lambda: probe.values(topics.GAME_STATE)[-1] == "menu", what="the menu")
    running(probe)
    status(probe, "pellet_collected:1")
    probe.wait_for(lambda: probe.values(topics.SCORE)[-1] == 1, what="the score")
    assert process.output.count("a game is lost with this node") == 1


def test_a_collected_pellet_that_is_shown_again_is_removed_again(probe: Probe, system: System) -> None:
    up(probe, system)
    running(probe)
    probe.record(topics.REMOVE_PELLET)
    probe.wait_for(lambda: probe.node.count_publishers("/robot_15/remove_pellet"), what="the referee's voice")
    status(probe, "pellet_collected:1")
    probe.wait_for(lambda: probe.values(topics.SCORE)[-1] == 1, what="the score")

    def removed() -> list[int]:
        pellets(probe, (0, 1, 2))
        return probe.values(topics.REMOVE_PELLET)

    assert probe.wait_for(removed, what="the removal")[0] == 1
