"""Tasks on Ray."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("ray")

from pacman_env.episodes.rollout import episode_seeds
from pacman_env.evaluation.rounds.matchups import Matchup, play_all
from pacman_env.executors import ray_cluster
from pacman_env.executors.executor import Executor, InProcess, TaskFailed
from pacman_env.executors.ray_cluster import RayCluster
from tests.evaluation.helpers import CONFIG, copy_planners
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
        list(cluster.map(functions.double, [1]))


def test_rounds_on_ray_equal_rounds_in_process(
    cluster: RayCluster, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    copy_planners(tmp_path)
    monkeypatch.chdir(tmp_path)  # relative paths name the files of the command's folder
    matchups = [Matchup("mine.yaml", CONFIG, policy, episode_seeds(5, 6)) for policy in ("nearest", "own.onnx")]
    for (records, _), (expected, _) in zip(play_all(matchups, cluster), play_all(matchups, InProcess()), strict=True):
        np.testing.assert_array_equal(records, expected)


def test_second_cluster_is_refused(cluster: RayCluster) -> None:
    with pytest.raises(ValueError, match="is connected to a cluster already"):
        RayCluster()
