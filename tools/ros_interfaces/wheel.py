"""A wheel from files on disk, so that pip installs and removes what was built here as it does everything else."""

from __future__ import annotations

import base64
import hashlib
import platform
import sys
import zipfile
from collections.abc import Iterable
from pathlib import Path

NAME = "pacman-ros-interfaces"


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
    files[f"{info}/RECORD"] = _record(files, f"{info}/RECORD")
    path = folder / f"{stem}-{tag}.whl"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in files.items():
            archive.writestr(name, content)
    return path


def _record(files: dict[str, bytes], own_name: str) -> bytes:
    """Hash and size of every file, as the format demands; names contain no commas."""
    lines = [f"{own_name},,\n"]
    for name, content in files.items():
        digest = base64.urlsafe_b64encode(hashlib.sha256(content).digest()).rstrip(b"=").decode()
        lines.append(f"{name},sha256={digest},{len(content)}\n")
    return "".join(lines).encode()
