"""Fetch the maps of eval/slam_maps.yaml with git and check their hashes: ``scripts/slam_maps``."""

import argparse
import hashlib
import os
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from pacman_env.command_line.command import Parser, run_command
from pacman_env.command_line.slam_maps import FOLDER, listed_maps
from pacman_env.config.validation import require
from pacman_env.files import replaced

_QUIET = {**os.environ, "GIT_TERMINAL_PROMPT": "0"}  # GitHub asks for a password if a repository does not exist


def fetch(one: Mapping[str, Any], folder: Path, address: str) -> bool:
    """Fetch the files of a listed map if one is missing; return True if they were fetched.

    Raises ValueError if git fails or a file has another SHA-256 than in the list; then nothing is written.
    """
    files = {path: folder / ("map.yaml" if path.endswith(".yaml") else Path(path).name) for path in one["files"]}
    missing = not all(file.is_file() for file in files.values())
    contents = _download(one, address) if missing else {path: file.read_bytes() for path, file in files.items()}
    for path, content in contents.items():
        hashed, place = hashlib.sha256(content).hexdigest(), path if missing else files[path]
        require(hashed == one["files"][path], f"SHA-256 of {place}", hashed, f"must be {one['files'][path]}")
    folder.mkdir(parents=True, exist_ok=True)
    for path, content in contents.items() if missing else ():
        with replaced(files[path]) as temporary:
            temporary.write_bytes(content)
    return missing


def _download(one: Mapping[str, Any], address: str) -> dict[str, bytes]:
    """Return the content of each file by path; git downloads the commit without files, and then only these files."""
    with tempfile.TemporaryDirectory() as folder:

        def git(*words: str) -> bytes:
            done = subprocess.run(["git", f"--git-dir={folder}", *words], capture_output=True, env=_QUIET)
            if done.returncode:
                raise ValueError(f"git {words[0]}: {' '.join(done.stderr.decode(errors='replace').split())}")
            return done.stdout

        git("init", "--quiet", "--bare")
        git("remote", "add", "origin", f"{address}/{one['repository']}")
        git("fetch", "--quiet", "--depth=1", "--filter=blob:none", "origin", one["commit"])
        return {path: git("cat-file", "blob", f"{one['commit']}:{path}") for path in one["files"]}


def _run(arguments: argparse.Namespace) -> int:
    status = 0
    for name, one in listed_maps().items():
        try:
            state = "fetched" if fetch(one, arguments.folder / name, arguments.address) else "exists"
            print(f"{name}: {state} (licence: {one['licence']})", flush=True)
        except (ValueError, OSError) as error:
            print(f"{name}: {one['repository']} at {one['commit']}: {error}", file=sys.stderr)
            status = 1
    return status


def main(argv: Sequence[str] | None = None) -> int:
    parser = Parser(prog="scripts/slam_maps", description=__doc__)
    parser.add_argument("folder", type=Path, nargs="?", default=FOLDER, help="where to (results/slam_maps)")
    parser.add_argument("--from", dest="address", default="https://github.com", help="of repositories (%(default)s)")
    return run_command(parser, argv, _run)


if __name__ == "__main__":
    sys.exit(main())
