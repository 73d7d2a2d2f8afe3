"""PettingZoo's own tests find no fault with the multi-agent environment, under any value of any argument."""

from __future__ import annotations

import itertools
import random
import sys
import time
import types
import warnings
from types import SimpleNamespace
from typing import Any

import pytest

import pacman_env
from tests.envs.test_pettingzoo_interfaces import SHAPES

with warnings.catch_warnings():
    # PettingZoo's tests import its own environments in its old way.
    warnings.filterwarnings("ignore", "The old environment creation API has been deprecated", DeprecationWarning)
    from pettingzoo.test import (
        api_test,
        max_cycles_test,
        parallel_api_test,
        parallel_seed_test,
        performance_benchmark,
        render_test,
        seed_test,
        state_test,
    )

FIELDS: dict[str, list[Any]] = {
    "ghosts": [("policy",), ("policy", "policy"), ("wander", "policy"), ("policy", "chase", "arcade", "policy")],
    "observation": ["features", ("scan", "grid"), ("features", "scan", "grid")],
    "zero_sum": [True, False],
    "action": ["goal", "velocity"],
    "map": ["house", "generated"],
    "preset": ["robot", "ideal"],
    "endless": [False, True],
    "execution.rules": ["robust", "as_built"],
}
SETTINGS = ("zero_sum", "endless", "execution.rules")
#: Episodes end within the judges' patience, in more ways than one.
SHORT = {"time_limit_s": 6.0, "clyde.speed_mps": 0.6}


def pairwise() -> list[dict[str, Any]]:
    """A few combinations in which every two values of two fields meet."""
    rows = list(itertools.product(*(range(len(values)) for values in FIELDS.values())))
    pairs = {row: set(itertools.combinations(enumerate(row), 2)) for row in rows}
    unmet, chosen = set().union(*pairs.values()), []
    while unmet:
        best = max(rows, key=lambda row: len(pairs[row] & unmet))
        unmet -= pairs[best]
        chosen.append({name: values[k] for (name, values), k in zip(FIELDS.items(), best, strict=True)})
    return chosen


def arguments(row: dict[str, Any]) -> dict[str, Any]:
    settings = {**SHORT, **{name: row[name] for name in SETTINGS}}
    settings |= {"num_levels": 2} if row["map"] == "generated" else {}
    return {**{name: value for name, value in row.items() if name not in SETTINGS}, "settings": settings}


ROWS = pairwise()
every_row = pytest.mark.parametrize("row", ROWS, ids=range(len(ROWS)))


@every_row
def test_the_parallel_interface_has_no_fault(row: dict[str, Any]) -> None:
    parallel_api_test(pacman_env.parallel_env(**arguments(row)), num_cycles=30)


# Observations are dictionaries, as in Gymnasium: a mask beside features, a scan, a picture.
@pytest.mark.filterwarnings("ignore:Observation is not a NumPy array:UserWarning")
@pytest.mark.filterwarnings("ignore:Observation space for each agent probably should be:UserWarning")
# The four ghosts have had names since 1980.
@pytest.mark.filterwarnings("ignore:We recommend agents to be named in the format:UserWarning")
# Pac-Man alone has a lidar and a camera, and with velocity actions no mask.
@pytest.mark.filterwarnings("ignore:Agents have different observation space sizes:UserWarning")
@every_row
def test_the_interface_agent_by_agent_has_no_fault(row: dict[str, Any]) -> None:
    api_test(pacman_env.env(**arguments(row)), num_cycles=30)


@every_row
def test_the_state_has_no_fault(row: dict[str, Any]) -> None:
    state_test(pacman_env.env(**arguments(row)), pacman_env.parallel_env(**arguments(row)))


@every_row
def test_a_seed_decides_the_game_in_both_interfaces(row: dict[str, Any]) -> None:
    parallel_seed_test(lambda: pacman_env.parallel_env(**arguments(row)), num_cycles=20)
    seed_test(lambda: pacman_env.env(**arguments(row)), num_cycles=20)


def test_max_cycles_are_obeyed_in_both_interfaces() -> None:
    def limited(make: Any) -> Any:
        return lambda max_cycles: make(settings={"max_cycles": max_cycles})

    max_cycles_test(SimpleNamespace(env=limited(pacman_env.env), parallel_env=limited(pacman_env.parallel_env)))


def test_every_render_mode_gives_what_it_should(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("pygame")
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    render_test(lambda **mode: pacman_env.env(ghosts=("policy", "chase"), **mode))


def test_the_benchmark_runs_through_many_episodes(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    # Its five seconds in one: it only has to run.
    clock = types.SimpleNamespace(time=lambda: 5.0 * time.time())
    monkeypatch.setattr(sys.modules[performance_benchmark.__module__], "time", clock)
    random.seed(0)
    performance_benchmark(pacman_env.env(settings=SHORT))
    assert "Finished performance benchmark" in capsys.readouterr().out


@pytest.mark.filterwarnings("ignore:Observation is not a NumPy array:UserWarning")
@pytest.mark.filterwarnings("ignore:Observation space for each agent probably should be:UserWarning")
@pytest.mark.filterwarnings("ignore:We recommend agents to be named in the format:UserWarning")
@pytest.mark.filterwarnings("ignore:Agents have different observation space sizes:UserWarning")
@pytest.mark.parametrize("shape", [*SHAPES, {"flat": True, "settings": {"observation.candidates": "nearest"}}])
def test_in_the_shapes_of_learners_there_is_no_fault(shape: dict[str, Any]) -> None:
    parallel_api_test(pacman_env.parallel_env(map="loop", **shape), num_cycles=60)
    api_test(pacman_env.env(map="loop", **shape), num_cycles=60)
