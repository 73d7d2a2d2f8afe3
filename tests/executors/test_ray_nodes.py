"""A cluster of two machines, which are two nodes of Ray on this one."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

pytest.importorskip("ray")

from ray.cluster_utils import Cluster

from pacman_env.executors.ray_cluster import RayCluster
from tests.executors import functions

pytestmark = pytest.mark.daily


@pytest.fixture
def cluster() -> Iterator[Cluster]:
    made = Cluster(initialize_head=True, head_node_args={"num_cpus": 1})
    yield made
    made.shutdown()


def test_a_machine_that_is_lost_and_one_that_joins_change_no_result(cluster: Cluster) -> None:
    lost = cluster.add_node(num_cpus=1)
    with RayCluster(cluster.address) as executor:
        assert executor.workers == 2
        ends = executor.run(functions.slow_double, range(40))
        found = {done.number: done.result() for done in (next(ends), next(ends))}
        cluster.remove_node(lost, allow_graceful=False)
        cluster.add_node(num_cpus=2)
        found |= {done.number: done.result() for done in ends}
        assert found == {number: 2 * number for number in range(40)}
        assert executor.workers >= 3  # 4 until the loss is noticed
