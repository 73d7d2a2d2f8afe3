"""What is exported computes what torch computes, is small and whole, and says what it is."""

import hashlib
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from msgspec import structs

pytest.importorskip("torch")
pytest.importorskip("onnx")

import onnx
import torch

from pacman_env.observations.planner_features import CANDIDATE_FEATURES, GLOBAL_FEATURES
from pacman_env.policies.forward_pass import ForwardPass
from pacman_env.policies.learned import LearnedPlanner
from pacman_env.policies.metadata import metadata_path, read_planner
from pacman_env.training.checkpoint import save_checkpoint
from pacman_env.training.export import OPSET, export_planner, model_bytes, network_of, start_from
from pacman_env.training.network import FORBIDDEN, EntityNetwork
from tests.training.planners import FACTS, random_network, random_planner

SIZES = len(CANDIDATE_FEATURES), len(GLOBAL_FEATURES)


@pytest.mark.parametrize(
    "arguments", [{}, {"width": 16}, {"dropped_features": (4, 6)}, {"dropped_kinds": (1,)}, {"dropped_kinds": (1, 2)}]
)
@pytest.mark.parametrize(("games", "count"), [(1, 1), (1, 37), (64, 12), (300, 5)])
def test_exported_planner_computes_same_as_torch(
    arguments: dict[str, Any], games: int, count: int, tmp_path: Path
) -> None:
    """For any number of games and candidates, with some games in which nothing may be chosen."""
    rng = np.random.default_rng(games + count)
    candidates = rng.uniform(-1, 1, (games, count, SIZES[0])).astype(np.float32)
    whole = rng.uniform(-1, 1, (games, SIZES[1])).astype(np.float32)
    mask = rng.random((games, count)) < 0.5
    planner = LearnedPlanner(random_planner(tmp_path, **arguments))
    logits, values = planner.run(candidates, whole, mask)
    network = random_network(**arguments)
    with torch.no_grad():
        expected = network(torch.tensor(candidates), torch.tensor(whole), torch.tensor(mask))
    np.testing.assert_allclose(logits, expected[0].numpy(), atol=1e-5, rtol=1e-6)
    np.testing.assert_allclose(values, expected[1].numpy(), atol=1e-5, rtol=1e-6)
    assert (logits[~mask] == FORBIDDEN).all()


def test_same_weights_export_to_same_bytes() -> None:
    assert model_bytes(random_network(1)) == model_bytes(random_network(1)) != model_bytes(random_network(2))


def test_export_writes_small_model_with_fixed_opset(tmp_path: Path) -> None:
    path = random_planner(tmp_path)
    assert sorted(file.name for file in tmp_path.iterdir()) == ["mine.json", "mine.onnx"]
    assert path.stat().st_size < 200_000
    model = onnx.load(path)
    assert [(opset.domain, opset.version) for opset in model.opset_import] == [("", OPSET)]


def test_metadata_describes_exported_network(tmp_path: Path) -> None:
    path = random_planner(tmp_path, width=32, dropped_features=(4, 6), dropped_kinds=(2,))
    metadata, content = read_planner(path)
    assert metadata.sha256 == hashlib.sha256(content).hexdigest()
    assert metadata.width == 32
    assert metadata.dropped_features == (CANDIDATE_FEATURES[4], CANDIDATE_FEATURES[6])
    assert metadata.dropped_kinds == ("is_hold",)
    assert metadata.robot_speed_mps == FACTS.robot_speed_mps
    assert metadata.training == FACTS.training
    assert metadata.metrics == FACTS.metrics
    assert metadata.commit == "unknown" or len(metadata.commit.rstrip("+")) == 40


