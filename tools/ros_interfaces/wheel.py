"""A wheel from files on disk, so that pip installs and removes what was built here as it does everything else."""

from __future__ import annotations

import base64
import csv
import hashlib
import io
import platform
import sys
import zipfile
from collections.abc import Iterable
from pathlib import Path

NAME = "pacman-ros-interfaces"


def write_wheel(folder: Path, version: str, packages: Iterable[tuple[str, Path]]) -> Path:
    """Write the wheel of built packages for this interpreter and return its path.

    Args:
        folder: Where it goes.
        version: Of the wheel.
        packages: Name, and the folder that ``link_package`` linked in.
    """
    stem = f"{NAME.replace('-', '_')}-{version}"
    python = f"cp{sys.version_info[0]}{sys.version_info[1]}"
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
    files[f"{info}/METADATA"] = (
        f"Metadata-Version: 2.1\nName: {NAME}\nVersion: {version}\nSummary: {summary}\n".encode()
    )
    files[f"{info}/WHEEL"] = f"Wheel-Version: 1.0\nGenerator: pacman_env\nRoot-Is-Purelib: false\nTag: {tag}\n".encode()
    files[f"{info}/RECORD"] = _record(files, f"{info}/RECORD")
    path = folder / f"{stem}-{tag}.whl"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in files.items():
            archive.writestr(name, content)
    return path


def _record(files: dict[str, bytes], own_name: str) -> bytes:
    """Hash and size of every file, as pip checks them."""
    table = io.StringIO()
    rows = csv.writer(table, lineterminator="\n")
    for name, content in files.items():
        digest = base64.urlsafe_b64encode(hashlib.sha256(content).digest()).rstrip(b"=").decode()
        rows.writerow((name, f"sha256={digest}", len(content)))
    rows.writerow((own_name, "", ""))
    return table.getvalue().encode()
