"""Every field of the configuration as a person is told of it: unit, range, words; read from the source."""

from __future__ import annotations

import ast
import dataclasses
import functools
import inspect
import io
import tokenize
import typing
from typing import Any

from msgspec import Meta

from . import composition, sections
from .composition import FIELDS, Config

_UNITS = (
    ("_mps2", "m/s²"), ("_mps", "m/s"), ("_radps", "rad/s"), ("_rad", "rad"), ("_kg", "kg"), ("_m", "m"), ("_s", "s")
)  # fmt: skip


@dataclasses.dataclass(frozen=True)
class Field:
    """One field of a configuration's section, as it is written in the source."""

    name: str
    kind: str  # its annotation
    comment: str

    @property
    def unit(self) -> str:
        """By the end of its name; "" for a pure number, a name or a choice."""
        return next((unit for ending, unit in _UNITS if self.name.endswith(ending)), "")


def fields_of(source: str) -> dict[str, list[Field]]:
    """Fields of every class in a source: comments are those behind a field, or alone on the lines above it."""
    comments, alone = {}, set()
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type == tokenize.COMMENT:
            comments[token.start[0]] = token.string.lstrip("#: ")
            if not token.line[: token.start[1]].strip():
                alone.add(token.start[0])
    result = {}
    for node in ast.parse(source).body:
        if isinstance(node, ast.ClassDef):
            fields = []
            for part in node.body:
                if isinstance(part, ast.AnnAssign) and isinstance(part.target, ast.Name):
                    first = part.lineno
                    while first - 1 in alone:
                        first -= 1
                    lines = [n for n in range(first, (part.end_lineno or part.lineno) + 1) if n in comments]
                    words = " ".join(comments[n] for n in lines)
                    fields.append(Field(part.target.id, ast.unparse(part.annotation), words))
            result[node.name] = fields
    return result


@dataclasses.dataclass(frozen=True)
class Setting:
    """One field as a form shows it.

    Attributes:
        name: dotted.
        value: the default.
        type: ``number``, ``integer``, ``bool``, ``choice`` or ``text``.
        unit: "" for a pure number, a name or a choice.
        low, high: the range that its annotation gives, None: none.
        options: of a choice.
        words: what it is.
    """

    name: str
    value: Any
    type: str
    unit: str
    low: float | None
    high: float | None
    options: tuple[str, ...]
    words: str


_SIMPLE = {float: "number", int: "integer", bool: "bool", str: "text"}


@functools.cache
def settings() -> tuple[Setting, ...]:
    """All fields that hold one plain value, in the order of the source."""
    sources = {**fields_of(inspect.getsource(sections)), **fields_of(inspect.getsource(composition))}
    default = Config()
    found = []
    for name, annotation in FIELDS.items():
        group, _, leaf = name.rpartition(".")
        owner = getattr(default, group) if group else default
        field = next((f for f in sources[type(owner).__name__] if f.name == leaf), None)
        kind, metas = annotation, []
        while typing.get_origin(kind) is typing.Annotated:
            metas += [m for m in typing.get_args(kind)[1:] if isinstance(m, Meta)]
            kind = typing.get_args(kind)[0]
        options = typing.get_args(kind) if typing.get_origin(kind) is typing.Literal else ()
        if field is None or not (options or kind in _SIMPLE):
            continue
        low = next((float(b) for m in metas for b in (m.ge, m.gt) if b is not None), None)
        high = next((float(b) for m in metas for b in (m.le, m.lt) if b is not None), None)
        found.append(
            Setting(
                name=name,
                value=getattr(owner, leaf),
                type="choice" if options else _SIMPLE[kind],
                unit=field.unit,
                low=None if low is not None and abs(low) >= 1e300 else low,
                high=None if high is not None and abs(high) >= 1e300 else high,
                options=options,
                words=field.comment,
            )
        )
    return tuple(found)
