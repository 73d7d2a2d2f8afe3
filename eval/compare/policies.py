"""The policies of a comparison: found by a registered name or a file, and what they are called in results.

What a policy file holds is read elsewhere; here is decided whether it may be read.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from pacman_env.policies.base import Policy
from pacman_env.policies.registry import make_policy, policy_names

_FILES = (".onnx", ".zip")


def add_policy_arguments(parser: argparse.ArgumentParser, default: Sequence[str], what: str) -> None:
    """``--policies`` and ``--trust``; ``what`` says what the order means."""
    parser.add_argument(
        "--policies",
        nargs="+",
        default=list(default),
        metavar="POLICY",
        help=f"{what}; names ({', '.join(policy_names())}), .onnx files, with --trust checkpoints (.zip);"
        f" without: {' '.join(default)}",
    )
    parser.add_argument("--trust", action="store_true", help="load checkpoints, which can run any code they hold")


def make_contestant(spec: str, trust: bool = False) -> Policy:
    """A new policy; with a checkpoint, torch keeps to one thread in this process from then on.

    Args:
        spec: a name of the registry, an ``.onnx`` file, or a checkpoint of Stable-Baselines3 (``.zip``).
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

        from train.checkpoint import load_planner
    except ModuleNotFoundError as error:
        raise ValueError(f"{spec}: needs {error.name}: pip install 'pacman_env[train]'") from None
    torch.set_num_threads(1)  # cores are for processes: threads of each would wait for one another at every decision
    return load_planner(Path(spec), trust=True)


def check_contestants(specs: Sequence[str], trust: bool) -> None:
    """Make each policy once.

    Raises:
        ValueError: one cannot be made.
    """
    for spec in specs:
        make_contestant(spec, trust)


def contestant_names(specs: Sequence[str]) -> dict[str, str]:
    """By spec, a name that no other has: the spec, of a file its stem unless another is called that too."""
    short = {spec: Path(spec).stem if Path(spec).suffix in _FILES else spec for spec in specs}
    taken = list(short.values())
    return {spec: name if taken.count(name) == 1 or name == spec else spec for spec, name in short.items()}
