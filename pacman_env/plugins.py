"""Things that a user can add, by name: policies, ghosts, observation kinds, presets (docs/extending.md).

A name means one of the package's own, else an entry point of an installed package, else ``module:attribute``. Code that
the user has installed is imported, no more: names are never paths, and nothing is evaluated.
"""

from __future__ import annotations

import difflib
import functools
import importlib
import re
import sys
from collections.abc import Iterable, Mapping
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any, Generic, TypeVar

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

T = TypeVar("T")
_REFERENCE = re.compile(r"[^\W\d]\w*(\.[^\W\d]\w*)*:[^\W\d]\w*(\.[^\W\d]\w*)*")


class PluginError(ValueError):
    """A name that nothing is called by, or a plug-in that cannot be imported."""


def nearest_names(name: str, known: Iterable[str]) -> list[str]:
    """Return at most two of ``known`` that may have been meant, the nearest first."""
    return difflib.get_close_matches(name, known, n=2, cutoff=0.7)


def offer(name: str, known: Iterable[str], others: str = "") -> str:
    """Return the end of an error about an unknown name: the nearest of ``known``, or all of them if none is near."""
    names = list(known)
    if near := nearest_names(name, names):
        return f"did you mean {' or '.join(near)}?"
    return f"choose one of {', '.join(names)}{others and f', or {others}'}"


class Registry(Generic[T]):
    """Things of one sort by name."""

    def __init__(self, sort: str, group: str, own: Mapping[str, T | str], others: str = "module:name") -> None:
        """Begin with the package's ``own``: things, or references ``module:attribute`` that the first use loads.

        ``sort`` and ``others``, what can be given beside names, are for errors; ``group`` is that of entry points.
        """
        self.sort, self.group = sort, group
        self._own, self._others = dict(own), others

    def register(self, name: str, thing: T) -> None:
        """Add one in this process; raises ValueError where the name is in use."""
        if name in self._own:
            raise ValueError(f"{self.sort} {name!r} is registered already")
        self._own[name] = thing

    def names(self) -> list[str]:
        """All names: the package's own, then those of installed packages."""
        return [*self._own, *sorted(_entry_points(self.group).keys() - self._own.keys())]

    def find(self, name: str) -> T:
        """The thing of that name; raises PluginError where there is none, or it cannot be imported."""
        own = self._own.get(name, name)
        if not isinstance(own, str):
            return own
        try:
            thing: T = load(self.group, own)
        except LookupError:
            module = own.partition(":")[0]
            if _REFERENCE.fullmatch(own) and not any(known.startswith(f"{module}:") for known in self.names()):
                message = f"module {module} cannot be imported (is it installed or on PYTHONPATH?)"
                raise PluginError(f"{self.sort} {name!r}: {message}") from None
            raise PluginError(f"unknown {self.sort} {name!r}: {offer(name, self.names(), self._others)}") from None
        except Exception as error:  # whatever a plug-in raises while it is imported
            raise PluginError(f"{self.sort} {name!r}: {type(error).__name__}: {error}") from error
        return thing


def load(group: str, name: str) -> Any:
    """The object of an entry point of that name, or of ``module:attribute``; LookupError where there is neither."""
    point = _entry_points(group).get(name)
    if point is not None:
        return point.load()
    module, _, attribute = name.partition(":")
    if not _REFERENCE.fullmatch(name) or find_spec(module.partition(".")[0]) is None:
        raise LookupError(name)
    return functools.reduce(getattr, attribute.split("."), importlib.import_module(module))


def _entry_points(group: str) -> Mapping[str, EntryPoint]:
    return _entry_points_on(group, tuple(sys.path))


@functools.cache  # reading the metadata of all installed packages takes 10 to 20 ms
def _entry_points_on(group: str, path: tuple[str, ...]) -> Mapping[str, EntryPoint]:
    from importlib import metadata  # needed for plug-ins alone

    return {point.name: point for point in metadata.entry_points(group=group)}
