"""Hash the files that decide the choices of users' policies and ghosts, so that changed code plays its rounds again.

The hash contains the module of a policy, all modules that it imports (directly or through other modules), and the files
that strings in these modules name. An installed package counts by its list of files, and this package by its version.
"""

import ast
import contextlib
import functools
import glob
import hashlib
import importlib.util
import os
import re
import sys
from collections.abc import Iterable, Iterator, Sequence
from importlib import metadata
from importlib.machinery import PathFinder
from pathlib import Path

_SKIPPED = sys.stdlib_module_names | {__package__.partition(".")[0]}
_MOST_MODULES = 200  # 1 to 2 s
_MOST_FOLDERS = 100
_LARGE = 256 << 20  # bytes; a larger file counts by size and time of change
_REFERENCE = re.compile(r"([^\W\d]\w*(?:\.\w+)*):\w+")  # another policy, as in make_policy("module:Class")
_PATTERN = re.compile(r".*\*.*\.\w+")  # names such as model_*.pt


def hash_of_code(*modules: str | None) -> str | None:
    """Return the hash of all files that these modules reach; None if all of them belong to this package."""
    starts = [name for name in modules if name]
    sources, packages, strings = _reach(starts)
    if not sources and not packages:
        return None
    folders = [folder for name, path in sources.items() for folder in path.parents[: name.count(".") + 2]]
    start = folders[0] if folders else Path()
    with contextlib.suppress(FileNotFoundError):  # a deleted folder
        folders.append(Path.cwd())
    endings = [text for text in strings if re.fullmatch(r"\.\w+", text)]
    files = _named_files(sorted(strings), folders)
    files |= {path.with_suffix(ending) for path in sources.values() for ending in endings}
    lines = [f"{name} {_hash_of_file(path)}" for name, path in sources.items()]
    lines += [f"{os.path.relpath(path, start)} {_hash_of_file(path)}" for path in files if path.is_file()]
    lines += [f"{name} {_installed_version(name)}" for name in packages]
    return hashlib.sha256("\n".join(sorted(lines)).encode(errors="surrogateescape")).hexdigest()


def _reach(starts: Sequence[str]) -> tuple[dict[str, Path], set[str], set[str]]:
    """Return the files of the reached modules by name, the installed packages, and all strings in these files."""
    sources: dict[str, Path] = {}
    packages: set[str] = set()
    strings: set[str] = set()
    names = list(starts)  # grows
    for name in names:
        top = name.partition(".")[0]
        if top in _SKIPPED or (top in packages and name not in starts):
            continue
        file, folders = _locate(name)
        if (place := file or next(iter(folders), None)) is None:
            continue
        if {"site-packages", "dist-packages"} & set(Path(place).parts):
            packages.add(top)
            if name not in starts:
                continue
        if len(sources) == _MOST_MODULES:
            print(f"{starts[0]}: --resume notices changes in only {_MOST_MODULES} of its modules", file=sys.stderr)
            break
        new: set[str] = {name.rpartition(".")[0]}
        if file:
            sources[name] = Path(file).absolute()
            with contextlib.suppress(OSError, SyntaxError, ValueError):  # an extension module, or one in an archive
                tree = ast.parse(sources[name].read_bytes())
                texts = set(_strings(tree))
                strings |= texts
                new |= set(_imports(tree, name if folders else name.rpartition(".")[0]))
                new |= {match[1] for text in texts if (match := _REFERENCE.fullmatch(text))}
        names += sorted(new - {"", *names})
    return sources, packages, strings


def _locate(name: str) -> tuple[str | None, list[str]]:
    """Return the file and the folders (of a package) of a module, without importing it."""
    if (module := sys.modules.get(name)) is not None:
        return getattr(module, "__file__", None), list(getattr(module, "__path__", []))
    parent, _, last = name.rpartition(".")
    spec = PathFinder.find_spec(last, _locate(parent)[1]) if parent else importlib.util.find_spec(name)
    if spec is None:
        return None, []
    return spec.origin if spec.has_location else None, list(spec.submodule_search_locations or [])


def _imports(tree: ast.AST, package: str) -> Iterator[str]:
    """Yield the names in all import statements, which may be modules or their attributes."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            with contextlib.suppress(ImportError):  # relative to a folder above the package
                module = importlib.util.resolve_name("." * node.level + (node.module or ""), package)
                yield from (module, *(f"{module}.{alias.name}" for alias in node.names))


def _strings(tree: ast.AST) -> Iterator[str]:
    """Yield all strings that may be names of files; ``*`` stands for values in f-strings."""
    for node in ast.walk(tree):
        text = ""
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            text = node.value
        elif isinstance(node, ast.JoinedStr):
            text = "".join(str(part.value) if isinstance(part, ast.Constant) else "*" for part in node.values)
        if text.strip("./") and len(text) < 300 and not {"\n", "\0"} & set(text):
            yield os.path.expanduser(text)


def _named_files(strings: Iterable[str], roots: Iterable[Path]) -> set[Path]:
    """Return the files with one of these names in the folders ``roots``, or in a folder with such a name there."""
    files: set[str] = set()
    folders = list(dict.fromkeys(map(str, roots)))  # grows
    for folder in folders:
        listed: set[str] = set()
        with contextlib.suppress(OSError):
            listed.update(os.listdir(folder))
        for text in strings:
            if text[0] not in "./" and "*" not in text and not {text.partition("/")[0], f"{text}.zip"} & listed:
                continue  # saves most calls of the file system
            path = os.path.normpath(os.path.join(folder, text))
            place, name = os.path.split(path)
            if os.path.isdir(path):
                if path not in folders and len(folders) < _MOST_FOLDERS:
                    folders.append(path)
            elif _PATTERN.fullmatch(name) and os.path.isdir(place):
                files.update(os.path.join(place, one) for one in glob.glob(name, root_dir=place))
            else:
                files.update((path, f"{path}.zip"))  # Stable-Baselines3 adds the ending
    return {Path(path) for path in files if os.path.isfile(path)}


def _hash_of_file(path: Path) -> str:
    with contextlib.suppress(OSError), path.open("rb") as file:
        facts = path.stat()
        if facts.st_size > _LARGE:
            return f"{facts.st_size} {facts.st_mtime_ns}"
        return hashlib.file_digest(file, "sha256").hexdigest()
    return "unreadable"


_distributions = functools.cache(metadata.packages_distributions)  # takes 0.1 to 0.3 s


def _installed_version(package: str) -> str:
    """Return the hash of the list of files of an installed package, or its version if it has no such list."""
    with contextlib.suppress(metadata.PackageNotFoundError, KeyError, IndexError):
        try:
            found = metadata.distribution(package)
        except metadata.PackageNotFoundError:  # the name to install it differs from the name to import it
            found = metadata.distribution(_distributions()[package][0])
        files = found.read_text("RECORD")
        return hashlib.sha256(files.encode()).hexdigest() if files else found.version
    return "unknown"
