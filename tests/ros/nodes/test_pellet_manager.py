"""The pellets on the map: shown, taken away, put back."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

pytest.importorskip("rclpy")

from pacman_env.config import PelletConfig
from pacman_env.game.pellets import generate_pellets
from pacman_env.ros import topics
from pacman_env.ros.messages import pellets_of, seconds_of
from pacman_env.world.maps.occupancy import load_map
from tests.ros.clock import SimulatedClock

if TYPE_CHECKING:
    from tests.ros.system import Probe, Process, System

NODE = "pacman_env.ros.nodes.pellet_manager"


def up(probe: Probe, system: System) -> Process:
    process = system.start(NODE, map_yaml="house")
    probe.record(topics.PELLET_MARKERS)
    probe.wait_for(lambda: probe.heard(topics.PELLET_MARKERS), what="the first pellets")
    return process


def shown(probe: Probe) -> dict[int, tuple[float, float]]:
    return pellets_of(probe.messages(topics.PELLET_MARKERS)[-1])


def test_the_pellets_are_those_of_the_rule_once_a_second(probe: Probe, system: System) -> None:
    system.start(NODE, map_yaml="house", use_sim_time=True)
    probe.record(topics.PELLET_MARKERS)
    clock = SimulatedClock(probe, "pellet_manager")
    clock.advance(3.0, 0.1)
    probe.wait_for(lambda: len(probe.heard(topics.PELLET_MARKERS)) >= 3, what="three reports")
    rule = generate_pellets(load_map("house"), PelletConfig())
    pellets = shown(probe)
    assert list(pellets) == rule.ids.tolist()
    for i, at in zip(rule.ids, rule.position, strict=True):
        assert pellets[int(i)] == pytest.approx(tuple(at))
    stamps = [seconds_of(message.markers[-1].header.stamp) for message in probe.messages(topics.PELLET_MARKERS)]
    assert np.diff(stamps)[-2:] == pytest.approx(1.0, abs=0.11)


def test_a_pellet_that_is_taken_is_gone_at_once_and_a_reset_puts_all_back(probe: Probe, system: System) -> None:
    up(probe, system)
    everything = shown(probe)
    for i in (3, 0):
        probe.publish(topics.REMOVE_PELLET, i)
    probe.wait_for(lambda: 0 not in shown(probe), what="the removal")
    assert set(everything) - set(shown(probe)) == {0, 3}
    answer = probe.call(topics.RESET_PELLETS)
    assert answer.success
    assert answer.message == f"{len(everything)} pellets"
    probe.wait_for(lambda: shown(probe) == everything, what="all of them")


def test_foreign_ids_are_ignored_and_said_once(probe: Probe, system: System) -> None:
    process = up(probe, system)
    everything = shown(probe)
    for i in (-1, 99, 2**31 - 1, -(2**31), 99):
        probe.publish(topics.REMOVE_PELLET, i)
    probe.publish(topics.REMOVE_PELLET, 1)
    probe.publish(topics.REMOVE_PELLET, 1)  # said twice is no trouble
    probe.wait_for(lambda: 1 not in shown(probe), what="the removal after them")
    assert set(everything) - set(shown(probe)) == {1}
    assert process.output.count("is not one of this map's") == 1


@pytest.mark.parametrize("source", ["nowhere.yaml", "/dev/null"])
def test_a_map_that_cannot_be_read_is_said_in_one_line(system: System, source: str) -> None:
    process = system.start(NODE, map_yaml=source)
    assert process.wait(60.0) == 2
    system.processes.clear()
    assert process.output.startswith("pellet_manager: ")
    assert source in process.output
    assert process.output.count("\n") == 1
