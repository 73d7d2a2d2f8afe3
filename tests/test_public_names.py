"""The public names, those of ``pacman_env`` and ``pacman_env.sb3``: lazy, typed, documented, enough for the docs."""

import ast
import inspect
import re
import subprocess
import sys
import textwrap
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import pacman_env
import pacman_env.sb3
from tests.pages import examples

ROOT = Path(__file__).resolve().parents[1]
NAMES = sorted(set(pacman_env.__all__) - {"__version__"})
PUBLIC = {
    **{name: getattr(pacman_env, name) for name in NAMES},
    **{f"sb3.{name}": getattr(pacman_env.sb3, name) for name in pacman_env.sb3.__all__},
}
DOCUMENTED = {name: thing for name, thing in PUBLIC.items() if callable(thing)}  # constants have no docstring
SHAPE = re.compile(r"\(\w+(, \w+)*,?\)")  # (N,), (N, C), (H, W, 3)
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
#: Programs, not examples for users: the grader of the exercises, and research on the inside of planner and simulator.
PROGRAMS = (
    "checks.py",
    "child.py",
    "grade.py",
    "student.py",
    "tune.py",
    "adversary.py",
    "bound.py",
    "blocks.py",
    "pursuit.py",
    "rollouts.py",
)
SOURCES = {
    **{f"{page.name}-{k}": example for page in PAGES for k, example in enumerate(examples(page))},
    **{
        str(path.relative_to(ROOT)): path.read_text()
        for path in sorted((ROOT / "docs").rglob("*.py"))
        if path.name not in PROGRAMS
    },
}


def imported(source: str) -> Iterator[str]:
    """The modules and names of the package that a source imports."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names if alias.name.partition(".")[0] == "pacman_env")
        elif isinstance(node, ast.ImportFrom) and (node.module or "").partition(".")[0] == "pacman_env":
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


@pytest.mark.parametrize("source", SOURCES.values(), ids=SOURCES)
def test_docs_and_examples_import_only_public_names(source: str) -> None:
    allowed = {"pacman_env", "pacman_env.__version__", "pacman_env.sb3", *(f"pacman_env.{name}" for name in PUBLIC)}
    assert set(imported(source)) <= allowed
    used = set(
        re.findall(r"\bpacman_env\.(\w+)", "".join(line for line in source.splitlines() if "import" not in line))
    )
    assert used <= {*NAMES, "sb3"}


def test_type_checker_names_equal_runtime_names() -> None:
    tree = ast.parse(inspect.getsource(pacman_env))
    (block,) = (node for node in tree.body if isinstance(node, ast.If))
    typed = {alias.name for node in block.body for alias in getattr(node, "names", ())}
    assert {*typed, "register_envs"} == set(NAMES)
    assert set(NAMES) <= set(dir(pacman_env))


def test_unknown_name_raises_attribute_error() -> None:
    with pytest.raises(AttributeError, match="module 'pacman_env' has no attribute 'nothing'"):
        pacman_env.nothing  # noqa: B018


def members(thing: Any) -> Iterator[tuple[str, Any]]:
    """A function itself; of a class, its public methods and properties that the package defines."""
    if not inspect.isclass(thing):
        yield "", thing
        return
    for cls in thing.__mro__:
        if cls.__module__.partition(".")[0] == "pacman_env":
            for name, member in vars(cls).items():
                function = member.fget if isinstance(member, property) else getattr(member, "__func__", member)
                if not name.startswith("_") and inspect.isfunction(function) and hasattr(thing, name):
                    yield name, function


@pytest.mark.parametrize("name", DOCUMENTED)
def test_public_name_documents_exceptions_and_array_shapes(name: str) -> None:
    thing, lacking = DOCUMENTED[name], []
    whole = inspect.getdoc(thing) or ""
    for member, function in [("", None), *members(thing)]:
        doc = inspect.getdoc(function) if member else whole
        if member and not doc:  # inherited
            doc = inspect.getdoc(getattr(thing, member))
        if not doc:
            lacking.append(f"{name}.{member}: no docstring")
        elif function is not None:
            code = ast.parse(textwrap.dedent(inspect.getsource(function)))
            raises = any(isinstance(node, ast.Raise) and node.exc for node in ast.walk(code))
            if raises and not re.search(r"\b[Rr]aises?\b", doc):
                lacking.append(f"{name}.{member}: what it raises")
            if "NDArray" in str(inspect.signature(function)) and not SHAPE.search(doc + whole):
                lacking.append(f"{name}.{member}: the shapes of its arrays")
    assert not lacking


OWN = """
import gymnasium as gym
import numpy as np
from pacman_env import BasePolicy, Behaviour, ObservationPart, make_policy, policy_names
from pacman_env import register_ghost, register_observation, register_policy, register_preset


class East(BasePolicy):
    name = "east"

    def scores(self, situation):
        return situation.position[..., 0]


class Left:
    name = "left"

    def parts(self, batch):
        return {"left": ObservationPart(0, 1e4, (1,), np.float32)}

    def fill(self, batch, situation):
        return {"left": situation.pellets_left[:, None].astype(np.float32)}


def stay(view, parameters):
    return view.x, view.y


register_policy("east", East)
register_observation("left", Left)
register_preset("slow", {"clyde.speed_mps": 0.1})
register_ghost("stay", Behaviour("stay", stay))
env = gym.make("pacman_env/PacManBot-v2", map="loop", preset="slow", observation="left", ghosts=["stay", "east"])
observation, info = env.reset(seed=0)
env.step(0)
config = env.unwrapped.config
assert observation["left"] == [info["spawned"]] and config.clyde.speed_mps == 0.1
assert config.clyde.ghosts == ("stay", "policy") and "east" in policy_names()
"""


def test_registered_objects_are_available_by_name(tmp_path: Path) -> None:
    """In a process of its own, as a registration is for a whole process."""
    (tmp_path / "own.py").write_text(OWN)
    done = subprocess.run([sys.executable, "own.py"], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
