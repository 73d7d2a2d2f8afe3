"""Write a trained planner as a file that runs without torch: ``pacman-env export``.

``torch.onnx.export`` writes the graph of the network's ``forward``. The weights keep their names in the file, so that
it can be read back. The metadata (:mod:`pacman_env.policies.metadata`) is written next to the ONNX file.
"""

import argparse
import copy
import hashlib
import io
import os
import warnings
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import onnx
import torch

from .. import __version__
from ..command_line.command import Parser, run_command
from ..config.validation import located
from ..files import commit, prepare, replaced
from ..observations.planner_features import CANDIDATE_FEATURES, GLOBAL_FEATURES, VERSION
from ..policies.learned import LearnedPlanner
from ..policies.metadata import FORMAT, PlannerMetadata, dump, metadata_path
from .checkpoint import Facts, check_sizes, facts_path, load_network, read_facts
from .network import EntityNetwork

OPSET = 17  # supported by onnxruntime 1.13 and newer
TOLERANCE = 1e-5  # largest difference between the results of torch and of the file
_AXES = {"candidates": ("games", "count"), "globals": ("games",), "mask": ("games", "count")}
_AXES |= {"logits": ("games", "count"), "values": ("games",)}


def model_bytes(network: EntityNetwork) -> bytes:
    """Return the network's ``forward`` as the bytes of an ONNX model, for any number of games B and candidates C.

    The inputs are ``candidates`` (B, C, F) and ``globals`` (B, H), float32, and ``mask`` (B, C), bool. The outputs are
    ``logits`` (B, C) and ``values`` (B,), float32. The same weights give the same bytes.
    """
    whole = network.encode_candidate.in_features - network.candidate_features
    inputs = torch.zeros(2, 3, network.candidate_features), torch.zeros(2, whole), torch.ones(2, 3, dtype=torch.bool)
    file = io.BytesIO()
    with warnings.catch_warnings(action="ignore", category=DeprecationWarning):
        torch.onnx.export(  # the new exporter, dynamo=True, would need the package onnxscript
            network,
            inputs,
            file,
            dynamo=False,
            opset_version=OPSET,
            do_constant_folding=False,  # so that the weights keep their names
            input_names=list(_AXES)[:3],
            output_names=list(_AXES)[3:],
            dynamic_axes={name: dict(enumerate(axes)) for name, axes in _AXES.items()},
        )
    return file.getvalue()


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
        dropped_features=tuple(np.array(CANDIDATE_FEATURES)[network.shown.numpy() == 0].tolist()),
        dropped_kinds=tuple(CANDIDATE_FEATURES[kind] for kind in network.dropped_kinds),
        robot_speed_mps=facts.robot_speed_mps,
        training=facts.training,
        package_version=__version__,
        commit=commit(),
        metrics=facts.metrics,
        sha256=hashlib.sha256(content).hexdigest(),
    )
    text = dump(metadata, metadata_path(path))
    for file in (path, metadata_path(path)):
        prepare(file)
    with replaced(path) as new_model, replaced(metadata_path(path)) as new_metadata:
        new_model.write_bytes(content)
        new_metadata.write_text(text)
        _compare(network, LearnedPlanner(new_model))


def network_of(path: Path) -> EntityNetwork:
    """Return the network in an ONNX file of :func:`export_planner`; raises ValueError for another graph."""
    planner = LearnedPlanner(path)  # refuses external weights and graphs that do not run
    network = EntityNetwork(
        len(CANDIDATE_FEATURES),
        len(GLOBAL_FEATURES),
        planner.metadata.width,
        [CANDIDATE_FEATURES.index(name) for name in planner.metadata.dropped_features],
        [CANDIDATE_FEATURES.index(name) for name in planner.metadata.dropped_kinds],
    )
    weights = {tensor.name: onnx.numpy_helper.to_array(tensor) for tensor in onnx.load(path).graph.initializer}
    text = f"{path}: no graph that this version's pacman-env export writes"
    if {name: value.shape for name, value in weights.items()} != {n: v.shape for n, v in network.state_dict().items()}:
        raise ValueError(f"{text}: its weights have other names or shapes; export its checkpoint")
    network.load_state_dict({name: torch.tensor(value) for name, value in weights.items()})
    with located(text, ValueError, ValueError):
        _compare(network, planner)
    return network


def start_from(path: Path, network: EntityNetwork) -> None:
    """Copy the weights of a planner, an ONNX file or a checkpoint (.zip), into a network of the same width and inputs.

    Raises ValueError if the planner has another width or was trained with other ablations.
    """
    planner = load_network(path) if path.suffix.lower() == ".zip" else network_of(path)
    if planner.width != network.width:
        raise ValueError(f"width = {network.width}: {path} has {planner.width}")
    if planner.dropped_kinds != network.dropped_kinds or not torch.equal(planner.shown, network.shown.cpu()):
        raise ValueError(f"without: {path} was trained with other ablations, give those")
    network.load_state_dict(planner.state_dict())


def _compare(network: EntityNetwork, planner: LearnedPlanner) -> None:
    """Raise ValueError if the exported file and torch give different results for random inputs."""
    rng = np.random.default_rng(0)
    for games, count in ((1, 1), (1, 24), (7, 5), (64, 40)):
        candidates = rng.uniform(-2, 2, (games, count, network.candidate_features)).astype(np.float32)
        whole = rng.uniform(-2, 2, (games, len(GLOBAL_FEATURES))).astype(np.float32)
        mask = rng.random((games, count)) < 0.6
        with torch.no_grad():
            expected = [array.numpy() for array in network(*map(torch.from_numpy, (candidates, whole, mask)))]
        found = planner.run(candidates, whole, mask)
        for name, allowed in (("logits", mask), ("values", slice(None))):
            one, other = (arrays[name == "values"][allowed] for arrays in (found, expected))
            if not np.allclose(one, other, rtol=TOLERANCE, atol=TOLERANCE):
                worst = np.abs(one - other).max()
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
