"""Write a trained planner as a file that runs without torch: ``pacman-env export``.

The graph is built from the weights, operator by operator, so that it needs no exporter and the same weights give the
same bytes. The metadata (:mod:`pacman_env.policies.metadata`) is written next to the ONNX file.
"""

import argparse
import copy
import hashlib
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import torch
from numpy.typing import NDArray
from onnx import TensorProto, helper, numpy_helper
from torch import nn

from pacman_env import __version__
from pacman_env.command_line.command import Parser, run_command
from pacman_env.config.validation import located
from pacman_env.files import commit, prepare, replaced
from pacman_env.observations.planner_features import CANDIDATE_FEATURES, GLOBAL_FEATURES, VERSION
from pacman_env.policies.learned import LearnedPlanner
from pacman_env.policies.metadata import FORMAT, PlannerMetadata, dump, metadata_path, read_planner
from pacman_env.training.checkpoint import Facts, check_sizes, facts_path, load_network, read_facts
from pacman_env.training.planner_network import FORBIDDEN, EntityNetwork

OPSET, IR_VERSION = 17, 8  # supported by onnxruntime 1.13 and newer
TOLERANCE = 1e-5  # largest difference between the results of torch and of the file
#: Layers in the order of their weights in the file; the weights of the first and third layer are split in two.
_LAYERS = ("encode_candidate", "encode", "judge_candidate", "judge", "critic.0", "critic.2")


class _Graph:
    """Nodes and constants of a graph, named by operator or number."""

    def __init__(self) -> None:
        self.nodes: list[Any] = []
        self.constants: list[Any] = []

    def constant(self, value: Any, dtype: type = np.float32) -> str:
        name = f"constant_{len(self.constants)}"
        self.constants.append(numpy_helper.from_array(np.array(value, dtype, order="C"), name))
        return name

    def add(self, operator: str, *inputs: str, output: str = "", **attributes: Any) -> str:
        name = output or f"{operator.lower()}_{len(self.nodes)}"
        self.nodes.append(helper.make_node(operator, inputs, [name], **attributes))
        return name

    def product(self, inputs: str, weight: NDArray[np.float32], bias: torch.Tensor | None = None) -> str:
        result = self.add("MatMul", inputs, self.constant(weight.T))
        return result if bias is None else self.add("Add", result, self.constant(_array(bias)))

    def linear(self, layer: nn.Linear, inputs: str) -> str:
        return self.product(inputs, _array(layer.weight), layer.bias)

    def halves(self, layer: nn.Linear, own: str, context: str, shown: NDArray[np.float32]) -> str:
        """Add a layer with ReLU whose inputs are ``own`` (B, C, n) and ``context`` (B, m); return its output's name.

        The output is (B, C, width). ``shown`` (n,) scales the numbers of ``own``.
        """
        weight, count = _array(layer.weight), len(shown)
        part = self.add("Unsqueeze", self.product(context, weight[:, count:], layer.bias), self.axes(1))
        return self.add("Relu", self.add("Add", self.product(own, weight[:, :count] * shown), part))

    def axes(self, *axes: int) -> str:
        return self.constant(axes, np.int64)


def _array(tensor: torch.Tensor) -> NDArray[np.float32]:
    return tensor.detach().numpy()


def model_bytes(network: EntityNetwork) -> bytes:
    """Return the network's ``forward`` as the bytes of an ONNX model, for any number of games B and candidates C.

    The inputs are ``candidates`` (B, C, F) and ``globals`` (B, H), float32, and ``mask`` (B, C), bool. The outputs are
    ``logits`` (B, C) and ``values`` (B,), float32.
    """
    g = _Graph()
    mask = "mask"
    for kind in network.dropped_kinds:
        column = g.add("Gather", "candidates", g.constant(kind, np.int64), axis=2)
        mask = g.add("And", mask, g.add("Less", column, g.constant(0.5)))
    ones = g.add("Cast", mask, to=TensorProto.FLOAT)
    encoded = g.halves(network.encode_candidate, "candidates", "globals", _array(network.shown))
    encoded = g.add("Relu", g.linear(network.encode, encoded))
    shown = g.add("Mul", encoded, g.add("Unsqueeze", ones, g.axes(2)))
    count = g.add("Max", g.add("ReduceSum", ones, g.axes(1), keepdims=1), g.constant(1.0))
    mean = g.add("Div", g.add("ReduceSum", shown, g.axes(1), keepdims=0), count)
    pooled = g.add("Concat", mean, g.add("ReduceMax", shown, axes=[1], keepdims=0), axis=1)
    judged = g.halves(network.judge_candidate, encoded, pooled, np.ones(network.width, np.float32))
    logits = g.add("Squeeze", g.linear(network.judge, judged), g.axes(2))
    g.add("Where", mask, logits, g.constant(FORBIDDEN), output="logits")
    first, last = (layer for layer in network.critic if isinstance(layer, nn.Linear))
    hidden = g.add("Relu", g.linear(first, g.add("Concat", pooled, "globals", axis=1)))
    g.add("Squeeze", g.linear(last, hidden), g.axes(1), output="values")

    whole = network.encode_candidate.in_features - network.candidate_features
    real, value = TensorProto.FLOAT, helper.make_tensor_value_info
    inputs = [
        value("candidates", real, ["games", "count", network.candidate_features]),
        value("globals", real, ["games", whole]),
        value("mask", TensorProto.BOOL, ["games", "count"]),
    ]
    outputs = [value("logits", real, ["games", "count"]), value("values", real, ["games"])]
    graph = helper.make_graph(g.nodes, "planner", inputs, outputs, g.constants)
    opset = [helper.make_opsetid("", OPSET)]
    model = helper.make_model(graph, opset_imports=opset, ir_version=IR_VERSION, producer_name="pacman_env")
    onnx.checker.check_model(model, full_check=True)
    return bytes(model.SerializeToString(deterministic=True))


