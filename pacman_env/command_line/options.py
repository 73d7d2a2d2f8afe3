"""Convert a dataclass of settings to command-line options; the string below a field is the help of its option."""

import argparse
import ast
import dataclasses
import inspect
import itertools
import textwrap
import types
import typing
from collections.abc import Sequence
from pathlib import Path
from typing import Any, TypeVar

from .command import finite_number

T = TypeVar("T")
_SCALARS: dict[Any, dict[str, Any]] = {
    int: {"type": int, "metavar": "N"},
    float: {"type": finite_number(), "metavar": "X"},
    str: {"metavar": "WORD"},
    Path: {"type": Path, "metavar": "PATH"},
}


def parse_options(parser: argparse.ArgumentParser, argv: Sequence[str] | None, default: T) -> T:
    """Return a copy of the dataclass ``default`` with the command line's values; call :func:`add_options` first."""
    arguments = vars(parser.parse_args(argv))
    try:
        return _replaced(default, arguments)
    except ValueError as error:
        parser.error(str(error))


def add_options(parser: argparse.ArgumentParser, default: Any) -> None:
    """Add an option for each field of a dataclass and of dataclasses in it."""
    texts, hints = help_texts(type(default)), typing.get_type_hints(type(default))
    for name, value in _values(default).items():
        if dataclasses.is_dataclass(value):
            add_options(parser, value)
            continue
        shown = " ".join(map(str, value)) if isinstance(value, tuple) else value
        if isinstance(value, Path) and value.is_absolute():  # a file of the package: show only its name
            shown = value.name
        text = f"{texts.get(name, '')} ({shown})".lstrip().replace("%", "%%").replace("``", "")
        parser.add_argument(f"--{name.replace('_', '-')}", default=value, help=text, **_kind(hints[name]))


def _replaced(default: T, given: dict[str, Any]) -> T:
    changes = {}
    for name, value in _values(default).items():
        new = _replaced(value, given) if dataclasses.is_dataclass(value) else given[name]
        changes[name] = tuple(new) if isinstance(new, list) else new
    return dataclasses.replace(default, **changes)  # type: ignore[type-var]


def _values(default: Any) -> dict[str, Any]:
    return {field.name: getattr(default, field.name) for field in dataclasses.fields(default)}


def _kind(hint: Any) -> dict[str, Any]:
    """Return the arguments of ``add_argument`` for a field with the type ``hint``."""
    if hint is bool:
        return {"action": argparse.BooleanOptionalAction}
    if typing.get_origin(hint) is types.UnionType:
        (hint,) = (one for one in typing.get_args(hint) if one is not type(None))
    if typing.get_origin(hint) is typing.Literal:
        return {"choices": typing.get_args(hint)}
    if typing.get_origin(hint) is not tuple:
        return _SCALARS[hint]
    first, second = typing.get_args(hint)
    if second is not Ellipsis:
        return {**_SCALARS[first], "nargs": 2}
    choices = typing.get_args(first)
    return {**({"choices": choices} if choices else _SCALARS[first]), "nargs": "*"}


def help_texts(kind: type) -> dict[str, str]:
    """Return the string below each field of a dataclass, by field name."""
    (node,) = ast.parse(textwrap.dedent(inspect.getsource(kind))).body
    assert isinstance(node, ast.ClassDef)
    return {
        field.target.id: " ".join(inspect.cleandoc(text.value.value).split())
        for field, text in itertools.pairwise(node.body)
        if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name)
        if isinstance(text, ast.Expr) and isinstance(text.value, ast.Constant) and isinstance(text.value.value, str)
    }
