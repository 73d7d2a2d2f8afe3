"""A cluster of two machines, which are two nodes of Ray on this one, each with an environment of its own."""

import logging
import shutil
import time
import urllib.request
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import pytest

pytest.importorskip("ray")

from ray.cluster_utils import Cluster

from pacman_env.episodes.rollout import episode_seeds
from pacman_env.evaluation.rounds.kept import KeptRounds
from pacman_env.evaluation.rounds.play import Matchup, play_all
from pacman_env.executors.base import InProcess, TaskFailed
from pacman_env.executors.ray_cluster import RayCluster
from pacman_env.policies.learned import PRETRAINED
from tests.evaluation.helpers import CONFIG
from tests.executors import functions

pytestmark = [
    pytest.mark.daily,
    pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning"),  # sockets that Ray's Cluster leaves
    pytest.mark.filterwarnings("ignore::ResourceWarning"),
]

ROOT = Path(__file__).resolve().parents[2]
PLUGIN = """\
import os, time
from pacman_env.heuristics.simple import Nearest


class Mine(Nearest):
    def select(self, situation):
        time.sleep(float(os.environ.get("SLOW_S", 0)))
        return super().select(situation)
"""


@pytest.fixture
def cluster(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Cluster]:
    """One node with what the command has, a package of plug-ins among it."""
    plugins = tmp_path / "plugins"
    plugins.mkdir()
    (plugins / "other_package.py").write_text(PLUGIN)
    monkeypatch.chdir(tmp_path)  # Ray's workers import from the command's folder, too
    monkeypatch.syspath_prepend(plugins)
    monkeypatch.setenv("PYTHONPATH", f"{plugins}:{ROOT}")
    monkeypatch.setenv("SLOW_S", "0.1")  # so that there are tasks left for a machine that joins
    made = Cluster(initialize_head=True, head_node_args={"num_cpus": 1})
    monkeypatch.delenv("SLOW_S")
    yield made
    made.shutdown()


def test_lost_and_joined_machines_change_no_result(cluster: Cluster, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO, "pacman_env.executors")
    lost = cluster.add_node(num_cpus=1)
    with RayCluster(cluster.address) as executor:
        assert executor.workers == 2
        ends = executor.run(functions.slow_double, range(40))
        found = {done.number: done.result() for done in (next(ends), next(ends))}
        cluster.remove_node(lost, allow_graceful=False)
        joined = cluster.add_node(num_cpus=2)
        found |= {done.number: done.result() for done in ends}
        assert found == {number: 2 * number for number in range(40)}
        assert (executor.progress.done, executor.progress.waiting) == (40, 0)
        while executor.workers != 3:  # Ray notices the loss after some seconds
            executor.map(functions.slow_double, range(4))
    told = [record.getMessage() for record in caplog.records]
    assert sum(f"(node {joined.node_id[:12]}) joined: " in line for line in told) == 1
    assert sum(f"(node {lost.node_id[:12]}) was lost: " in line for line in told) == 1
    assert sum("its worker was lost, it is done again: " in line for line in told) == executor.progress.lost


def other_sources(folder: Path) -> dict[str, str]:
    shutil.copytree(ROOT / "pacman_env", folder / "changed" / "pacman_env")
    with (folder / "changed" / "pacman_env" / "episodes" / "rollout.py").open("a") as file:
        file.write("# changed\n")
    return {"PYTHONPATH": str(folder / "changed")}


def no_plugin(folder: Path) -> dict[str, str]:
    return {"PYTHONPATH": str(ROOT)}


@pytest.mark.parametrize(
    ("environment", "reason"),
    [
        (other_sources, r": pacman_env [\d.]+, sources \w+; the command has [\d.]+, sources \w+: install the same"),
        (no_plugin, r": policy 'other_package:Mine': "),
    ],
)
def test_failing_machine_is_named_and_results_kept(
    environment: Callable[[Path], dict[str, str]],
    reason: str,
    cluster: Cluster,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("pacman_env.evaluation.rounds.play._LARGEST_PIECE", 4)
    seeds = episode_seeds(5, 24)
    ghosts = ("wander", str(PRETRAINED.with_name("clyde.onnx")))  # a file that is sent
    blocks = [Matchup("house", CONFIG.with_fields(**{"clyde.ghosts": ghosts}), "other_package:Mine", seeds)]
    expected = play_all(blocks, InProcess())
    bad: list[Any] = []
    folder = tmp_path / "parts"
    folder.mkdir()

    def join(ended: int) -> None:
        """With the first rounds that have ended."""
        if not bad:
            bad.append(cluster.add_node(num_cpus=1, env_vars=environment(tmp_path)))

    with RayCluster(cluster.address) as executor, pytest.raises((TaskFailed, OSError), match=reason) as failed:
        KeptRounds(folder, blocks, resume=True).play(executor, join)
    line = str(failed.value)
    assert line.startswith("worker on ")
    assert "\n" not in line
    assert f"(node {bad[0].node_id[:12]})" in line
    kept = {path: path.stat().st_mtime_ns for path in folder.iterdir()}
    assert kept
    cluster.remove_node(bad[0])
    cluster.add_node(num_cpus=1)  # as the command has it
    rounds, ended = KeptRounds(folder, blocks, resume=True), []
    assert 0 < rounds.left < len(seeds)
    with RayCluster(cluster.address) as executor:
        found = rounds.play(executor, ended.append)
    assert sum(ended) == rounds.left
    for (records, _), (whole, _) in zip(found, expected, strict=True):
        np.testing.assert_array_equal(records, whole)
    assert {path: path.stat().st_mtime_ns for path in kept} == kept


def test_counts_are_metrics_of_the_cluster(cluster: Cluster) -> None:
    pytest.importorskip("opentelemetry.exporter.prometheus", reason="needs ray[default]")
    head = cluster.head_node
    with RayCluster(cluster.address) as executor:
        executor.map(functions.double, range(20))
        for _ in range(60):  # they are sent every 10 s
            with urllib.request.urlopen(f"http://{head.node_ip_address}:{head.metrics_export_port}/metrics") as answer:
                lines = answer.read().decode().splitlines()
            found = {line.partition("{")[0]: line.rpartition(" ")[2] for line in lines if "pacman_env" in line}
            if found.get("ray_pacman_env_tasks_done_total") == "20.0":
                break
            time.sleep(1.0)
    assert found["ray_pacman_env_tasks_done_total"] == "20.0"
    assert found["ray_pacman_env_tasks_waiting"] == "0.0"
    assert found["ray_pacman_env_workers"] == "1.0"


def test_cluster_is_new_without_an_address(cluster: Cluster) -> None:
    with RayCluster(workers=2) as executor:
        assert executor.workers == 2
        assert executor.map(functions.double, [4]) == [8]


def test_cluster_without_machines_ends_the_run() -> None:
    with RayCluster(workers=1) as executor:
        ends = executor.run(functions.slow_double, range(1000))
        next(ends)
        (node,) = (process for process in psutil.Process().children(recursive=True) if process.name() == "raylet")
        node.kill()
        with pytest.raises(ConnectionError, match="no machine of the cluster is left"):
            list(ends)
