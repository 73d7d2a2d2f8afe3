"""What cannot be used is refused before anything is compiled, by every command and node that loads it."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from pacman_env.policies.learned import PRETRAINED
from pacman_env.ros.supervisor.game_nodes import SELECTOR, module_of

COMMAND = ["-m", "pacman_env.cli.main"]
GHOSTS = "clyde_ghost_node"


def node(name: str, *parameters: str) -> list[str]:
    given = [word for text in ("map_yaml:=house", *parameters) for word in ("-p", text)]
    return ["-m", module_of(name), "--ros-args", *given]


@pytest.fixture
def bare(tmp_path: Path) -> Path:
    """A planner without its metadata."""
    path = tmp_path / "bare.onnx"
    shutil.copy(PRETRAINED, path)
    return path


def refusal(words: list[str], folder: Path) -> str:
    """The last line of a command that ends with status 2, on a machine where nothing was compiled before."""
    cache = folder / "cache"
    environment = {**os.environ, "PACMAN_ENV_CACHE": str(cache)}
    ended = subprocess.run([sys.executable, *words], env=environment, check=False, capture_output=True, text=True)
    assert ended.returncode == 2, ended.stderr
    assert "Traceback" not in ended.stderr
    assert [path.name for path in cache.rglob("pacman_env.*")] == [], "kernels were compiled first"
    return ended.stderr.splitlines()[-1]


@pytest.mark.usefixtures("domain")
@pytest.mark.parametrize(
    "words",
    [
        [*COMMAND, "ros", "up", "--map", "house", "--sim", "--policy", "BARE"],
        node(SELECTOR, "policy:=BARE"),
        node(GHOSTS, "settings:=[clyde.ghosts=BARE]"),
    ],
    ids=["up", SELECTOR, GHOSTS],
)
def test_planner_without_metadata_is_refused_before_compiling(words: list[str], bare: Path, tmp_path: Path) -> None:
    line = refusal([word.replace("BARE", str(bare)) for word in words], tmp_path)
    assert f"{bare}: its metadata {bare.stem}.json is missing" in line


@pytest.mark.usefixtures("domain")
def test_ghost_named_policy_is_refused(tmp_path: Path) -> None:
    line = refusal(node(GHOSTS, "settings:=['clyde.ghosts=policy']"), tmp_path)
    assert line == f"{GHOSTS}: clyde.ghosts[0] = 'policy': name the .onnx file that moves it instead"
