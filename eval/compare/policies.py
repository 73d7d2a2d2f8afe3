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
    """``--policies`` and ``--trust``; ``order`` says what the order means."""
    parser.add_argument(
        "--policies",
        nargs="+",
        default=list(default),
        metavar="POLICY",
        help=f"{order}; names ({', '.join(policy_names())}), .onnx files, with --trust checkpoints (.zip);"
        f" without: {' '.join(default)}",
    )
    parser.add_argument("--trust", action="store_true", help="load checkpoints, which can run any code they hold")


def load_policy(spec: str, trust: bool = False) -> Policy:
    """A new policy.

    Args:
        spec: what the registry makes one from, or a checkpoint of Stable-Baselines3 (``.zip``).
        trust: checkpoints may be loaded, although they are pickled.

    Raises:
        ValueError: there is no such policy, or it cannot be loaded.
    """
    if Path(spec).suffix != ".zip":
        return make_policy(spec)
    if not trust:
        raise ValueError(f"{spec}: loading executes code from the file; give --trust if you know where it is from")
    try:
        import torch

        # train lies beside eval, at the top of the checkout or in the package; it imports nothing from here
        checkpoint = import_module(f"{__name__.removesuffix('eval.compare.policies')}train.checkpoint")
    except ModuleNotFoundError as error:
        raise ValueError(f"{spec}: needs {error.name}: pip install 'pacman_env[train]'") from None
    torch.set_num_threads(1)  # cores are for processes: threads of each would wait for one another at every decision
    policy: Policy = checkpoint.load_planner(Path(spec), trust=True)
    return policy


def named_policies(specs: Sequence[str], trust: bool) -> dict[str, str]:
    """Names in results by spec, each spec once.

    Raises:
        ValueError: a policy cannot be made; all are tried.
    """
    for spec in specs:
        load_policy(spec, trust)
    return result_names(specs)


def result_names(specs: Sequence[str]) -> dict[str, str]:
    """By spec, a name that no other has: the spec, of a file its stem unless another is called that too."""
    short = {spec: Path(spec).stem if Path(spec).suffix in _FILES else spec for spec in specs}
    taken = list(short.values())
    return {spec: name if taken.count(name) == 1 or name == spec else spec for spec, name in short.items()}
