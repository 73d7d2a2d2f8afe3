"""GitHub's workflows and forms: they fit their schemas, run fixed versions of actions, and name commands of today."""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml

from pacman_env.cli import main as cli

ROOT = Path(__file__).resolve().parents[1]
GITHUB = ROOT / ".github"
WORKFLOWS = sorted((GITHUB / "workflows").glob("*.y*ml"))
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
#: By what check-jsonschema calls their schema.
FILES = {
    "github-workflows": WORKFLOWS,
    "github-issue-forms": [GITHUB / "ISSUE_TEMPLATE" / name for name in ("bug.yml", "feature.yml")],
    "github-issue-config": [GITHUB / "ISSUE_TEMPLATE" / "config.yml"],
    "dependabot": [GITHUB / "dependabot.yml"],
    "citation-file-format": [ROOT / "CITATION.cff"],
}
#: What a step's line may begin with beside programs of the checkout and of a virtual environment that a step makes.
PROGRAMS = {".", "apt-get", "cd", "dpkg-query", "mkdir", "pacman-env", "python", "python3", "tail", "test", "timeout"}


def steps(workflow: Path) -> Iterator[dict[str, Any]]:
    for job in yaml.safe_load(workflow.read_text())["jobs"].values():
        assert job["timeout-minutes"] > 0
        yield from job["steps"]


def lines(workflow: Path) -> Iterator[list[str]]:
    """Words of each line of each step, up to a pipe."""
    for step in steps(workflow):
        for line in step.get("run", "").replace("\\\n", " ").splitlines():
            words = shlex.split(line.partition("|")[0], comments=True)
            if words:
                yield words


def commands(workflow: Path) -> list[list[str]]:
    """Words behind ``pacman-env`` of each line that has it."""
    found = []
    for words in lines(workflow):
        names = [Path(word).name for word in words]
        if "pacman-env" in names:
            found.append(words[names.index("pacman-env") + 1 :])
    return found


def matrices(workflow: Path) -> list[dict[str, list[str]]]:
    jobs = yaml.safe_load(workflow.read_text())["jobs"].values()
    return [job["strategy"]["matrix"] for job in jobs if "strategy" in job]


@pytest.mark.parametrize(
    ("schema", "file"), [(schema, file) for schema, files in FILES.items() for file in files], ids=lambda one: str(one)
)
def test_a_file_fits_its_schema(schema: str, file: Path) -> None:
    pytest.importorskip("check_jsonschema")
    command = [sys.executable, "-m", "check_jsonschema", "--builtin-schema", f"vendor.{schema}", str(file)]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr


def test_there_is_one_that_plays_with_the_real_nav2() -> None:
    (played,) = [words for workflow in WORKFLOWS for words in commands(workflow) if words[:2] == ["ros", "up"]]
    assert {"--sim", "--nav2", "--rounds"} <= set(played)


@pytest.mark.parametrize("workflow", WORKFLOWS, ids=lambda path: path.stem)
def test_its_actions_are_fixed_by_the_hash_of_a_commit_and_of_one_version(workflow: Path) -> None:
    used = [step["uses"] for step in steps(workflow) if "uses" in step]
    assert used
    assert all(re.fullmatch(r"[\w/-]+@[0-9a-f]{40}", action) for action in used)
    everywhere = re.findall(r"uses: (\S+)@(.*)", "\n".join(one.read_text() for one in WORKFLOWS))
    versions = dict(everywhere)
    assert all(re.fullmatch(r"[0-9a-f]{40} # v\d+\.\d+\.\d+", version) for version in versions.values())
    assert all(versions[action] == version for action, version in everywhere)


@pytest.mark.parametrize("workflow", WORKFLOWS, ids=lambda path: path.stem)
def test_it_may_only_read_and_hands_its_token_to_no_step(workflow: Path) -> None:
    content = yaml.safe_load(workflow.read_text())
    assert content["permissions"] == {"contents": "read"}
    for name, job in content["jobs"].items():
        more = {"id-token": "write"} if (workflow.stem, name) == ("release", "publish") else None
        assert job.get("permissions") == more
    for step in steps(workflow):
        if step.get("uses", "").startswith("actions/checkout@"):
            assert step["with"]["persist-credentials"] is False
    assert "secrets." not in workflow.read_text()


