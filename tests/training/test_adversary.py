"""The command trains both sides in turns, writes what it found, and what it writes can be played with."""

import hashlib
import json
from collections.abc import Iterator
from pathlib import Path

import onnx
import pytest

pytest.importorskip("sb3_contrib")
pytest.importorskip("onnx")

import torch

import pacman_env
from pacman_env.executors.base import InProcess
from pacman_env.policies.metadata import metadata_path, read_planner
from pacman_env.training.adversary import main, parse, starting_model
from pacman_env.training.checkpoint import facts_path, save_checkpoint, write_facts
from pacman_env.training.export import model_bytes, network_of
from tests.training.planners import FACTS, random_network, random_planner

TINY = (
    *("--rounds", "1", "--clyde-decisions", "128", "--planner-decisions", "128", "--imitation", "64", "--games", "2"),
    *("--clyde-games", "2", "--levels", "2", "--evaluation", "1", "--threads", "2", "--no-progress"),
    *("--clyde-speed", "0.5", "0.6"),  # rounds are soon over
)


@pytest.fixture(scope="module", autouse=True)
def _torch_as_before() -> Iterator[None]:
    """The command sets threads and determinism for the whole process."""
    threads, mode = torch.get_num_threads(), torch.get_deterministic_debug_mode()
    yield
    torch.set_num_threads(threads)
    torch.set_deterministic_debug_mode(mode)


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a whole run."""
    out = tmp_path_factory.mktemp("run")
    assert main([*TINY, "--out", str(out)]) == 0
    return out


def test_run_writes_planners_ghosts_and_completion_table(run: Path) -> None:
    assert {path.name for path in run.glob("*.onnx")} == {"planner-0.onnx", "planner-1.onnx", "clyde-1.onnx"}
    record = json.loads((run / "record.json").read_text())
    assert record["version"] == pacman_env.__version__
    assert record["arguments"]["clyde_decisions"] == 128
    assert [row["planner_decisions"] for row in record["rounds"]] == [128]
    assert set(record["completed"]) == {"planner-0", "planner-1", "lookahead", "clyde_aware"}
    for row in record["completed"].values():
        assert list(row) == ["wander", "arcade", "chase", "clyde-1"]
        assert set(row.values()) <= {0.0, 1.0}
    metadata = read_planner(run / "planner-1.onnx")[0]
    assert metadata.metrics == {f"completed_{k}": v for k, v in record["completed"]["planner-1"].items()}
    assert metadata.training.ghosts == ("wander", "arcade", "chase", "policy")
    assert read_planner(run / "planner-0.onnx")[0].training.ghosts == ("wander",)
    clyde = read_planner(run / "clyde-1.onnx")[0].training
    assert (clyde.decisions, clyde.ghosts) == (128, ("policy",))
    assert clyde.clyde_speeds_mps == metadata.training.clyde_speeds_mps == (0.5, 0.6)
    before, after = (network_of(run / f"planner-{k}.onnx").state_dict() for k in (0, 1))
    assert not torch.equal(before["encode.weight"], after["encode.weight"])


@pytest.mark.daily
def test_same_seed_writes_same_files(run: Path, tmp_path: Path) -> None:
    assert main([*TINY, "--out", str(tmp_path)]) == 0
    for path in run.glob("*.onnx"):
        assert path.read_bytes() == (tmp_path / path.name).read_bytes()
    ours, theirs = (json.loads((folder / "record.json").read_text()) for folder in (run, tmp_path))
    assert ours["completed"] == theirs["completed"]


def test_folder_with_run_is_not_changed(run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = (run / "record.json").read_bytes()
    assert main([*TINY, "--out", str(run)]) == 2
    assert "there is a run already" in capsys.readouterr().err
    assert (run / "record.json").read_bytes() == before


def test_measure_option_prints_table_without_training(
    run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    planner, clyde = run / "planner-1.onnx", run / "clyde-1.onnx"
    out = tmp_path / "none"
    assert main([*TINY, "--out", str(out), "--measure", str(planner), "--clyde", str(clyde)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "| completed of 1 | wander | arcade | chase | clyde |"
    assert [line.split("|")[1].strip() for line in lines[2:]] == ["planner", "lookahead", "clyde_aware"]
    assert not out.exists()


@pytest.mark.parametrize("sizes", [{}, {"width": 24, "dropped_features": (4, 7), "dropped_kinds": (1,)}])
def test_network_is_restored_from_its_file(sizes: dict[str, int], tmp_path: Path) -> None:
    network = random_network(4, **sizes)
    path = random_planner(tmp_path, seed=4, **sizes)
    found = network_of(path)
    assert model_bytes(found) == path.read_bytes() == model_bytes(network)
    assert found.dropped_kinds == network.dropped_kinds


def test_graph_of_another_exporter_is_refused(tmp_path: Path) -> None:
    path = random_planner(tmp_path)
    model = onnx.load_model(path)
    swapped = [node for node in model.graph.node if node.op_type == "Relu"]
    swapped[-1].op_type = "Tanh"
    path.write_bytes(model.SerializeToString())
    metadata = json.loads(metadata_path(path).read_text()) | {"sha256": hashlib.sha256(path.read_bytes()).hexdigest()}
    metadata_path(path).write_text(json.dumps(metadata))
    with pytest.raises(ValueError, match=r"mine\.onnx: no graph that pacman-env export writes"):
        network_of(path)


@pytest.mark.parametrize("kind", ["planner", "checkpoint"])
def test_training_starts_from_planner_or_checkpoint(kind: str, tmp_path: Path) -> None:
    path = random_planner(tmp_path, seed=5, width=24)
    network = random_network(5, width=24)
    if kind == "checkpoint":
        path = tmp_path / "best.zip"
        save_checkpoint(path, network, torch.optim.Adam(network.parameters()))
        write_facts(facts_path(path), FACTS)
    model, decisions = starting_model(parse([*TINY, "--start", str(path)]), InProcess())
    assert decisions == FACTS.training.decisions
    assert model_bytes(model.network) == model_bytes(network)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--rounds", "0"], "rounds = 0: Expected `int` >= 1"),
        (["--wander", "1.5"], "wander = 1.5: Expected `float` <= 1"),
        (["--seed", "-1"], "seed = -1: Expected `int` >= 0"),
        (["--clyde", "c.onnx"], "is for --measure"),
        (["--clyde-speed", "0.2", "-0.1"], "clyde_speed[1] = -0.1"),
    ],
)
def test_bad_arguments_are_refused_with_reason(
    arguments: list[str], words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit, match="2"):
        main([*TINY, "--out", str(tmp_path), *arguments])
    assert words in " ".join(capsys.readouterr().err.split())
    assert not list(tmp_path.iterdir())


def test_quick_option_shrinks_defaults_but_keeps_given_values() -> None:
    quick = parse(["--quick", "--wander", "0.7"])
    assert quick.wander == 0.7
    assert quick.planner_decisions < parse([]).planner_decisions
    assert quick.out != parse([]).out
