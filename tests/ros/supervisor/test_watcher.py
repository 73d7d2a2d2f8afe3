"""The watcher, and processes that beat as a game does."""

import signal
import sys
from pathlib import Path

import pytest
from action_msgs.srv import CancelGoal

from pacman_env.ros import topics
from pacman_env.ros.game_nodes import WATCHER, module_of
from tests.ros.system import PATIENCE_S, Probe, Process, System
from tests.waiting import wait_for

BEATS = """
import os, sys, time
from pacman_env.ros.heartbeat import HEART, watcher_address
HEART.send_to(watcher_address("/robot_15", int(os.environ["ROS_DOMAIN_ID"])))
HEART.beat()
print("beats", flush=True)
while not os.path.exists(sys.argv[1]):
    HEART.beat()
    time.sleep(0.05)
HEART.beat(0)
"""


@pytest.fixture
def canceled(probe: Probe, system: System) -> list[CancelGoal.Request]:
    """What Nav2 is asked to cancel; a watcher runs."""
    requests: list[CancelGoal.Request] = []

    def cancel(request: CancelGoal.Request, response: CancelGoal.Response) -> CancelGoal.Response:
        requests.append(request)
        return response

    probe.node.create_service(CancelGoal, f"{topics.NAVIGATE_TO_POSE.name}/_action/cancel_goal", cancel)
    probe.record(topics.CMD_VEL)
    system.start(module_of(WATCHER))
    probe.answered_by(f"{system.namespace}/{WATCHER}")
    return requests


def beating(system: System, farewell: Path) -> Process:
    """A process that beats until the file exists, and then says farewell."""
    process = system.run("beats", [sys.executable, "-c", BEATS, str(farewell)])
    wait_for(lambda: "beats" in process.output, "the first beat")
    return process


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP], ids=lambda number: number.name)
def test_robot_is_halted_when_game_is_lost(
    number: int, system: System, probe: Probe, canceled: list[CancelGoal.Request], tmp_path: Path
) -> None:
    farewell = tmp_path / "farewell"
    ended, game = beating(system, farewell), beating(system, tmp_path / "never")
    farewell.touch()
    assert ended.wait() == 0
    system.processes.remove(game)
    game.send(number)
    probe.wait_for(lambda: canceled and probe.messages(topics.CMD_VEL), what="the halt")
    assert {bytes(request.goal_info.goal_id.uuid) for request in canceled} == {bytes(16)}, "every goal"
    for message in probe.messages(topics.CMD_VEL):
        assert (message.twist.linear.x, message.twist.angular.z) == (0.0, 0.0)
    assert game.wait() == -signal.SIGKILL, "a frozen game is ended"
    watcher = system.processes[0]
    assert str(game.popen.pid) in watcher.output
    assert str(ended.popen.pid) not in watcher.output, "it has said farewell"


def test_second_watcher_is_refused(system: System, canceled: list[CancelGoal.Request]) -> None:
    second = system.start(module_of(WATCHER))
    assert second.wait(PATIENCE_S) == 2
    system.processes.remove(second)