@pytest.mark.parametrize("workflow", WORKFLOWS, ids=lambda path: path.stem)
def test_bash_can_read_its_steps_and_their_programs_are_there(workflow: Path) -> None:
    for step in steps(workflow):
        if "run" in step:
            done = subprocess.run(["bash", "-n"], input=step["run"], capture_output=True, text=True)
            assert (done.returncode, done.stderr) == (0, "")
    for words in lines(workflow):
        program = words[0]
        if re.fullmatch(r"(\.\./)?(venv|pacman)/bin/\w[\w-]*", program):
            continue  # of an environment that the step before made
        if "/" in program:
            file = ROOT / program
            assert file.is_file(), program
            assert file.stat().st_mode & 0o111, f"{program} cannot be run"
        else:
            assert program in PROGRAMS


@pytest.mark.parametrize("workflow", WORKFLOWS, ids=lambda path: path.stem)
def test_extras_that_it_installs_and_options_of_scripts_that_it_gives_are_there(workflow: Path) -> None:
    for words in lines(workflow):
        if "install" in words:
            for extra in re.findall(r"\[(\w+)\]", " ".join(words)):
                assert extra in PROJECT["optional-dependencies"]
        if words[0].startswith("scripts/"):
            text = (ROOT / words[0]).read_text()
            assert all(f" {option}) " in text for option in words[1:])


def test_tests_and_releases_are_tried_on_the_pythons_that_the_package_names() -> None:
    named = [
        version for text in PROJECT["classifiers"] for version in re.findall(r"^Programming .* :: (3\.\d+)$", text)
    ]
    assert [matrix["python"] for name in ("tests", "release") for matrix in matrices(GITHUB / f"workflows/{name}.yaml")]
    for name in ("tests", "release"):
        for matrix in matrices(GITHUB / f"workflows/{name}.yaml"):
            assert matrix["python"] == named
            assert {system.partition("-")[0] for system in matrix["os"]} == {"ubuntu", "macos"}


def test_nothing_is_published_that_was_not_tried() -> None:
    jobs = yaml.safe_load((GITHUB / "workflows" / "release.yaml").read_text())["jobs"]
    (publishing,) = [
        job for job in jobs.values() if any("pypi-publish" in step.get("uses", "") for step in job["steps"])
    ]
    assert publishing["needs"] == "try"
    assert jobs["try"]["needs"] == "build"
    assert any("compare --episodes 20" in step.get("run", "") for step in jobs["try"]["steps"])


@pytest.mark.parametrize(("tag", "status"), [("v{}", 0), ("v0.0.1", 1), ("{}", 1)])
def test_a_release_has_the_versions_own_tag(tag: str, status: int) -> None:
    step = next(
        step for step in steps(GITHUB / "workflows" / "release.yaml") if step.get("name") == "The tag is the version"
    )
    name = tag.format(cli.__version__)
    done = subprocess.run(["bash", "-c", step["run"]], cwd=ROOT, env={"PATH": _path(), "GITHUB_REF_NAME": name})
    assert done.returncode == status


def _path() -> str:
    return f"{Path(sys.executable).parent}:/usr/bin:/bin"


@pytest.mark.parametrize("words", [words for workflow in WORKFLOWS for words in commands(workflow)], ids=" ".join)
def test_its_commands_are_accepted(words: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    if words[:2] != ["ros", "up"]:
        if words == ["--version"]:
            with pytest.raises(SystemExit, match="0"):
                cli.main(words)
        else:
            pytest.importorskip("psutil")
            cli.make_parser(whole=True).parse_args(words)
        return
    pytest.importorskip("rclpy")
    up = pytest.importorskip("pacman_env.ros.supervisor.up")
    asked: list[tuple[Any, ...]] = []
    monkeypatch.setattr(up, "up", lambda setup, options: asked.append((setup, options)) or 0)
    assert cli.main(words) == 0
    ((setup, options),) = asked
    assert setup.sim
    assert setup.starts_nav2
    assert options.rounds == 1
