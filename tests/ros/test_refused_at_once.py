"""What cannot be used is refused before anything is compiled, by every command and node that loads it."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from pacman_env.policies.learned import PRETRAINED
from pacman_env.ros.game_nodes import GAME, SELECTOR, module_of

BARE = "its metadata bare.json is missing"


def node(name: str, parameter: str) -> list[str]:
    return [module_of(name), "--ros-args", "-p", "map_yaml:=house", "-p", parameter]


@pytest.mark.usefixtures("domain")
@pytest.mark.parametrize(
    ("words", "reason"),
    [
        (["pacman_env.cli.main", *["ros", "up", "--map", "house", "--sim", "--policy", "{bare}"]], BARE),
        (node(SELECTOR, "policy:={bare}"), BARE),
        (node(GAME, "policy:={bare}"), BARE),
        (node(GAME, "settings:=[clyde.ghosts={bare}]"), BARE),
        (node(GAME, "settings:=[clyde.ghosts=policy]"), "clyde.ghosts[0] = 'policy': name the .onnx file"),
    ],
    ids=["up", SELECTOR, GAME, "ghosts", "name"],
)
def test_unusable_policy_is_refused_before_compiling(words: list[str], reason: str, tmp_path: Path) -> None:
    bare = tmp_path / "bare.onnx"  # a planner without its metadata
    shutil.copy(PRETRAINED, bare)
    cache = tmp_path / "cache"
    ended = subprocess.run(
        [sys.executable, "-m", *(word.replace("{bare}", str(bare)) for word in words)],
        env={**os.environ, "PACMAN_ENV_CACHE": str(cache)},
        check=False,
        capture_output=True,
        text=True,
    )
    assert ended.returncode == 2, ended.stderr
    assert reason in ended.stderr.splitlines()[-1]
    assert "Traceback" not in ended.stderr
    if "--sim" not in words:  # the simulated robot starts at the same time, and compiles
        assert [path.name for path in cache.rglob("*.nb[ci]")] == [], "kernels were compiled first"
