"""GitHub's workflows: they can be read, run fixed versions of actions, and their commands are those of today."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml

from pacman_env.cli import main as cli

ROOT = Path(__file__).resolve().parents[1]
WORKFLOWS = sorted((ROOT / ".github" / "workflows").glob("*.y*ml"))


def steps(workflow: Path) -> Iterator[dict[str, Any]]:
    for job in yaml.safe_load(workflow.read_text())["jobs"].values():
        assert job["timeout-minutes"] > 0
        yield from job["steps"]


def commands(workflow: Path) -> list[list[str]]:
    """Words behind ``pacman-env`` of each line that has it."""
    found = []
    for step in steps(workflow):
        for line in step.get("run", "").replace("\\\n", " ").splitlines():
            words = shlex.split(line.partition("|")[0], comments=True)
            if "pacman-env" in words:
                found.append(words[words.index("pacman-env") + 1 :])
    return found


def test_there_is_one_that_plays_with_the_real_nav2() -> None:
    (played,) = [words for workflow in WORKFLOWS for words in commands(workflow) if words[:2] == ["ros", "up"]]
    assert {"--sim", "--nav2", "--rounds"} <= set(played)


@pytest.mark.parametrize("workflow", WORKFLOWS, ids=lambda path: path.stem)
def test_its_actions_are_fixed_by_the_hash_of_a_commit(workflow: Path) -> None:
    used = [step["uses"] for step in steps(workflow) if "uses" in step]
    assert used
    assert all(re.fullmatch(r"[\w/-]+@[0-9a-f]{40}", action) for action in used)


@pytest.mark.parametrize("words", [words for workflow in WORKFLOWS for words in commands(workflow)], ids=" ".join)
def test_its_commands_are_accepted(words: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    if words == ["--version"]:
        with pytest.raises(SystemExit) as ended:
            cli.main(words)
        assert ended.value.code == 0
        return
    pytest.importorskip("rclpy")
    up = pytest.importorskip("pacman_env.ros.supervisor.up")
    asked: list[tuple[Any, ...]] = []
    monkeypatch.setattr(up, "up", lambda setup, *given, **more: asked.append((setup, given, more)) or 0)
    assert cli.main(words) == 0
    ((setup, _, more),) = asked
    assert setup.sim
    assert setup.starts_nav2
    assert more["rounds"] == 1
