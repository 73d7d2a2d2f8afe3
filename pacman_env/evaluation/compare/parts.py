"""Rounds that were played, in files: what decides them, and files that are whole or are not used.

A file's name begins with a hash of everything that decides its rounds; the same stands in it and is compared.
"""

import contextlib
import hashlib
import inspect
import json
from pathlib import Path
from typing import Any, Literal, TypeVar

import msgspec

from pacman_env import __version__
from pacman_env.config import Config
from pacman_env.evaluation.compare.scenarios import Scenario, describe_scenario
from pacman_env.files import replaced
from pacman_env.game.ghosts import find_behaviour
from pacman_env.plugins import PluginError
from pacman_env.policies.base import Policy
from pacman_env.policies.learned import LearnedPlanner
from pacman_env.policies.metadata import parse
from pacman_env.policies.registry import POLICIES, make_policy, moved_by_policy
from pacman_env.world.maps.occupancy import OccupancyMap

SCHEMA: Literal[1] = 1
Kind = TypeVar("Kind", bound="PartFile")


class PartFile(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The content of a part's file; a subclass says of what type ``rounds`` are."""

    schema: Literal[1]
    decides: dict[str, Any]  # everything that decides the rounds
    commit: str  # of the sources that played it
    rounds: Any
    sha256: str  # of ``rounds``, so that a changed digit is noticed


def decides(policy: dict[str, Any], where: dict[str, Any], config: Config, **more: Any) -> dict[str, Any]:
    """Plain data, everything that decides rounds; the first two as the functions below describe them."""
    ghosts = [_describe_ghost(ghost) for ghost in config.clyde.ghosts]
    about = {"version": __version__, "policy": policy, "map": where, "ghosts": ghosts}
    return {**about, **more, "config": config.as_dict()}


def describe_policy(policy: Policy, spec: str) -> dict[str, Any]:
    """What decides the choices of a policy made from ``spec``: a planner's file, else names, code and base."""
    if isinstance(policy, LearnedPlanner):
        return {"sha256": policy.metadata.sha256, "robot_speed_mps": policy.metadata.robot_speed_mps}
    base = getattr(policy, "base", None)
    kind = type(policy)
    about: dict[str, Any] = {"name": spec, "class": f"{kind.__module__}:{kind.__qualname__}", "code": _code_of(kind)}
    with contextlib.suppress(PluginError):  # a base that has a name of its own
        about["made_by"] = _code_of(POLICIES.find(spec))  # a function's file says with which parameters
    return about if base is None else about | {"base": describe_policy(base, base.name)}


def describe_map(scenario: Scenario | OccupancyMap, config: Config) -> dict[str, Any]:
    """What decides the maps of a scenario; not the configuration, which only opens them."""
    about = describe_scenario("", scenario, config)
    return {key: value for key, value in about.items() if key not in ("name", "source")}


def read_part(path: Path, kind: type[Kind], expected: dict[str, Any]) -> Kind | None:
    """A part, None where it is absent; raises ValueError, which names the file, where it is damaged."""
    try:
        text = path.read_bytes()
    except FileNotFoundError:
        return None
    except OSError as error:
        raise ValueError(f"{path}: cannot be read: {error.strerror}") from None
    found = parse(kind, text, path)
    if found.decides != expected:
        raise ValueError(f"{path}: decides: of another part")
    if found.sha256 != rounds_hash(found.rounds):
        raise ValueError(f"{path}: sha256: not that of its rounds")
    return found


def write_part(path: Path, part: Kind) -> Kind:
    """Write a part; its file is whole or absent."""
    with replaced(path) as temporary:
        temporary.write_bytes(msgspec.json.encode(part) + b"\n")
    return part


def rounds_hash(rounds: msgspec.Struct) -> str:
    """What is ``sha256`` in a part of these rounds."""
    return content_hash(msgspec.to_builtins(rounds))


def content_hash(content: Any) -> str:
    """SHA-256 of plain data, in hexadecimal."""
    return hashlib.sha256(json.dumps(content, sort_keys=True, separators=(",", ":")).encode()).hexdigest()


def _describe_ghost(name: str) -> dict[str, Any] | str | None:
    """What decides the moves of a ghost beside its name: the policy that moves it, or its behaviour's code."""
    if moved_by_policy(name):
        return describe_policy(make_policy(name), name)
    return _code_of(find_behaviour(name).target)


def _code_of(thing: Any) -> str | None:
    """The hash of the file that defines a class or function; None of what is the package's: that is its version's."""
    module = getattr(thing, "__module__", None) or ""
    if not module or module.partition(".")[0] == __package__.partition(".")[0]:
        return None
    try:
        return hashlib.sha256(Path(inspect.getfile(thing)).read_bytes()).hexdigest()
    except (TypeError, OSError):
        return None
