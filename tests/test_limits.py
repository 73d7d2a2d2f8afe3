"""How large a file, a class and a function may be, so that each can be read at once."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
FOLDERS = ("pacman_env", "train", "eval", "benchmarks", "tools")
SOURCES = sorted(
    path for folder in FOLDERS for path in (ROOT / folder).rglob("*") if path.suffix in (".py", ".js", ".css", ".html")
)
MOST_LINES = 450
MOST_METHODS = 25
MOST_ATTRIBUTES = 25
MOST_ARGUMENTS = 8


def classes(tree: ast.AST) -> Iterator[ast.ClassDef]:
    yield from (node for node in ast.walk(tree) if isinstance(node, ast.ClassDef))


def functions(tree: ast.AST) -> Iterator[ast.FunctionDef | ast.AsyncFunctionDef]:
    yield from (node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef))


def attributes(owner: ast.ClassDef) -> set[str]:
    """Fields that the class declares, and what its methods assign to ``self``."""
    declared = {
        node.target.id for node in owner.body if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name)
    }
    assigned = {
        node.attr
        for node in ast.walk(owner)
        if isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Store)
        if isinstance(node.value, ast.Name) and node.value.id == "self"
    }
    return declared | assigned


def arguments(function: ast.FunctionDef | ast.AsyncFunctionDef) -> int:
    """Without ``self`` or ``cls``."""
    named = [one.arg for one in (*function.args.posonlyargs, *function.args.args, *function.args.kwonlyargs)]
    return len(named) - (named[:1] in (["self"], ["cls"]))


@pytest.fixture(scope="module")
def trees() -> dict[str, ast.AST]:
    return {str(path.relative_to(ROOT)): ast.parse(path.read_text()) for path in SOURCES if path.suffix == ".py"}


def test_files_have_at_most_450_lines() -> None:
    lines = {str(path.relative_to(ROOT)): len(path.read_text().splitlines()) for path in SOURCES}
    assert len(lines) > 250
    assert {name: count for name, count in lines.items() if count > MOST_LINES} == {}


def test_classes_have_at_most_25_methods_or_attributes(trees: dict[str, ast.AST]) -> None:
    large = {}
    for name, tree in trees.items():
        for owner in classes(tree):
            methods = sum(isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef) for node in owner.body)
            if methods > MOST_METHODS or len(attributes(owner)) > MOST_ATTRIBUTES:
                large[f"{name}:{owner.name}"] = (methods, len(attributes(owner)))
    assert large == {}


def test_functions_have_at_most_8_arguments_except_constructors(trees: dict[str, ast.AST]) -> None:
    large = {}
    for name, tree in trees.items():
        for function in functions(tree):
            if arguments(function) > MOST_ARGUMENTS:
                large[f"{name}:{function.name}"] = arguments(function)
    constructors = {one for one in large if one.startswith("pacman_env/envs/") and one.endswith(":__init__")}
    assert set(large) == constructors, large
