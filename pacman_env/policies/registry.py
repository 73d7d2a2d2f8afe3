"""Policies by name. What is registered here needs nothing but the base install."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from pacman_env.heuristics.clyde_aware import ClydeAware
from pacman_env.heuristics.lookahead import Lookahead
from pacman_env.heuristics.simple import Nearest, Random
from pacman_env.policies.base import Policy

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
    """A new policy by name, ``make_policy("clyde_aware:documented", replan_margin_m=0.5)``.

    Raises:
        ValueError: an unknown name, or a parameter out of range.
        TypeError: a parameter the policy does not have.
    """
    try:
        factory = _FACTORIES[spec]
    except KeyError:
        raise ValueError(f"unknown policy {spec!r}: choose one of {', '.join(policy_names())}") from None
    return factory(**parameters)


register("clyde_aware", ClydeAware)
register("clyde_aware:documented", partial(ClydeAware, form="documented"))
register("lookahead", Lookahead)
register("nearest", Nearest)
register("random", Random)
