"""Settings that hold for every test."""

import gc
import os
import signal
from collections.abc import Callable, Generator, Iterator
from pathlib import Path
from unittest import mock

import pytest
from hypothesis import HealthCheck, settings

# The first example of a kernel compiles it, and the machine may be busy: the time of an example says nothing.
settings.register_profile("kernels", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("kernels")

# A shell's job in the background is born with Ctrl-C ignored, and so would be the processes that tests send it to.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

#: Files that take longest: begun first, so that none is left to run alone at the end.
LONGEST = (
    *("ros/supervisor/test_up.py", "docs/test_site.py"),
    *("ros/supervisor/test_operating.py", "ros/supervisor/test_nav2.py", "training/test_labels.py"),
    *("ros/test_package.py", "ros/simulated_robot/test_sim_robot.py"),
    *("test_other_python.py", "web/test_page.py", "test_package.py"),
    *("clients/test_scripts.py", "envs/test_contract.py", "system/test_memory.py", "web/test_page_accessible.py"),
    *("envs/test_judges.py", "engine/test_threads.py", "web/test_simulated.py"),
    *("training/test_train.py", "evaluation/compare/test_html_page.py", "browser_game/test_rounds.py"),
)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """The files in ``LONGEST`` first, in its order; the others stay as they are."""

    def place(item: pytest.Item) -> int:
        path = item.path.as_posix()
        return next((k for k, name in enumerate(LONGEST) if path.endswith(f"tests/{name}")), len(LONGEST))

    items.sort(key=place)


def pytest_collection_finish() -> None:
    """Modules and collected tests stay to the end: no collection of garbage looks at them again."""
    gc.freeze()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call() -> Generator[None, None, None]:
    """What a test changes in the environment, such as the domain of its nodes, ends with it."""
    with mock.patch.dict(os.environ):
        yield


@pytest.fixture
def refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Callable[[Callable[[list[str]], int], list[str], str], None]:
    """Check that a command, run in ``tmp_path``, says in one line what is wrong and leaves no file there."""

    def check(main: Callable[[list[str]], int], arguments: list[str], message: str) -> None:
        files = [path for path in sorted(tmp_path.rglob("*")) if path.is_file()]
        monkeypatch.chdir(tmp_path)
        try:
            status = main(arguments)
        except SystemExit as stop:
            status = stop.code  # type: ignore[assignment]
        out, err = capsys.readouterr()
        assert (status, out) == (2, "")
        assert message in err
        assert len(err.splitlines()) == 1
        assert [path for path in sorted(tmp_path.rglob("*")) if path.is_file()] == files

    return check


@pytest.fixture(scope="session")
def domain(tmp_path_factory: pytest.TempPathFactory) -> Iterator[int]:
    """A ROS_DOMAIN_ID that no other test process has, on this machine alone; nobody waits long for the middleware."""
    from tests.ros.system import free_domain

    with free_domain() as number, pytest.MonkeyPatch.context() as patch:
        patch.setenv("ROS_DOMAIN_ID", str(number))
        patch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        patch.setenv("FASTRTPS_DEFAULT_PROFILES_FILE", str(Path(__file__).parent / "ros" / "quick_middleware.xml"))
        patch.setenv("ROS_LOG_DIR", str(tmp_path_factory.mktemp("ros_log")))
        patch.setenv("XDG_STATE_HOME", str(tmp_path_factory.mktemp("state")))  # where the referee keeps a game
        yield number
