"""Tasks on Ray."""

from collections.abc import Iterator

import pytest

pytest.importorskip("ray")

from pacman_env.executors import ray_cluster
from pacman_env.executors.base import Executor, TaskFailed
from pacman_env.executors.ray_cluster import RayCluster
from tests.executors import functions
from tests.executors.contract import ProcessesContract


@pytest.fixture(scope="module")
def cluster() -> Iterator[RayCluster]:
    with RayCluster(workers=2) as made:
        yield made


class TestRayCluster(ProcessesContract):
    @pytest.fixture
    def executor(self, cluster: RayCluster) -> Executor:
        return cluster


def test_worker_with_other_sources_ends_the_run(cluster: RayCluster, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ray_cluster, "__version__", "0.0.1")
    with pytest.raises(TaskFailed, match=r"worker on \S+: pacman_env [\d.]+, sources \w+; the command has 0\.0\.1"):
        cluster.map(functions.double, [1])


def test_second_cluster_is_refused(cluster: RayCluster) -> None:
    with pytest.raises(ValueError, match="is connected to a cluster already"):
        RayCluster()
