"""Generated sources of one package to the shared libraries and the extension module that Python imports."""

from __future__ import annotations

import re
import subprocess
import sys
import sysconfig
from collections.abc import Iterable
from concurrent.futures import Executor, Future
from pathlib import Path

import numpy as np

PREFIX = Path(sys.prefix)
FAST = "rosidl_typesupport_fastrtps_c"
INTROSPECTION = "rosidl_typesupport_introspection_c"
RUNTIME = ("rosidl_runtime_c", "rcutils")
#: Each is a library lib<package>__<generator>.so, and needs those before it; with what else it is linked.
GENERATORS: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {  # those of used packages, others
    "rosidl_generator_c": (("rosidl_generator_c",), ()),
    "rosidl_typesupport_c": (("rosidl_typesupport_c",), ("rosidl_typesupport_c",)),
    FAST: ((FAST, "rosidl_generator_c"), (FAST, "rosidl_typesupport_fastrtps_cpp", "fastcdr", "rmw")),
    INTROSPECTION: ((INTROSPECTION, "rosidl_generator_c"), (INTROSPECTION,)),
    "rosidl_generator_py": (("rosidl_generator_py", "rosidl_generator_c"), ()),
}
#: Implied by every service and action; the generators' sources include their headers.
ALWAYS_USED = {"builtin_interfaces", "service_msgs", "action_msgs", "unique_identifier_msgs"}


class BuildError(ValueError):
    """Something that the build needs is missing, or failed."""


def command(arguments: Iterable[object]) -> None:
    """Run a command; if it fails, the end of its output is raised as a BuildError."""
    line = [str(argument) for argument in arguments]
    done = subprocess.run(line, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, errors="replace")
    if done.returncode:
        raise BuildError(f"{' '.join(line[:3])} ... failed with {done.returncode}:\n{done.stdout[-4000:]}")


def used_packages(definitions: Iterable[Path]) -> list[str]:
    """Installed packages whose messages the definitions use, directly or not."""
    todo = set(ALWAYS_USED)
    for path in definitions:
        todo |= set(re.findall(r"^\s*([a-z][a-z0-9_]*)/", path.read_text(encoding="utf-8"), re.MULTILINE))
    found: set[str] = set()
    while todo:
        name = todo.pop()
        manifest = PREFIX / "share" / name / "package.xml"
        if name in found or not manifest.is_file():
            continue
        found.add(name)
        depends = re.findall(r"<(?:build_|exec_)?depend>([a-z0-9_]+)</", manifest.read_text(encoding="utf-8"))
        todo |= {depend for depend in depends if (PREFIX / "share" / depend / "msg").is_dir()}
    return sorted(found)


def compile_package(out: Path, executor: Executor) -> list[Future[None]]:
    """Start compiling what ``generate`` wrote to ``out``."""
    folders = [out / generator for generator in GENERATORS]
    headers = [p for p in sorted((PREFIX / "include").iterdir()) if p.is_dir() and not p.name.startswith("python")]
    include = [*folders, PREFIX / "include", *headers, sysconfig.get_paths()["include"], np.get_include()]
    flags = ["-O1", "-fPIC", "-DNDEBUG", "-w", *(f"-I{folder}" for folder in include)]
    compiler = {".c": ["gcc", "-std=gnu11"], ".cpp": ["g++", "-std=c++17"]}
    sources = [source for folder in folders for source in sorted(folder.rglob("*.c*"))]
    return [
        executor.submit(
            command, [*compiler[source.suffix], *flags, "-c", source, "-o", source.with_name(f"{source.name}.o")]
        )
        for source in sources
        # of the extension modules only the one for the type support that chooses among the others
        if "_s.ep." not in source.name or source.name.endswith(".rosidl_typesupport_c.c")
    ]


def link_package(name: str, definitions: Iterable[Path], out: Path) -> None:
    """Link ``out/lib/lib<package>__<generator>.so`` and the extension module beside the package's Python files."""
    installed, own = PREFIX / "lib", out / "lib"
    own.mkdir()
    used = used_packages(definitions)

    def of_used(generators: Iterable[str]) -> list[str]:
        names = [f"{package}__{generator}" for generator in generators for package in used]
        return [library for library in names if (installed / f"lib{library}.so").exists()]

    def link(target: Path, objects: list[Path], libraries: Iterable[str]) -> None:
        paths = [f"-L{own}", f"-L{installed}", f"-Wl,-rpath-link,{installed}:{own}"]
        wanted = [f"-l{library}" for library in (*libraries, *RUNTIME)]
        options = ["-Wl,--no-as-needed", f"-Wl,-soname,{target.name}"]
        command(["g++", "-shared", "-s", "-o", target, *objects, *paths, *options, *wanted])

    before: list[str] = []
    for generator, (of_others, more) in GENERATORS.items():
        objects = sorted(path for path in (out / generator).rglob("*.o") if "_s.ep." not in path.name)
        library = f"{name}__{generator}"
        link(own / f"lib{library}.so", objects, (*before, *of_used(of_others), *more))
        before.append(library)
    (module,) = (out / "rosidl_generator_py" / name).glob("*_s.ep.*.o")
    link(module.with_name(f"{name}_s__rosidl_typesupport_c.so"), [module], (*before, "rosidl_typesupport_c", "rmw"))
