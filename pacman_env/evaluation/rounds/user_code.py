"""Hash the files that decide the choices of users' policies and ghosts, so that changed code plays its rounds again.

The hash contains the module of a policy, all modules that it imports (directly or through other modules), and the files
that strings in these modules name. An installed package counts by its list of files, and this package by its version.
"""

import ast
import contextlib
import functools
import hashlib
import importlib.util
import os
import re
import sys
from collections.abc import Iterable, Mapping, Sequence
from importlib import metadata
from importlib.machinery import PathFinder
from pathlib import Path

#: By suffix of a policy file: the suffix of its metadata file.
_METADATA = {".onnx": ".json", ".zip": ".facts.json"}
_SKIPPED = sys.stdlib_module_names | {__package__.partition(".")[0]}
_MOST_MODULES = 200  # most modules to read, which takes 1 to 2 s
_MOST_FOLDERS = 100
_LARGE = 256 << 20  # bytes; a larger file counts by size and time of change
_REFERENCE = re.compile(r"([^\W\d]\w*(?:\.\w+)*):\w+")  # another policy, as in make_policy("module:Class")
_ENDING = re.compile(r"\.\w+")  # means all files with it: with_suffix(".npz"), f"model_{number}.pt"


def hash_of_files(path: Path) -> str:
    """Return the hash of a policy file and its metadata file."""
    about = path.with_suffix(_METADATA[path.suffix.lower()])
    digest = hashlib.sha256()
    for one in [path, about] if about.is_file() else [path]:
        content = one.read_bytes()
        digest.update(f"{one.suffix} {len(content)} ".encode() + content)
    return digest.hexdigest()[:24]


def hash_of_code(*modules: str | None) -> str | None:
    """Return the hash of all files that these modules reach; None if all of them belong to this package."""
    sources, packages, strings = _reach([name for name in modules if name])
    if not sources and not packages:
        return None
    folders = [folder for name, path in sources.items() for folder in path.parents[: name.count(".") + 2]]
    start = folders[0] if folders else Path()
    with contextlib.suppress(FileNotFoundError):  # a deleted folder
        folders.append(Path.cwd())
    files = _named_files(sorted(strings), folders)
    lines = [f"{name} {_hash_of_file(path)}" for name, path in sources.items()]
    lines += [f"{os.path.relpath(path, start)} {_hash_of_file(path)}" for path in files]
    lines += [f"{name} {_installed_files(name)}" for name in packages]
    return hashlib.sha256("\n".join(sorted(lines)).encode(errors="surrogateescape")).hexdigest()


def _reach(starts: Sequence[str]) -> tuple[dict[str, Path], set[str], set[str]]:
    """Return the files of the reached modules by name, the installed packages, and all strings in these files."""
    sources: dict[str, Path] = {}
    packages: set[str] = set()
    strings: set[str] = set()
    names = list(starts)  # grows during the loop
    for name in names:
        top, parent = name.partition(".")[0], name.rpartition(".")[0]
        if top in _SKIPPED or (top in packages and name not in starts):
            continue
        file, folders = _locate(name)
        if {"site-packages", "dist-packages"} & set(Path(file or "".join(folders[:1])).parts):
            packages.add(top)
            if name not in starts:
                continue
        new = {parent} if file or folders else set()
        if file and len(sources) == _MOST_MODULES:
            print(f"{starts[0]}: --resume notices changes in only {_MOST_MODULES} of its modules", file=sys.stderr)
            break
        if file:
            sources[name] = Path(file).absolute()
            with contextlib.suppress(OSError, SyntaxError, ValueError):  # an extension module, or in an archive
                imported, texts = _read(ast.parse(sources[name].read_bytes()), name if folders else parent)
                new |= imported
                strings |= texts
        names += sorted(new - {"", *names})
    return sources, packages, strings


def _locate(name: str) -> tuple[str | None, list[str]]:
    """Find a module without importing it; return its file (or None), and its folders if it is a package."""
    if (module := sys.modules.get(name)) is not None:
        return getattr(module, "__file__", None), list(getattr(module, "__path__", []))
    parent, _, last = name.rpartition(".")
    spec = PathFinder.find_spec(last, _locate(parent)[1]) if parent else importlib.util.find_spec(name)
    if spec is None:
        return None, []
    return spec.origin if spec.has_location else None, list(spec.submodule_search_locations or [])


def _read(tree: ast.AST, package: str) -> tuple[set[str], set[str]]:
    """Return the imported names (modules, or attributes of modules) and all strings in a module's syntax tree."""
    names, strings = set(), set()
    for node in ast.walk(tree):
        match node:
            case ast.Import():
                names |= {alias.name for alias in node.names}
            case ast.ImportFrom():
                with contextlib.suppress(ImportError):  # relative to a folder above the package
                    module = importlib.util.resolve_name("." * node.level + (node.module or ""), package)
                    names |= {module, *(f"{module}.{alias.name}" for alias in node.names)}
            case ast.Constant(value=str(text)):
                strings |= {text := os.path.expanduser(text), os.path.dirname(text)}
    return names | {match[1] for text in strings if (match := _REFERENCE.fullmatch(text))}, strings


def _named_files(strings: Iterable[str], roots: Iterable[Path]) -> set[Path]:
    """Return the files in the folders ``roots`` whose names are among ``strings``.

    If the name of a subfolder is among the strings, its files are searched, too. A string that is only a suffix, such
    as ".npz", stands for all files with this suffix.
    """
    files = set()
    folders = list(dict.fromkeys(map(str, roots)))  # grows during the loop
    for folder in folders:
        for text in filter(lambda text: text.strip("./"), strings):
            # Stable-Baselines3 adds .zip to names.
            names = Path(folder).glob(f"*{text}") if _ENDING.fullmatch(text) else (text, f"{text}.zip")
            for path in (os.path.normpath(os.path.join(folder, name)) for name in names):
                if os.path.isfile(path):
                    files.add(Path(path))
                elif os.path.isdir(path) and path not in folders and len(folders) < _MOST_FOLDERS:
                    folders.append(path)
    return files


def _hash_of_file(path: Path) -> str:
    with contextlib.suppress(OSError), path.open("rb") as file:
        facts = path.stat()
        large = facts.st_size > _LARGE
        return f"{facts.st_size} {facts.st_mtime_ns}" if large else hashlib.file_digest(file, "sha256").hexdigest()
    return "unreadable"


def _installed_files(package: str) -> str:
    """Return the list of files of an installed package with their hashes, or its version if there is no list."""
    found = map(metadata.distribution, sorted(set(_distributions(tuple(sys.path)).get(package, ()))))
    return " ".join(one.read_text("RECORD") or one.version for one in found)


@functools.cache
def _distributions(path: tuple[str, ...]) -> Mapping[str, list[str]]:
    return metadata.packages_distributions()  # takes 0.1 to 0.3 s
