"""Named extensions that users can add: policies, ghosts, observation kinds and presets (docs/extending.md).

A name refers to a built-in object, an entry point of an installed package, or ``module:attribute``, in this order.
Only installed code is imported: names are never paths, and nothing is evaluated.
"""

from __future__ import annotations

import difflib
import functools
import importlib
import operator
import re
import sys
import warnings
from collections.abc import Iterable, Mapping
from importlib.util import find_spec
from typing import TYPE_CHECKING, Generic, TypeVar

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

T = TypeVar("T")
_REFERENCE = re.compile(r"[^\W\d]\w*(\.[^\W\d]\w*)*:[^\W\d]\w*(\.[^\W\d]\w*)*")


class PluginError(ValueError):
    """Raised for an unknown name or a plug-in that fails to import."""


def nearest_names(name: str, known: Iterable[str]) -> list[str]:
    """Return at most two of ``known`` that are similar to ``name``, the nearest first."""
    return difflib.get_close_matches(name, known, n=2, cutoff=0.7)


def suggest(name: str, known: Iterable[str], others: str = "") -> str:
    """Return the end of an error message about an unknown name: the most similar names of ``known``.

    If no name is similar, return all of ``known`` and the text ``others`` about alternatives to a name.
    """
    names = list(known)
    if near := nearest_names(name, names):
        return f"did you mean {' or '.join(near)}?"
    return f"choose one of {', '.join(names)}{others and f', or {others}'}"


class Registry(Generic[T]):
    """Find objects of one sort by name: built-in, registered in this process, or from installed packages."""

    def __init__(self, sort: str, group: str, own: Mapping[str, T | str], others: str = "module:name") -> None:
        """Start with the built-in objects ``own``: objects, or references ``module:attribute`` loaded on first use.

        ``group`` is the group of entry points. Error messages contain ``sort``, the word for such an object, and
        ``others``, the alternatives to a name.
        """
        self.sort, self.group = sort, group
        self._own, self._others = dict(own), others
        self._hidden: set[str] = set()  # entry points with a name in use, after the warning

    def register(self, name: str, thing: T) -> None:
        """Add an object in this process; raises ValueError if the name is in use."""
        if name in self._own:
            raise ValueError(f"{self.sort} {name!r} is registered already")
        self._own[name] = thing

    def names(self) -> list[str]:
        """Return all names: built-in and registered names first, then the names from installed packages."""
        return [*self._own, *sorted(self._entry_points().keys() - self._own.keys())]

    def module_of(self, name: str) -> str | None:
        """Return the name of the module that defines or loads the object with this name; None if it is not known."""
        own = self._own.get(name, name)
        if not isinstance(own, str):
            return getattr(own, "__module__", None)
        point = self._entry_points().get(own)
        return (point.value if point else own).partition(":")[0]

    def find(self, name: str) -> T:
        """Return the object with this name; raises PluginError if the name is unknown or the import fails."""
        points = self._entry_points()  # also warns about an entry point with this name
        own = self._own.get(name, name)
        if not isinstance(own, str):
            return own
        module, _, attribute = own.partition(":")
        is_reference = _REFERENCE.fullmatch(own)
        try:
            if own in points:
                return points[own].load()
            if is_reference and find_spec(module.partition(".")[0]) is not None:
                return operator.attrgetter(attribute)(importlib.import_module(module))
        except Exception as error:  # the import of a plug-in may raise anything
            raise PluginError(f"{self.sort} {name!r}: {type(error).__name__}: {error}") from error
        if is_reference and not any(other.startswith(f"{module}:") for other in self.names()):
            message = f"module {module} cannot be imported (is it installed or on PYTHONPATH?)"
            raise PluginError(f"{self.sort} {name!r}: {message}")
        raise PluginError(f"unknown {self.sort} {name!r}: {suggest(name, self.names(), self._others)}")

    def _entry_points(self) -> Mapping[str, EntryPoint]:
        """Return the entry points by name; warn once about each one whose name is in use."""
        points = _entry_points_on(tuple(sys.path)).get(self.group, {})
        for name in sorted(self._own.keys() & points.keys() - self._hidden):
            self._hidden.add(name)
            point = points[name]
            source = f"{point.value} of {point.dist.name if point.dist else 'an installed package'}"
            text = f"{self.sort} {name!r}: {source} is not used, because another {self.sort} has this name"
            warnings.warn(f"{text}: rename the entry point, or write {point.value}", RuntimeWarning, stacklevel=3)
        return points


@functools.cache  # reading the metadata of all installed packages is slow
def _entry_points_on(path: tuple[str, ...]) -> Mapping[str, Mapping[str, EntryPoint]]:
    """Return all entry points by group and name; of several with the same name, the first one on the path."""
    from importlib import metadata  # imported here because importing the package does not need it

    groups: dict[str, dict[str, EntryPoint]] = {}
    for distribution in metadata.distributions():
        for point in distribution.entry_points:
            groups.setdefault(point.group, {}).setdefault(point.name, point)
    return groups
