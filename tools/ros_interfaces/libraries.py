"""Generated sources of packages to shared libraries and extension modules, and a wheel of them for pip."""

from __future__ import annotations

import base64
import hashlib
import platform
import subprocess
import sys
import sysconfig
import zipfile
from collections.abc import Iterable
from concurrent.futures import Executor, Future
from pathlib import Path

import numpy as np

NAME = "pacman-ros-interfaces"  # of the wheel
PREFIX = Path(sys.prefix)
FAST = "rosidl_typesupport_fastrtps_c"
INTROSPECTION = "rosidl_typesupport_introspection_c"
RUNTIME = ("rosidl_runtime_c", "rcutils")
#: Each is a library lib<package>__<generator>.so, and needs those before it; with what else it is linked.
GENERATORS: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {  # of installed packages, others
    "rosidl_generator_c": (("rosidl_generator_c",), ()),
    "rosidl_typesupport_c": (("rosidl_typesupport_c",), ("rosidl_typesupport_c",)),
    FAST: ((FAST, "rosidl_generator_c"), (FAST, "rosidl_typesupport_fastrtps_cpp", "fastcdr", "rmw")),
    INTROSPECTION: ((INTROSPECTION, "rosidl_generator_c"), (INTROSPECTION,)),
    "rosidl_generator_py": (("rosidl_generator_py", "rosidl_generator_c"), ()),
}


class BuildError(ValueError):
    """Something that the build needs is missing, or failed."""


def command(arguments: Iterable[object]) -> None:
    """Run a command; if it fails, the end of its output is raised as a BuildError."""
    line = [str(argument) for argument in arguments]
    done = subprocess.run(line, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, errors="replace")
    if done.returncode:
        raise BuildError(f"{' '.join(line[:3])} ... failed with {done.returncode}:\n{done.stdout[-4000:]}")


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


def link_package(name: str, out: Path) -> None:
    """Link ``out/lib/lib<package>__<generator>.so`` and the extension module beside the package's Python files."""
    installed, own = PREFIX / "lib", out / "lib"
    own.mkdir()
    paths = [f"-L{own}", f"-L{installed}", f"-Wl,-rpath-link,{installed}:{own}"]

    def link(target: Path, objects: list[Path], libraries: Iterable[str], of_others: Iterable[str] = ()) -> None:
        found = (path for generator in of_others for path in sorted(installed.glob(f"lib*__{generator}.so")))
        others = [path for path in found if not path.name.startswith(f"lib{name}__")]
        needed = ["-Wl,--no-as-needed", *(f"-l{library}" for library in (*libraries, *RUNTIME))]
        options = [*paths, f"-Wl,-soname,{target.name}", "-Wl,--as-needed", *others, *needed]
        command(["g++", "-shared", "-s", "-o", target, *objects, *options])

    before: list[str] = []
    for generator, (of_others, more) in GENERATORS.items():
        objects = sorted(path for path in (out / generator).rglob("*.o") if "_s.ep." not in path.name)
        library = f"{name}__{generator}"
        link(own / f"lib{library}.so", objects, (*before, *more), of_others)
        before.append(library)
    (module,) = (out / "rosidl_generator_py" / name).glob("*_s.ep.*.o")
    link(module.with_name(f"{name}_s__rosidl_typesupport_c.so"), [module], (*before, "rosidl_typesupport_c", "rmw"))


def write_wheel(folder: Path, version: str, packages: Iterable[tuple[str, Path]]) -> Path:
    """Write the wheel of packages, each a name and the folder that it was linked in; returns its path."""
    stem = f"{NAME.replace('-', '_')}-{version}"
    python = f"cp{sys.version_info.major}{sys.version_info.minor}"
    tag = f"{python}-{python}-linux_{platform.machine()}"
    files: dict[str, bytes] = {}
    for name, out in packages:
        for library in sorted((out / "lib").glob("*.so")):
            files[f"{stem}.data/data/lib/{library.name}"] = library.read_bytes()  # goes to sys.prefix/lib
        python_files = out / "rosidl_generator_py"
        for path in sorted((python_files / name).rglob("*")):
            if path.suffix in (".py", ".so"):
                files[path.relative_to(python_files).as_posix()] = path.read_bytes()
    info = f"{stem}.dist-info"
    summary = "ROS 2 message types built from their definitions by pacman_env"
    metadata = f"Metadata-Version: 2.1\nName: {NAME}\nVersion: {version}\nSummary: {summary}\n"
    files[f"{info}/METADATA"] = metadata.encode()
    files[f"{info}/WHEEL"] = f"Wheel-Version: 1.0\nGenerator: pacman_env\nRoot-Is-Purelib: false\nTag: {tag}\n".encode()
    record = [f"{info}/RECORD,,\n"]  # names contain no commas
    for name, content in files.items():
        digest = base64.urlsafe_b64encode(hashlib.sha256(content).digest()).rstrip(b"=").decode()
        record.append(f"{name},sha256={digest},{len(content)}\n")
    files[f"{info}/RECORD"] = "".join(record).encode()
    path = folder / f"{stem}-{tag}.whl"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in files.items():
            archive.writestr(name, content)
    return path
