"""The fuzzer plays without a fault, repeats a run and finds faults."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import tests.system.fuzz
from pacman_env.envs.pacmanbot import PacManBotEnv
from tests.shared import shared_path
from tests.system.fuzz import COUNTS, draw_arguments, main


def test_fuzzer_finds_no_fault_and_repeats_by_seed(capsys: pytest.CaptureFixture[str]) -> None:
    words = ["--maps", "maze", "generated", "--episodes", "12", "--seed", "3"]
    assert main(words) == 0
    first = capsys.readouterr().out
    rows = [dict(zip(COUNTS, map(int, line.split()[1:]), strict=True)) for line in first.splitlines()[1:]]
    assert [row["episodes"] for row in rows] == [6, 6, 12]
    assert all(row["illegal"] > 0 and sum(list(row.values())[3:]) == row["episodes"] for row in rows)
    assert main(words) == 0
    assert capsys.readouterr().out == first


def test_map_without_pellets_is_reported_as_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--maps", str(shared_path("maps/nav2_testmap")), "--episodes", "3"]) == 0
    assert "nav2_testmap                 refused: nav2_testmap: no pellet" in capsys.readouterr().out


def test_drawn_arguments_cover_every_axis_and_follow_seed() -> None:
    drawn = [draw_arguments(np.random.default_rng(seed)) for seed in range(100)]
    assert drawn[7] == draw_arguments(np.random.default_rng(7))
    assert len({str(one["observation"]) for one in drawn}) == 7
    for values in ([one["action"] for one in drawn], [one["preset"] for one in drawn]):
        assert len(set(values)) == 2
    for name in ("execution.rules", "endless", "decisions.when"):
        assert len({one["settings"][name] for one in drawn}) == 2
    assert {len(one["ghosts"]) for one in drawn} == {1, 2, 3, 4}


def not_finite(step: Callable[..., Any], env: PacManBotEnv, action: Any) -> Any:
    observation, *rest = step(env, action)
    return {key: array * np.float32(np.nan) for key, array in observation.items()}, *rest


def out_of_space(step: Callable[..., Any], env: PacManBotEnv, action: Any) -> Any:
    observation, *rest = step(env, action)
    return {key: np.concatenate([array, array], axis=-1) for key, array in observation.items()}, *rest


def lenient(step: Callable[..., Any], env: PacManBotEnv, action: Any) -> Any:
    try:
        return step(env, action)
    except ValueError:
        return step(env, env.action_space.sample())


def changing(step: Callable[..., Any], env: PacManBotEnv, action: Any) -> Any:
    try:
        return step(env, action)
    except ValueError:
        env.batch.games["x"] += 1e-9
        raise


@pytest.mark.parametrize(
    ("broken", "message"),
    [
        (not_finite, "not finite"),
        (out_of_space, "not in its space"),
        (lenient, "was accepted"),
        (changing, "changed the game"),
    ],
)
def test_fault_stops_fuzzer_and_prints_repeating_command(
    broken: Callable[..., Any], message: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    step = PacManBotEnv.step
    monkeypatch.setattr(tests.system.fuzz.PacManBotEnv, "step", lambda env, action: broken(step, env, action))
    assert main(["--maps", "maze", "--episodes", "20", "--seed", "0"]) == 1
    found, repeat = capsys.readouterr().out.splitlines()[1:]
    assert message in found
    assert main(repeat.removeprefix("repeat: python -m tests.system.fuzz ").split()) == 1
    assert capsys.readouterr().out.splitlines()[1:] == [found, repeat]
