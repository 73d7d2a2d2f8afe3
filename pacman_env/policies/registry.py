"""Policies by name or by file. What is registered here needs nothing but the base install."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

from pacman_env.heuristics.clyde_aware import ClydeAware
from pacman_env.heuristics.lookahead import Lookahead
from pacman_env.heuristics.simple import Nearest, Random
from pacman_env.policies.base import Policy
from pacman_env.policies.learned import LearnedPlanner

_FACTORIES: dict[str, Callable[..., Policy]] = {}


def register(name: str, factory: Callable[..., Policy]) -> None:
    """Make ``factory(**parameters)`` available as ``name``.

    Raises:
        ValueError: the name is taken.
    """
    if name in _FACTORIES:
        raise ValueError(f"policy {name!r} is registered already")
    _FACTORIES[name] = factory


def policy_names() -> list[str]:
    """All names that ``make_policy`` knows, sorted."""
    return sorted(_FACTORIES)


def make_policy(spec: str, **parameters: Any) -> Policy:
    """A new policy by name, ``make_policy("clyde_aware:documented", replan_margin_m=0.5)``, or from ``runs/mine.onnx``.

    Raises:
        ValueError: an unknown name, a parameter out of range, or a file that is no planner for this version.
        TypeError: a parameter the policy does not have.
        ModuleNotFoundError: a learned planner without onnxruntime.
    """
    if spec in _FACTORIES:
        return _FACTORIES[spec](**parameters)
    if spec.endswith(".onnx"):
        return LearnedPlanner(spec, **parameters)
    raise ValueError(f"unknown policy {spec!r}: choose one of {', '.join(policy_names())}, or an .onnx file")


def split_ghosts(ghosts: Sequence[str]) -> tuple[tuple[str, ...], dict[int, Policy]]:
    """Behaviours by ghost, ``policy`` where an .onnx file moves him, and those policies by his number.

    Raises:
        ValueError: a file is no planner for this version.
    """
    policies = {number: make_policy(name) for number, name in enumerate(ghosts) if name.endswith(".onnx")}
    return tuple("policy" if number in policies else name for number, name in enumerate(ghosts)), policies


register("clyde_aware", ClydeAware)
register("clyde_aware:documented", partial(ClydeAware, form="documented"))
register("lookahead", Lookahead)
register("nearest", Nearest)
register("ppo", LearnedPlanner)
register("random", Random)
