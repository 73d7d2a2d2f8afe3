"""The child process that runs policies: whatever a policy does, the game goes on and the policy starts again."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from itertools import accumulate
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from pacman_env.config import Config, make_config
from pacman_env.levels.assets import map_assets
from pacman_env.levels.level import COARSE_MAP
from pacman_env.observations.robot_view import RobotView
from pacman_env.observations.situation import Situation, maps_of
from pacman_env.policies.registry import make_policy
from pacman_env.ros.heartbeat import is_running
from pacman_env.ros.selector import policy_child, policy_process
from pacman_env.ros.selector.policy_child import ROBOT, Answer, PolicySetup, rehearse
from pacman_env.ros.selector.policy_process import PolicyProcess
from tests.ros.selector import faulty_policy
from tests.waiting import wait_for

FAULTY = f"{faulty_policy.__name__}:Faulty"
BLOCKED_S = 1.0  # on a busy machine; a caller that waits for the policy waits longer


def house() -> tuple[RobotView, Config]:
    config = make_config("robot")
    return RobotView(map_assets("house", config), config), config


def situation() -> Situation:
    return house()[0].sample_situation()


class Asked:
    """A process, what it reports, the longest time for which a call blocks, and a clock that can be advanced."""

    def __init__(self, policy: str = FAULTY) -> None:
        self.reports: list[str] = []
        self.longest_s = self.later_s = 0.0
        self.failures = 0
        self.process = PolicyProcess(PolicySetup(policy, "house", "robot", "robust", []), self.reports.append)

    @property
    def troubles(self) -> list[str]:
        return [text for text in self.reports if text]

    def poll(self) -> Answer | None:
        begin_s = time.monotonic()
        answer = self.process.poll()
        self.longest_s = max(self.longest_s, time.monotonic() - begin_s)
        self.failures += answer is not None and bool(answer.error)
        return answer

    def choice(self, seen: Situation) -> Answer:
        wait_for(lambda: self.poll() or self.process.ready)
        begin_s = time.monotonic()
        self.process.ask(ROBOT, seen, True)
        self.longest_s = max(self.longest_s, time.monotonic() - begin_s)
        answer = wait_for(self.poll)
        assert answer is not None
        return answer


@pytest.fixture(scope="module")
def fault(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """The file that names the fault."""
    file = tmp_path_factory.mktemp("policy") / "fault"
    file.write_text("")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(faulty_policy.FAULT_FILE, str(file))
        yield file


@pytest.fixture(scope="module")
def asked(fault: Path) -> Iterator[Asked]:
    """A process whose failures are long ago whenever it is asked."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(policy_process, "SLOW_S", 0.2)
        asked = Asked()
        clock = SimpleNamespace(monotonic=lambda: time.monotonic() + asked.later_s, sleep=time.sleep)
        patch.setattr(policy_process, "time", clock)
        yield asked
        asked.process.close()


@pytest.mark.parametrize(
    ("name", "words"),
    [
        *(("raises", "no such goal"), ("sleeps", "takes more than"), ("loops", "takes more than")),
        *(("exits", "status 7"), ("ends", "status 7"), ("fills the memory", "MemoryError")),
        *(("sends half an answer", "half an answer"), ("sends a wrong answer", "half an answer")),
    ],
)
def test_faulty_policy_is_reported_once_and_started_again(asked: Asked, fault: Path, name: str, words: str) -> None:
    seen = situation()
    assert not asked.choice(seen).error
    restarts = asked.process.restarts
    asked.reports.clear()
    asked.later_s += 100.0
    fault.write_text(name)
    answer = asked.choice(seen)
    fault.write_text("")
    assert words in answer.error
    assert not asked.process.ready
    assert len(asked.troubles) == 1
    assert FAULTY in asked.troubles[0]
    assert not asked.choice(seen).error
    assert len(asked.troubles) == 1
    assert asked.reports[-1] == "", "the trouble is over"
    assert asked.process.restarts == restarts + 1
    assert asked.longest_s < BLOCKED_S


def test_reasons_that_json_cannot_express_leave_choice(asked: Asked, fault: Path) -> None:
    assert not asked.choice(situation()).error
    fault.write_text("explains by place")
    asked.process.ask(ROBOT, situation(), False, why=True)
    answer = wait_for(asked.poll)
    fault.write_text("")
    assert answer is not None
    assert answer.unexplained
    assert not answer.error


def test_pauses_between_starts_grow(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "executable", "/bin/false")  # a process that ends at once
    now = SimpleNamespace(s=1000.0)
    monkeypatch.setattr(policy_process, "time", SimpleNamespace(monotonic=lambda: now.s, sleep=time.sleep))
    asked = Asked()
    pauses: list[float] = []
    for number in range(1, 7):
        wait_for(lambda number=number: asked.failures == number or asked.poll())
        since_s = now.s
        asked.poll()
        while asked.process.restarts < number:
            now.s += 0.5
            asked.poll()
        pauses.append(now.s - since_s)
    assert pauses == [0.0, 1.0, 2.0, 4.0, 8.0, 10.0]
    asked.process.close()


def test_idle_policy_is_started_again_after_its_death() -> None:
    asked = Asked("nearest")
    asked.process.wait()
    os.kill(asked.process.process.pid, signal.SIGKILL)
    wait_for(lambda: asked.poll() is None and asked.process.restarts == 1)
    asked.process.wait()
    asked.process.close()
    assert not asked.troubles


@pytest.mark.parametrize(("policy", "words"), [("no_such_policy", "no_such_policy"), (FAULTY, "no such goal")])
def test_unusable_policy_is_refused_with_reason(fault: Path, policy: str, words: str) -> None:
    fault.write_text("raises")
    with pytest.raises(ValueError, match=words):
        Asked(policy).process.wait()
    fault.write_text("")


PARENT = f"""
import os, signal
from pathlib import Path
from {__name__} import Asked, ROBOT, situation
process = Asked().process
process.wait()
Path(os.environ["{faulty_policy.FAULT_FILE}"]).write_text("loops")
process.ask(ROBOT, situation(), True)
print(process.process.pid, flush=True)
os.kill(os.getpid(), signal.SIGKILL)
"""


def test_killed_parent_takes_its_policy_along(fault: Path) -> None:
    parent = subprocess.run([sys.executable, "-c", PARENT], stdout=subprocess.PIPE, check=False)
    fault.write_text("")
    assert parent.returncode == -signal.SIGKILL
    wait_for(lambda: not is_running(int(parent.stdout)))


# The rehearsal before a game


def test_rehearsal_prepares_map_that_predicts_chase() -> None:
    """Its kernels take half a minute to compile, in which a game would stand still."""
    view, config = house()
    (level,) = maps_of(view.sample_situation()).levels(np.array([0]))
    assert level.find(COARSE_MAP) is None
    rehearse(make_policy("ppo"), view, config)
    assert level.find(COARSE_MAP) is not None


def ticking(first_s: float, later_s: float) -> Callable[[], float]:
    """Return a clock on which the first two choices take ``first_s`` and all others ``later_s``."""
    times_s = accumulate([0.0, first_s, 0.0, first_s, *[0.0, later_s] * 9])
    return lambda: next(times_s)


def test_policy_that_is_always_slow_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    (view, config), policy = house(), make_policy("nearest")
    clock = SimpleNamespace(perf_counter=ticking(60.0, 0.5))
    monkeypatch.setattr(policy_child, "time", clock)
    assert rehearse(policy, view, config) is policy
    clock.perf_counter = ticking(60.0, 3.0)
    with pytest.raises(ValueError, match="nearest"):
        rehearse(policy, view, config)