class _Otherwise(EntityNetwork):
    """Computes a little more than its graph."""

    def forward(self, *inputs: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        logits, values = super().forward(*inputs)
        return logits if torch.jit.is_tracing() else logits + 1e-3, values


def _spoilt() -> EntityNetwork:
    network = random_network()
    with torch.no_grad():
        network.encode.weight[0, 0] = torch.nan
    return network


@pytest.mark.parametrize(
    ("network", "facts", "message"),
    [
        (_Otherwise(*SIZES), FACTS, r"logits differ from torch's by 0\.0"),
        (_spoilt(), FACTS, "and finite"),
        (EntityNetwork(SIZES[0] + 1, SIZES[1]), FACTS, "candidate and global features, this version has"),
        (EntityNetwork(SIZES[0], SIZES[1] - 1), FACTS, "candidate and global features, this version has"),
        (random_network(), structs.replace(FACTS, metrics={"a": float("nan")}), r"mine\.json: metrics\.a = nan"),
        (random_network(), structs.replace(FACTS, robot_speed_mps=0.0), "robot_speed_mps = 0.0"),
    ],
    ids=["other-numbers", "no-number", "candidate-features", "global-features", "metrics", "speed"],
)
def test_failed_export_keeps_existing_planner(network: EntityNetwork, facts: Any, message: str, tmp_path: Path) -> None:
    path = random_planner(tmp_path)
    before = {file: file.read_bytes() for file in tmp_path.iterdir()}
    with pytest.raises(ValueError, match=message):
        export_planner(network, path, facts)
    assert {file: file.read_bytes() for file in tmp_path.iterdir()} == before


def test_export_does_not_change_network(tmp_path: Path) -> None:
    network = random_network()
    before = {name: value.clone() for name, value in network.state_dict().items()}
    export_planner(network, tmp_path / "new" / "mine.onnx", FACTS)
    assert all(torch.equal(value, before[name]) for name, value in network.state_dict().items())


def test_export_refuses_names_without_onnx_suffix(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"mine\.bin: must end in \.onnx"):
        export_planner(random_network(), tmp_path / "mine.bin", FACTS)


def test_export_refuses_to_write_through_symlink(tmp_path: Path) -> None:
    (tmp_path / "link.onnx").symlink_to("real.onnx")
    with pytest.raises(ValueError, match=r"link.onnx: is a link to real.onnx: name that"):
        export_planner(random_network(), tmp_path / "link.onnx", FACTS)
    assert [file.name for file in tmp_path.iterdir()] == ["link.onnx"]


@pytest.mark.parametrize("sizes", [{}, {"width": 24, "dropped_features": (4, 7), "dropped_kinds": (1,)}])
def test_network_is_restored_from_its_file(sizes: dict[str, int], tmp_path: Path) -> None:
    network = random_network(4, **sizes)
    path = random_planner(tmp_path, seed=4, **sizes)
    found = network_of(path)
    assert model_bytes(found) == path.read_bytes() == model_bytes(network)
    assert found.dropped_kinds == network.dropped_kinds


@pytest.mark.parametrize("sizes", [{"width": 24}, {"dropped_features": (4, 7)}])
def test_compiled_forward_pass_runs_exported_file(sizes: dict[str, Any], tmp_path: Path) -> None:
    """Also of widths that are no multiple of its blocks."""
    rng = np.random.default_rng(0)
    candidates = rng.uniform(-1, 1, (20, 13, SIZES[0])).astype(np.float32)
    whole, mask = rng.uniform(-1, 1, (20, SIZES[1])).astype(np.float32), rng.random((20, 13)) < 0.5
    path = random_planner(tmp_path, **sizes)
    (logits, values), expected = (
        judge.run(candidates, whole, mask) for judge in (ForwardPass(path.read_bytes()), LearnedPlanner(path))
    )
    np.testing.assert_allclose(logits[mask], expected[0][mask], atol=1e-5)
    np.testing.assert_allclose(values, expected[1], atol=1e-5)


def rename(model: onnx.ModelProto) -> None:
    """Name a weight otherwise, as files of earlier versions do."""
    for node in model.graph.node:
        node.input[:] = ["constant_0" if name == "encode.weight" else name for name in node.input]
    next(tensor for tensor in model.graph.initializer if tensor.name == "encode.weight").name = "constant_0"


def compute_otherwise(model: onnx.ModelProto) -> None:
    [node for node in model.graph.node if node.op_type == "Relu"][-1].op_type = "Tanh"


@pytest.mark.parametrize("change", [rename, compute_otherwise])
def test_graph_of_another_exporter_is_refused(change: Callable[[onnx.ModelProto], None], tmp_path: Path) -> None:
    path = random_planner(tmp_path)
    model = onnx.load_model(path)
    change(model)
    path.write_bytes(model.SerializeToString())
    metadata = json.loads(metadata_path(path).read_text()) | {"sha256": hashlib.sha256(path.read_bytes()).hexdigest()}
    metadata_path(path).write_text(json.dumps(metadata))
    with pytest.raises(ValueError, match=r"mine\.onnx: no graph that this version's pacman-env export writes: .+$"):
        network_of(path)


@pytest.mark.parametrize("suffix", [".onnx", ".zip"])
def test_network_starts_from_planner_of_same_shape(suffix: str, tmp_path: Path) -> None:
    sizes: dict[str, Any] = {"width": 16, "dropped_features": (4,), "dropped_kinds": (1,)}
    path, given = random_planner(tmp_path, seed=1, **sizes).with_suffix(suffix), random_network(1, **sizes)
    save_checkpoint(tmp_path / "mine.zip", given, torch.optim.Adam(given.parameters()))
    network = random_network(2, **sizes)
    start_from(path, network)
    assert all(torch.equal(value, given.state_dict()[name]) for name, value in network.state_dict().items())
    with pytest.raises(ValueError, match=r"width = 8: .*mine.* has 16"):
        start_from(path, random_network(width=8))
    for other in ({"dropped_kinds": ()}, {"dropped_features": ()}):
        with pytest.raises(ValueError, match=r"without: .*mine.* was trained with other ablations"):
            start_from(path, random_network(**{**sizes, **other}))
