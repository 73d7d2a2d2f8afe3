"""How large a file, a class and a function may be, so that each can be read at once."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path
from typing import TypeVar

ROOT = Path(__file__).resolve().parents[1]
FOLDERS = ("pacman_env", "train", "eval", "benchmarks", "tools")
SOURCES = sorted(
    path for folder in FOLDERS for path in (ROOT / folder).rglob("*") if path.suffix in (".py", ".js", ".css", ".html")
)
MOST_LINES = 450
MOST_METHODS = 25
MOST_ATTRIBUTES = 25
MOST_ARGUMENTS = 8
T = TypeVar("T", ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)


def definitions(kind: type[T]) -> Iterator[tuple[str, T]]:
    """Return place and node of each class or function of the sources."""
    for path in (path for path in SOURCES if path.suffix == ".py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, kind):
                yield f"{path.relative_to(ROOT)}:{node.name}", node


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


def test_files_have_at_most_450_lines() -> None:
    lines = {str(path.relative_to(ROOT)): len(path.read_text().splitlines()) for path in SOURCES}
    assert len(lines) > 250
    assert {name: count for name, count in lines.items() if count > MOST_LINES} == {}


def test_file_to_begin_with_has_at_most_250_lines_in_every_room() -> None:
    table = re.findall(r"^\| `(\w+)/` \| `([\w/]+\.py)` \|", (ROOT / "docs/architecture.md").read_text(), re.MULTILINE)
    package = ROOT / "pacman_env"
    assert {room for room, _ in table} == {path.parent.name for path in package.glob("*/__init__.py")}
    lines = {file: len((package / file).read_text().splitlines()) for _, file in table}
    assert {file: count for file, count in lines.items() if count > 250} == {}


def test_classes_have_at_most_25_methods_or_attributes() -> None:
    large = {}
    for place, owner in definitions(ast.ClassDef):
        methods = sum(isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef) for node in owner.body)
        if methods > MOST_METHODS or len(attributes(owner)) > MOST_ATTRIBUTES:
            large[place] = (methods, len(attributes(owner)))
    assert large == {}


def test_functions_have_at_most_8_arguments_except_constructors() -> None:
    functions = (*definitions(ast.FunctionDef), *definitions(ast.AsyncFunctionDef))
    large = {place: arguments(function) for place, function in functions if arguments(function) > MOST_ARGUMENTS}
    constructors = {one for one in large if one.startswith("pacman_env/envs/") and one.endswith(":__init__")}
    assert set(large) == constructors, large
