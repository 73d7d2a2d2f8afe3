"""Settings that hold for every test."""

import signal

import pytest
from hypothesis import HealthCheck, settings

# The first example of a kernel compiles it, and the machine may be busy: the time of an example says nothing.
settings.register_profile("kernels", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("kernels")

# A shell's job in the background is born with Ctrl-C ignored, and so would be the processes that tests send it to.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

#: Files that take longest, by what they wait for: begun first, so that none is left to run alone at the end.
LONGEST = (
    *("ros/test_whole_game.py", "test_package.py", "ros/test_killed_nodes.py", "ros/supervisor/test_up.py"),
    *("ros/original/test_mixed_graph.py", "ros/test_package.py", "ros/bags/test_recover.py"),
    *("test_other_python.py", "ros/campaign/test_campaign.py"),
    *("train/test_adversary.py", "envs/test_promises.py", "ros/simulated_robot/test_sim_robot.py"),
)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """The files in ``LONGEST`` first, in its order; the others stay as they are."""

    def place(item: pytest.Item) -> int:
        path = item.path.as_posix()
        return next((k for k, name in enumerate(LONGEST) if path.endswith(f"tests/{name}")), len(LONGEST))

    items.sort(key=place)
