"""The command from its arguments to a planner that plays; what goes wrong is one line and status 2."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("torch")
pytest.importorskip("sb3_contrib")

from pacman_env.episodes.rollout import play
from pacman_env.game.ends import COMPLETE
from pacman_env.levels.level_source import GeneratedMaps
from pacman_env.observations.situation import REFUGE
from pacman_env.policies.learned import LearnedPlanner
from pacman_env.training.arguments import parse
from pacman_env.training.checkpoint import facts_path, read_facts
from pacman_env.training.games import game_config
from pacman_env.training.held_out import HeldOut
from pacman_env.training.ppo import main
from tests.policies.contract import random_situation
from tests.training.test_arguments import section, tiny

ROOT = Path(__file__).resolve().parents[2]
#: The headline section, made short.
SHORT = (
    *("--decisions", "2048", "--segment", "1024", "--games", "16", "--n-steps", "32", "--levels", "4"),
    *("--ghosts", "wander", "--imitation", "512", "--evaluation", "4", "--threads", "1", "--no-progress"),
)


def tiny_options(folder: Path, *more: str) -> list[str]:
    return ["--config", str(section(folder)), "--threads", "1", "--evaluation", "0", "--no-progress", *more]


@pytest.fixture(scope="module")
def trained(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of the real command."""
    out = tmp_path_factory.mktemp("trained") / "run"
    assert main([*SHORT, "--out", str(out)]) == 0
    return out


def test_written_planner_equals_last_checkpoint(trained: Path, tmp_path: Path) -> None:
    from pacman_env.training.export import main as export

    assert export([str(trained / "last.zip"), "--out", str(tmp_path / "again.onnx")]) == 0
    assert (tmp_path / "again.onnx").read_bytes() == (trained / "planner.onnx").read_bytes()


def test_metadata_describes_training(trained: Path) -> None:
    hyper, metadata = parse(SHORT).hyper, LearnedPlanner(trained / "planner.onnx").metadata
    assert metadata.training == read_facts(facts_path(trained / "last.zip")).training
    assert metadata.training.clyde_speeds_mps == hyper.clyde_speed
    assert metadata.training.decisions == 2048
    assert metadata.width == hyper.width
    assert metadata.metrics["completed"] == record(trained)["segments"][-1]["completed"]


def record(out: Path) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((out / "run.json").read_text())
    return found


def test_record_contains_arguments_and_every_segment(trained: Path) -> None:
    found = record(trained)
    assert found["arguments"]["hyper"]["decisions"] == 2048
    assert [segment["decisions"] for segment in found["segments"]] == [1024, 2048]
    assert 0 <= found["segments"][0]["agreement"] <= 1
    assert "agreement" not in found["segments"][1]
    assert all(0 <= segment["completed"] <= 1 for segment in found["segments"])


def test_validation_rounds_are_shared_among_lineups() -> None:
    arguments = tiny(ghosts=["wander", "chase", "wander", "arcade,chase"], levels=4)
    held_out = HeldOut(arguments, 5)
    assert held_out.rows == {"wander": slice(0, 1), "chase": slice(1, 3), "arcade,chase": slice(3, 5)}
    np.testing.assert_array_equal(held_out.seeds, HeldOut(tiny(), 5).seeds)
    ended = held_out.completed("nearest")
    share, each = held_out.shares(ended)
    assert share == ended.mean()
    assert each == {lineup: ended[rows].mean() for lineup, rows in held_out.rows.items()}
    for lineup, rows in held_out.rows.items():
        source, config = GeneratedMaps(game_config(arguments), 900_000, 128), game_config(arguments)
        config = config.with_fields(**{"clyde.ghosts": tuple(lineup.split(","))})
        records, _ = play(source, config, "nearest", held_out.seeds[rows])
        np.testing.assert_array_equal(ended[rows], records["end"] == COMPLETE)
    nothing = HeldOut(arguments, 0)
    assert nothing.shares(nothing.completed("nearest")) == (0.0, {"wander": 0.0, "chase": 0.0, "arcade,chase": 0.0})


def test_report_compares_planner_with_rules_by_lineup(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    options = ["--ghosts", "wander", "chase", "--imitation", "0", "--evaluation", "4", "--out", str(tmp_path / "run")]
    assert main(tiny_options(tmp_path, *options, "--decide", "event")) == 0
    told = capsys.readouterr().out
    assert "4 rounds on test levels, Clyde 0.2-0.6 m/s" in told
    assert f"written: {tmp_path / 'run' / 'planner.onnx'}" in told
    rows = [line.split(" | ")[:2] for line in told.splitlines() if line.startswith("| ")]
    policies = ["ppo", "clyde_aware", "lookahead", "nearest"]
    expected = [[f"| {part}", policy] for part in ("all", "wander", "chase") for policy in policies]
    assert rows == [["| ghosts", "policy"], *expected]
    assert "agreement" not in record(tmp_path / "run")["segments"][0]


def test_quick_training_without_imitation_decides_by_events() -> None:
    from_scratch = ["--quick", "--imitation", "0"]
    assert parse(from_scratch).hyper.decide == "event"
    assert parse(["--quick"]).hyper.decide == parse(["--imitation", "0"]).hyper.decide == "tick"
    assert game_config(parse(from_scratch)).decisions.when == "event"


def test_ablated_planner_drops_only_its_features_and_kinds(tmp_path: Path) -> None:
    options = ["--without", "refuges", "paths", "--decisions", "64", "--out", str(tmp_path / "run")]
    assert main(tiny_options(tmp_path, *options)) == 0
    planner = LearnedPlanner(tmp_path / "run" / "planner.onnx")
    assert planner.metadata.dropped_kinds == ("is_refuge",)
    assert len(planner.metadata.dropped_features) == 8
    situation = random_situation(0, 40)
    np.testing.assert_array_equal(planner.scores(situation) > -np.inf, situation.mask & (situation.kind != REFUGE))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--clyde-speed", "0.6", "0.2"], r"randomize.clyde_speed_mps = (0.6, 0.2)"),
        (["--levels", "1000000"], "levels = 1000000: there are 900000 to train on"),
        (["--resume"], "run.json: no run to resume"),
        (["--config", "bad.yaml"], "bad.yaml: cannot be read"),  # an error of several lines
        (["--learning-rate", "1e30", "1e30"], "the training has diverged"),
        (["--device", "abacus"], "device = 'abacus': must be cpu or cuda, or cuda:N"),
        (["--device", "cuda:much"], "device = 'cuda:much': cannot be used: "),
        (["--device", "cuda:99"], "device = 'cuda:99': cannot be used: "),  # with CUDA and without
    ],
)
def test_errors_end_with_one_line_and_status_2(
    options: list[str],
    message: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("bad.yaml").write_text("headline: [")
    assert main([*tiny_options(tmp_path, "--out", str(tmp_path / "run")), *options]) == 2
    told = capsys.readouterr().err
    assert told.startswith("pacman-env train: ")
    assert message in told
    assert told.count("\n") == 1
    assert not (tmp_path / "run" / "planner.onnx").exists()
