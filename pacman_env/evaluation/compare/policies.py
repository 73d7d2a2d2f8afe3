"""The compared policies: made from a registered name or a file, and what they are called in results."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path

from pacman_env.policies.base import Policy
from pacman_env.policies.registry import make_policy, policy_names

_FILES = (".onnx", ".zip")


def add_policy_arguments(parser: argparse.ArgumentParser, default: Sequence[str], order: str) -> None:
    """``--policies``; ``order`` is the meaning of their order."""
    names = f"names ({', '.join(policy_names())}), .onnx files, checkpoints of a training (.zip)"
    words = f"{order}; {names}; without: {' '.join(default)}"
    parser.add_argument("--policies", nargs="+", default=list(default), metavar="POLICY", help=words)


def load_policy(spec: str) -> Policy:
    """A new policy, from a name or file that the registry knows, or from a checkpoint (``.zip``)."""
    if not is_checkpoint(spec):
        return make_policy(spec)
    try:
        import torch

        checkpoint = import_module("pacman_env.training.checkpoint")  # by name: the two rooms do not import each other
    except ModuleNotFoundError as error:
        raise ValueError(f"{spec}: needs {error.name}: pip install 'pacman_env[train]'") from None
    torch.set_num_threads(1)  # cores are for processes: threads of each would wait for one another at every decision
    policy: Policy = checkpoint.load_planner(Path(spec))
    return policy


def is_checkpoint(spec: str) -> bool:
    return spec.endswith(".zip")


def named_policies(specs: Sequence[str]) -> dict[str, str]:
    """Names in results by spec, each spec once; raises ValueError if a policy cannot be made."""
    for spec in specs:
        load_policy(spec)
    return result_names(specs)


def result_names(specs: Sequence[str]) -> dict[str, str]:
    """By spec, a name that no other has: the spec, of a file its stem unless another is called that too."""
    short = {spec: Path(spec).stem if Path(spec).suffix in _FILES else spec for spec in specs}
    taken = list(short.values())
    return {spec: name if taken.count(name) == 1 or name == spec else spec for spec, name in short.items()}
