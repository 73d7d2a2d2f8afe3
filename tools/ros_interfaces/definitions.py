"""Reads folders of .msg, .srv and .action files and refuses what could not be built, naming file and line."""

from __future__ import annotations

import contextlib
import io
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

KINDS = {"msg": 1, "srv": 2, "action": 3}  # sections, separated by lines of three hyphens
SEPARATOR = "---"


class BadDefinition(ValueError):
    """A definition that cannot be built; the message is ``file:line: what``."""


@dataclass(frozen=True)
class Package:
    """One package: its folder, named as the package, and its definitions, in order of path."""

    folder: Path
    files: tuple[Path, ...]

    @property
    def name(self) -> str:
        return self.folder.name

    @property
    def types(self) -> list[tuple[str, str]]:
        """(kind, name) of each definition: ``("msg", "LedColor")``."""
        return [(path.parent.name, path.stem) for path in self.files]


def find_packages(folder: Path) -> list[Package]:
    """All packages ``folder/PACKAGE/{msg,srv,action}/*``, at least one, in order of name; other things are ignored."""
    packages = []
    for path in sorted(folder.resolve().iterdir()) if folder.is_dir() else ():
        files = tuple(sorted(file for kind in KINDS for file in path.glob(f"{kind}/*")))
        if files:
            packages.append(Package(path, files))
    if not packages:
        raise BadDefinition(f"{folder}: no message definitions")
    return packages


def check_packages(packages: list[Package], share: Path) -> None:
    """Read all definitions; what they use must be in the package, or installed in ``share``."""
    from rosidl_adapter.parser import is_valid_package_name  # absent where nothing has to be built

    names = {package.name for package in packages}
    for package in packages:
        if not is_valid_package_name(package.name):
            raise BadDefinition(f"{package.folder}: not a package's name")
        own = {name for kind, name in package.types if kind == "msg"}
        for path in package.files:
            if path.suffix != f".{path.parent.name}":
                raise BadDefinition(f"{path}: not a .{path.parent.name} file")
            for line, used_package, used in _used_types(package.name, path):
                where = f"{path}:{line}: {used_package}/{used}"
                if used_package == package.name:
                    if used not in own:
                        raise BadDefinition(f"{where}: no such message in this package")
                elif used_package in names:
                    raise BadDefinition(f"{where}: packages that are built together cannot use one another")
                elif not (share / used_package / "msg" / f"{used}.idl").is_file():
                    raise BadDefinition(f"{where}: not installed")


def _used_types(package: str, path: Path) -> Iterator[tuple[int, str, str]]:
    """(line, package, type) of each field whose type is a message; every line is checked."""
    from rosidl_adapter.parser import parse_message_string

    sections, seen = 1, set[str]()
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except UnicodeDecodeError as error:
        raise BadDefinition(f"{path}: not UTF-8: {error}") from None
    for number, line in enumerate(lines, start=1):
        if line == SEPARATOR:
            sections, seen = sections + 1, set()
            continue
        try:
            with contextlib.redirect_stderr(io.StringIO()):  # the parser also prints what it raises
                part = parse_message_string(package, path.stem, line)
        except Exception as error:  # the parser's errors have no common ancestor
            raise BadDefinition(f"{path}:{number}: {line.strip()!r}: {type(error).__name__}: {error}") from None
        for element in (*part.fields, *part.constants):
            if element.name in seen:
                raise BadDefinition(f"{path}:{number}: {element.name!r} is there twice")
            seen.add(element.name)
        for field in part.fields:
            if not field.type.is_primitive_type():
                yield number, field.type.pkg_name, field.type.type
    expected = KINDS[path.parent.name]
    if sections != expected:
        raise BadDefinition(f"{path}:{len(lines)}: {sections} sections, must be {expected}, separated by {SEPARATOR}")
