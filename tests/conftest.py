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

#: Files that take longest: begun first, so that none is left to run alone at the end.
LONGEST = (
    *("ros/operator_page/test_page_process.py", "ros/supervisor/test_up.py"),
    *("ros/test_package.py", "ros/bags/test_recover.py"),
    *("ros/campaign/test_robot_rounds.py", "ros/campaign/test_campaign.py", "ros/simulated_robot/test_sim_robot.py"),
    *("test_other_python.py", "web/test_page.py", "test_package.py", "benchmarks/test_web_load.py"),
    *("clients/test_scripts.py", "envs/test_promises.py", "system/test_memory.py", "web/test_page_accessible.py"),
    *("envs/test_judges.py", "engine/test_threads.py", "training/test_adversary.py", "web/test_simulated.py"),
    *("evaluation/test_benchmark.py", "training/test_ppo.py", "evaluation/report/test_report.py"),
    *("ros/supervisor/test_operating.py", "system/test_kills.py"),
)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """The files in ``LONGEST`` first, in its order; the others stay as they are."""

    def place(item: pytest.Item) -> int:
        path = item.path.as_posix()
        return next((k for k, name in enumerate(LONGEST) if path.endswith(f"tests/{name}")), len(LONGEST))

    items.sort(key=place)
