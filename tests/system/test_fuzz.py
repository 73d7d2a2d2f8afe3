from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from gymnasium.error import ResetNeeded

import tests.system.fuzz
from pacman_env.envs.pacmanbot import PacManBotEnv
from tests.shared import shared_path
from tests.system.fuzz import Tally, draw_arguments, main


def test_a_short_run_on_a_drawn_and_a_generated_map_finds_no_fault(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--maps", "maze", "generated", "--episodes", "12", "--seed", "3"]) == 0
    first = capsys.readouterr().out
    rows = [line.split() for line in first.splitlines()]
    assert [row[:2] for row in rows[1:]] == [["maze", "6"], ["generated", "6"], ["all", "12"]]
    assert rows[0][4:] == list(tests.system.fuzz.OUTCOMES)
    for row in rows[1:]:
        assert sum(map(int, row[4:])) == int(row[1])
        assert int(row[3]) > 0
    assert main(["--maps", "maze", "generated", "--episodes", "12", "--seed", "3"]) == 0
    assert capsys.readouterr().out == first


def test_a_map_without_a_pellet_is_no_fault(capsys: pytest.CaptureFixture[str]) -> None:
    path = str(shared_path("maps/nav2_testmap"))
    assert main(["--maps", path, "--episodes", "3"]) == 0
    assert "nav2_testmap                 refused: nav2_testmap: no pellet" in capsys.readouterr().out


def test_configurations_differ_and_belong_to_the_seed() -> None:
    drawn = [draw_arguments(np.random.default_rng(seed)) for seed in range(100)]
    assert drawn[7] == draw_arguments(np.random.default_rng(7))
    for name, kinds in (("action", 2), ("preset", 2), ("observation", 7)):
        assert len({str(one[name]) for one in drawn}) == kinds
    for name in ("execution.rules", "endless", "decisions.when"):
        assert len({one["settings"][name] for one in drawn}) == 2
    assert {len(one["ghosts"]) for one in drawn} == {1, 2, 3, 4}


class NotFinite(PacManBotEnv):
    """The last observation of an episode is NaN."""

    def step(self, action: Any) -> Any:
        observation, *ends = super().step(action)
        if ends[1] or ends[2]:
            for array in observation.values():
                if array.dtype == np.float32:
                    array[...] = np.nan
        return observation, *ends


class OutOfSpace(PacManBotEnv):
    """Everything is seen twice as wide."""

    def step(self, action: Any) -> Any:
        observation, *rest = super().step(action)
        return {key: np.concatenate([array, array], axis=-1) for key, array in observation.items()}, *rest


class Lenient(PacManBotEnv):
    """Anything is an action."""

    def step(self, action: Any) -> Any:
        try:
            return super().step(action)
        except ValueError:
            return super().step(self.action_space.sample())


class Changed(PacManBotEnv):
    """A refused action has moved the robot a little."""

    def step(self, action: Any) -> Any:
        try:
            return super().step(action)
        except ValueError:
            self.batch.games["x"] += 1e-9
            raise


class Restless(PacManBotEnv):
    """A game that is over goes on."""

    def step(self, action: Any) -> Any:
        try:
            return super().step(action)
        except ResetNeeded:
            return self.reset()[0], 0.0, False, False, {}


@pytest.mark.parametrize(
    ("broken", "message"),
    [
        (NotFinite, "not finite"),
        (OutOfSpace, "not in its space"),
        (Lenient, "was accepted"),
        (Changed, "changed the game"),
        (Restless, "went on after its end"),
    ],
)
def test_a_fault_ends_the_run_with_the_seed_that_repeats_it(
    broken: type[PacManBotEnv], message: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(tests.system.fuzz, "PacManBotEnv", broken)
    assert main(["--maps", "maze", "--episodes", "20", "--seed", "0"]) == 1
    found, repeat = capsys.readouterr().out.splitlines()[1:]
    assert message in found
    assert repeat.startswith("repeat: python -m tests.system.fuzz ")
    assert main(repeat.removeprefix("repeat: python -m tests.system.fuzz ").split()) == 1
    assert capsys.readouterr().out.splitlines()[1:] == [found, repeat]


@pytest.mark.parametrize("arguments", [["--episodes", "0"], ["--seed", "-1"], ["--maps"], ["--level", "3"]])
def test_bad_arguments_are_one_line(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as exit_info:
        main(arguments)
    assert exit_info.value.code == 2
    assert capsys.readouterr().err.count("\n") == 1


def test_a_row_tells_figures_or_the_refusal() -> None:
    assert Tally(refusal="too small").line("hut").split(maxsplit=1) == ["hut", "refused: too small"]
