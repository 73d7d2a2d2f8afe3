"""Check typed values: settings, fields of a configuration, files and snapshots.

msgspec checks types and ranges; each class checks the rules between its fields. Messages give field, value and rule.
"""

import contextlib
import dataclasses
import functools
import math
import operator
import re
import typing
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
from msgspec import Meta

LARGEST = 1e300  # bound that excludes infinity
Number = Annotated[float, Meta(ge=-LARGEST, le=LARGEST)]
NotNegative = Annotated[float, Meta(ge=0, le=LARGEST)]
Positive = Annotated[float, Meta(gt=0, le=LARGEST)]
Share = Annotated[float, Meta(ge=0, le=1)]
Count = Annotated[int, Meta(ge=0)]
AtLeastOne = Annotated[int, Meta(ge=1)]


class ConfigError(ValueError):
    """Raised for a value of a wrong type or out of range; the message gives the field, the value and the rule."""


def require(condition: bool, field_name: str, value: object, rule: str) -> None:
    """Raise a ConfigError with field, value and ``rule`` unless the condition holds."""
    if not condition:
        shown = str(value) if isinstance(value, Path) else value
        raise ConfigError(f"{field_name} = {shown!r:.600}: {rule}")


@contextlib.contextmanager
def located(
    place: object,
    raised: type[Exception] = ConfigError,
    caught: type[Exception] | tuple[type[Exception], ...] = ConfigError,
) -> Iterator[None]:
    """Raise errors ``caught`` in the block as ``raised``, with ``place`` in front of the message."""
    try:
        yield
    except caught as error:
        raise raised(f"{place}: {error}") from None


#: Returns the fields of a class with their types, ranges included.
kinds: Callable[[Any], dict[str, Any]] = functools.cache(functools.partial(typing.get_type_hints, include_extras=True))


def convert(value: object, kind: Any, name: str = "", *, strict: bool = True) -> Any:
    """Convert ``value`` to the type ``kind`` and check its range; raises ConfigError, with ``name`` in the message.

    If the type requires it, a list becomes a tuple and a whole number becomes a float. A NumPy number becomes a Python
    number. Text becomes a number only if not ``strict``. ``kind`` may contain a range (``msgspec.Meta``).
    """
    try:
        return msgspec.convert(
            _plain(value, numbers=not strict), kind, strict=strict, dec_hook=lambda kind, value: kind(value)
        )
    except (msgspec.ValidationError, RecursionError) as error:
        raise ConfigError(_message(str(error), value, kind, name)) from None


def setting(default: Any, description: str) -> Any:
    """Declare a field of a dataclass with its default and its description for documents and forms."""
    return dataclasses.field(default=default, metadata={"description": description})


class Checked:
    """Base class of dataclasses whose values are checked against their annotations; messages contain ``group``."""

    _prefix = ""

    def __init_subclass__(cls, group: str = "") -> None:
        cls._prefix = f"{group}." if group else ""

    def __post_init__(self) -> None:
        for field, kind in kinds(type(self)).items():
            value, name = getattr(self, field), self._prefix + field
            if isinstance(kind, type) and issubclass(kind, Checked):
                require(isinstance(value, kind), name, value, f"must be a {kind.__name__}")
            else:
                object.__setattr__(self, field, convert(value, kind, name))

    def _require(self, condition: bool, name: str, rule: str) -> None:
        """Call :func:`require` for a field, given by its name within this group."""
        require(condition, self._prefix + name, operator.attrgetter(name)(self), rule)


def _plain(value: Any, *, numbers: bool = False) -> Any:
    """Convert NumPy values to Python values, and lists and tuples to lists.

    With ``numbers``, also rewrite a text such as ".3" or "1_000" as "0.3" or "1000", which msgspec can read.
    """
    if isinstance(value, (list, tuple)):
        return [_plain(one, numbers=numbers) for one in value]
    if isinstance(value, str) and numbers:
        for kind in (int, float):
            with contextlib.suppress(ValueError):
                return str(kind(value))  # msgspec refuses texts such as .3, +60, 5. and 1_000
    return value.tolist() if hasattr(value, "tolist") else value


def _message(error: str, value: Any, kind: Any, name: str) -> str:
    """Add field and value to msgspec's message: ``robot.speed_mps = -1.0: Expected `float` > 0.0``."""
    rule, _, place = error.partition(" - at `$")
    place, in_dict, _ = place.partition("[...]")
    for key, index in re.findall(r"\.(\w+)|\[(\d+)\]", place):
        value = value[key] if key else value[int(index)]
        name = f"{name}.{key}" if key else f"{name}[{index}]"
        kind = _inside(kind, key or int(index))
    name = name.lstrip(".")
    for key, one in value.items() if in_dict else ():
        convert(one, typing.get_args(kind)[1], f"{name}.{key}")  # raises with the key, which msgspec omits
    if rule.startswith("Object "):  # a field is missing or unknown
        return f"{name}: {rule}" if name else rule
    if rule.startswith("Invalid enum value"):
        rule = f"must be one of {_choices(kind)}"
    elif isinstance(value, float) and not math.isfinite(value):
        rule = "must be a finite number"
    return f"{name or 'content'} = {value!r:.600}: {rule}"


def _inside(kind: Any, place: str | int) -> Any:
    """Return the type of the field or list entry ``place`` in ``kind``, which may be optional; None if unknown."""
    origin, inner = typing.get_origin(kind), typing.get_args(kind)
    if origin is None:
        return kinds(kind).get(place) if isinstance(kind, type) and isinstance(place, str) else None
    if origin in (tuple, list):
        many = origin is list or inner[1:] == (...,)
        return None if isinstance(place, str) else inner[0 if many else place]
    return next((part for one in inner if (part := _inside(one, place)) is not None), None)


def _choices(kind: Any) -> tuple[str, ...]:
    inner = typing.get_args(kind)
    if typing.get_origin(kind) is Literal:
        return inner
    return next(filter(None, map(_choices, inner)), ())
