"""Hash what figures depend on, so that a figure older than its inputs is noticed."""

import ast
import hashlib
import json
from collections.abc import Iterable, Iterator
from pathlib import Path

from pacman_env.config import EXECUTIONS, PRESETS, make_config
from tools.common import ROOT

# Files and folders of pacman_env; a file belongs to the input with the longest matching path.
INPUTS: dict[str, tuple[str, ...]] = {
    "planner": ("policies/pretrained/ppo.json", "policies/pretrained/ppo.onnx"),
    "learned Clyde": ("policies/pretrained/clyde.json", "policies/pretrained/clyde.onnx"),
    "features": ("observations",),
    "engine": ("game", "rng.py", "levels", "sim", "world"),
    "policies": ("heuristics", "policies"),
    "search": ("heuristics/search", "levels/coarse_map.py", "sim/coarse_model.py", "observations/coarse_start.py"),
    "environments": ("envs",),
    "evaluation": ("episodes", "evaluation/rounds", "executors"),
    "training": ("training",),
    "compiler": ("engine",),
}
SETTINGS = "settings"  # the input that is not a file: the values of all presets and executions


def hashes(names: Iterable[str], package: Path = ROOT / "pacman_env") -> dict[str, str]:
    """Return the hash of each input; comments, docstrings and the layout of Python files do not count."""
    return {name: (_settings() if name == SETTINGS else _hash(name, package))[:16] for name in names}


def _settings() -> str:
    made = [make_config(preset, execution=rules).as_dict() for preset in PRESETS for rules in EXECUTIONS]
    return hashlib.sha256(json.dumps(made, sort_keys=True).encode()).hexdigest()


def _hash(name: str, package: Path) -> str:
    digest = hashlib.sha256()
    for path in sorted(_files(name, package)):
        digest.update(path.relative_to(package).as_posix().encode() + b"\0")
        digest.update(_code(path).encode() if path.suffix == ".py" else path.read_bytes())
    return digest.hexdigest()


def _files(name: str, package: Path) -> Iterator[Path]:
    owners = {package / place: owner for owner, places in INPUTS.items() for place in places}
    for path in package.rglob("*"):
        owner = next((owners[place] for place in (path, *path.parents) if place in owners), None)
        if owner == name and path.is_file() and "__pycache__" not in path.parts:
            yield path


def _code(path: Path) -> str:
    tree = ast.parse(path.read_text(encoding="utf-8"))
    for node in ast.walk(tree):
        body = getattr(node, "body", None)
        if isinstance(body, list):
            node.body = [line for line in body if not _is_text(line)]  # type: ignore[attr-defined]
    return ast.unparse(tree)


def _is_text(line: ast.stmt) -> bool:
    return isinstance(line, ast.Expr) and isinstance(line.value, ast.Constant) and isinstance(line.value.value, str)