def export_planner(network: EntityNetwork, path: Path, facts: Facts) -> None:
    """Write a planner to ``path`` (.onnx), with its metadata.

    Raises ValueError, and keeps old files, if the results of the file differ from torch's.
    """
    if path.suffix.lower() != ".onnx":
        raise ValueError(f"{path}: must end in .onnx")
    if path.is_symlink():  # the metadata would lie next to the link, not next to the file
        raise ValueError(f"{path}: is a link to {path.readlink()}: name that")
    check_sizes(network, path)
    network = copy.deepcopy(network).cpu()
    content = model_bytes(network)
    metadata = PlannerMetadata(
        format=FORMAT,
        feature_version=VERSION,
        candidate_features=CANDIDATE_FEATURES,
        global_features=GLOBAL_FEATURES,
        width=network.width,
        dropped_features=tuple(np.array(CANDIDATE_FEATURES)[_array(network.shown) == 0].tolist()),
        dropped_kinds=tuple(CANDIDATE_FEATURES[kind] for kind in network.dropped_kinds),
        robot_speed_mps=facts.robot_speed_mps,
        training=facts.training,
        package_version=__version__,
        commit=commit(),
        metrics=facts.metrics,
        sha256=hashlib.sha256(content).hexdigest(),
    )
    beside = metadata_path(path)
    text = dump(metadata, beside)
    for file in (path, beside):
        prepare(file)
    with replaced(path) as new_model, replaced(beside) as new_metadata:
        new_model.write_bytes(content)
        new_metadata.write_text(text)
        _compare(network, LearnedPlanner(new_model))


def network_of(path: Path) -> EntityNetwork:
    """Return the network in an ONNX file of :func:`export_planner`; raises ValueError for another graph."""
    LearnedPlanner(path)  # refuses external weights and graphs that do not run
    metadata, content = read_planner(path)
    network = EntityNetwork(
        len(CANDIDATE_FEATURES),
        len(GLOBAL_FEATURES),
        metadata.width,
        [CANDIDATE_FEATURES.index(name) for name in metadata.dropped_features],
        [CANDIDATE_FEATURES.index(name) for name in metadata.dropped_kinds],
    )
    graph = onnx.load_model_from_string(content).graph
    arrays = (numpy_helper.to_array(tensor) for tensor in graph.initializer)
    left = [torch.tensor(array) for array in arrays if array.dtype == np.float32 and array.ndim > 0]
    state = {"shown": network.shown}
    with located(f"{path}: no graph that pacman-env export writes", ValueError, (IndexError, RuntimeError)):
        for k, name in enumerate(_LAYERS):
            weight, bias = left.pop(0).T, left.pop(0)
            state |= {f"{name}.weight": torch.cat([left.pop(0).T, weight], dim=1) if k in (0, 2) else weight}
            state |= {f"{name}.bias": bias}
        network.load_state_dict(state)
    if onnx.load_model_from_string(model_bytes(network)).graph != graph:
        raise ValueError(f"{path}: no graph that pacman-env export writes")
    return network


def _compare(network: EntityNetwork, planner: LearnedPlanner) -> None:
    """Raise ValueError if the exported file and torch give different results for random inputs."""
    rng = np.random.default_rng(0)
    for games, count in ((1, 1), (1, 24), (7, 5), (64, 40)):
        candidates = rng.uniform(-2, 2, (games, count, network.candidate_features)).astype(np.float32)
        whole = rng.uniform(-2, 2, (games, len(GLOBAL_FEATURES))).astype(np.float32)
        mask = rng.random((games, count)) < 0.6
        with torch.no_grad():
            expected = network(*(torch.from_numpy(a) for a in (candidates, whole, mask)))
        results = planner.run(candidates, whole, mask)
        for name, one, other in zip(("logits", "values"), results, expected, strict=True):
            if not np.allclose(one, _array(other), rtol=TOLERANCE, atol=TOLERANCE):
                worst = np.abs(one - _array(other)).max()
                raise ValueError(f"{planner.path}: {name} differ from torch's by {worst}, more than {TOLERANCE}")


def main(argv: Sequence[str] | None = None) -> int:
    return run_command(make_parser(), argv, _export, "train")


def make_parser() -> Parser:
    parser = Parser(prog="pacman-env export", description=__doc__)
    parser.add_argument("checkpoint", type=Path, metavar="CHECKPOINT.zip", help="of a training, such as last.zip")
    parser.add_argument("--out", type=Path, required=True, metavar="FILE.onnx", help="its metadata goes beside it")
    parser.add_argument("--facts", type=Path, metavar="FILE.json", help="default: CHECKPOINT.facts.json")
    return parser


def _export(arguments: argparse.Namespace) -> None:
    network = load_network(arguments.checkpoint)
    facts = read_facts(arguments.facts or facts_path(arguments.checkpoint))
    export_planner(network, arguments.out, facts)
    print(f"written: {arguments.out}, {metadata_path(arguments.out)}, {os.path.getsize(arguments.out) / 1e3:.0f} kB")
