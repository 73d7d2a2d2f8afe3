"""What tests with ROS get: nodes that end with the test, a probe that records everything; ``domain`` is above."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from tests.ros.selector_game import Game
    from tests.ros.session import Session
    from tests.ros.simulated_robot.driven import Robot
    from tests.ros.system import Probe, System

NEEDED = ("rclpy", "irobot_create_msgs", "nav2_msgs")
WITHOUT_ROS = ("test_sim_faults.py", "test_game_lock.py", "test_processes.py", "test_launch.py")
ABSENT = [name for name in NEEDED if find_spec(name) is None]
if "rclpy" in ABSENT and os.environ.get("CI"):
    raise RuntimeError("rclpy is absent: in CI the tests with ROS must run")
collect_ignore = [
    str(path) for path in Path(__file__).parent.rglob("test_*.py") if ABSENT and path.name not in WITHOUT_ROS
]


def pytest_report_header() -> str:
    return f"tests/ros: most are left out, without {', '.join(ABSENT)}" if ABSENT else "tests/ros: all"


@pytest.fixture
def system(domain: int, tmp_path: Path) -> Iterator[System]:
    """Starts nodes as processes; stops them, one after another, at the end of the test."""
    from tests.ros.system import System

    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))  # a game is not gone on with in the next test
        with System(tmp_path) as system:
            yield system


@pytest.fixture
def probe(system: System) -> Iterator[Probe]:
    """A node of the test process that hears and says everything."""
    from tests.ros.system import Probe

    with Probe(system) as probe:
        yield probe


@pytest.fixture
def nodes(domain: int, tmp_path: Path) -> Iterator[Session]:
    """A session, to which the test adds nodes."""
    from tests.ros import session

    with session.nodes(tmp_path) as nodes:
        yield nodes


@pytest.fixture
def game(nodes: Session) -> Game:
    """What is around a goal selector; the test starts the node."""
    from tests.ros.selector_game import Game

    return Game(nodes)


@pytest.fixture
def make_robot(domain: int, tmp_path: Path) -> Iterator[Callable[..., Robot]]:
    """Makes the simulated robot's node in the two rooms with the parameters given; it gives the time."""
    from tests.ros import session
    from tests.ros.simulated_robot.driven import Robot

    with ExitStack() as stack:

        def make(**parameters: object) -> Robot:
            robot = stack.enter_context(session.nodes(tmp_path, session=Robot))
            robot.begin(**parameters)
            return robot

        yield make


@pytest.fixture
def robot(make_robot: Callable[..., Robot]) -> Robot:
    """The simulated robot's node without further parameters."""
    return make_robot()


@pytest.fixture
def log(capfd: pytest.CaptureFixture[str]) -> Callable[[], str]:
    """Returns all that the nodes of this process have logged so far in the test."""
    texts: list[str] = []

    def read() -> str:
        texts.append(capfd.readouterr().err)
        return "".join(texts)

    return read
