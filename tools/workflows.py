"""GitHub's workflows on this machine: ``python -m tools.workflows [NAME ...]`` runs the commands of their steps.

Each job begins in a folder of its own. Checkout, the choice of a Python and artifacts are done as their actions do
them; other actions, and jobs in a container or on another system or Python, are named and left out. A step that is
skipped here may still fail on a host.
"""

import argparse
import itertools
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from glob import glob
from pathlib import Path
from typing import Any

import yaml

from pacman_env import __version__
from pacman_env.cli.command import Parser, run_command
from tools.common import ROOT, add_names

FOLDER = ROOT / ".github" / "workflows"
NAMES = sorted(path.stem for path in FOLDER.glob("*.yaml"))
_HERE = ("ubuntu-22.04", "ubuntu-24.04", "ubuntu-latest")  # jobs of these run on any Linux
_ACTIONS = tuple(f"actions/{name}" for name in ("checkout", "setup-python", "upload-artifact", "download-artifact"))


class LeftOut(Exception):
    """Why a job does not run here."""


class StepFailed(Exception):
    """Which step, and its exit status."""


def jobs_of(workflow: Mapping[str, Any]) -> Iterator[tuple[str, Mapping[str, Any], dict[str, str]]]:
    """Name, job and values of its matrix, for each of its combinations, after the jobs that it needs."""
    waiting, done = dict(workflow["jobs"]), set[str]()
    while waiting:
        ready = [name for name, job in waiting.items() if {*_list(job.get("needs", ()))} <= done]
        if not ready:
            raise ValueError(f"jobs that wait for one another, or for one that is not there: {', '.join(waiting)}")
        for name in ready:
            job = waiting.pop(name)
            matrix = job.get("strategy", {}).get("matrix", {})
            for values in itertools.product(*matrix.values()):
                yield name, job, dict(zip(matrix, map(str, values), strict=True))
            done.add(name)


class Runner:
    """Runs jobs one after another; what a job uploads is there for later ones."""

    def __init__(self, folder: Path, pythons: Sequence[str], tag: str) -> None:
        """``pythons``: the versions to run, all if empty; ``tag``: the name of what is built."""
        self._folder, self._pythons, self._tag = folder, pythons, tag
        self._number = 0

    def run(self, job: Mapping[str, Any], matrix: Mapping[str, str]) -> list[str]:
        """Run a job's steps; which of them were left out. Raises LeftOut for the whole job, StepFailed at its end."""
        if "container" in job:
            raise LeftOut(f"in the container {job['container']}")
        system = _filled(job["runs-on"], matrix)
        if system not in _HERE:
            raise LeftOut(f"on {system}")
        version = matrix.get("python")
        if version is not None and self._pythons and version not in self._pythons:
            raise LeftOut(f"Python {version} was not asked for")
        self._number += 1
        place = self._folder / f"job-{self._number}"
        place.mkdir()
        environment = {name: value for name, value in os.environ.items() if name not in ("VIRTUAL_ENV", "PYTHONPATH")}
        environment |= {"CI": "true", "GITHUB_REF_NAME": self._tag, "GITHUB_WORKSPACE": str(place)}
        environment |= {name: str(value) for name, value in job.get("env", {}).items()}
        left_out, failed = [], ""
        for step in job["steps"]:
            action = step.get("uses", "").partition("@")[0]
            if failed and step.get("if") != "always()":
                continue
            if action and action not in _ACTIONS:
                left_out.append(f"without {action}")
                continue
            given = {key: _filled(str(value), matrix) for key, value in step.get("with", {}).items()}
            if status := self._step(step, action, given, place, environment):
                name = step.get("name") or action or step["run"].partition("\n")[0]
                failed = failed or f"{name}: exit status {status}"
        if failed:
            raise StepFailed(failed)
        return left_out

    def _step(
        self, step: Mapping[str, Any], action: str, given: Mapping[str, str], place: Path, environment: dict[str, str]
    ) -> int:
        """Its exit status; ``environment`` is that of the job from now on."""
        if not action:
            command = ["bash", "--noprofile", "--norc", "-eo", "pipefail", "-c", step["run"]]
            return subprocess.run(command, cwd=place, env=environment).returncode
        if action == "actions/checkout":
            return subprocess.run(["git", "clone", "--quiet", str(ROOT), str(place)]).returncode
        if action == "actions/setup-python":
            programs = _python(given["python-version"], self._folder / f"python-{self._number}")
            environment["PATH"] = os.pathsep.join((str(programs), environment["PATH"]))
        elif action == "actions/upload-artifact":
            found = [Path(one) for one in glob(str(place / given["path"]))]
            if not found:
                return int(given.get("if-no-files-found") == "error")
            for one in found:
                inside = one.iterdir() if one.is_dir() else [one]
                for file in inside:
                    _copy(file, self._folder / "artifacts" / given["name"] / file.name)
        else:
            for file in (self._folder / "artifacts" / given["name"]).iterdir():
                _copy(file, place / given["path"] / file.name)
        return 0


def _list(value: Any) -> list[str]:
    return [value] if isinstance(value, str) else list(value)


def _filled(text: str, matrix: Mapping[str, str]) -> str:
    for name, value in matrix.items():
        text = text.replace(f"${{{{ matrix.{name} }}}}", value)
    return text


def _copy(source: Path, target: Path) -> None:
    target.parent.mkdir(parents=True, exist_ok=True)
    (shutil.copytree if source.is_dir() else shutil.copy2)(source, target)


def _python(version: str, folder: Path) -> Path:
    """Programs of a new virtual environment of this version: a step may install. LeftOut if there is none here."""
    places = [*os.environ["PATH"].split(os.pathsep), *glob(str(Path.home() / ".pyenv" / "versions" / "*" / "bin"))]
    for place, name in itertools.product(places, (f"python{version}", "python")):
        program = Path(place, name)
        # pyenv has shims on PATH; one of a virtual environment has what was installed there.
        if not program.exists() or "shims" in program.parts or (program.parents[1] / "pyvenv.cfg").exists():
            continue
        code = "import sys; print('%d.%d' % sys.version_info[:2])"
        done = subprocess.run([program, "-c", code], capture_output=True, text=True)
        if done.stdout.strip() != version:
            continue
        made = subprocess.run([program, "-m", "venv", "--clear", str(folder)], stdout=subprocess.DEVNULL)
        if made.returncode == 0:
            return folder / "bin"
    raise LeftOut(f"no Python {version} on this machine that makes virtual environments")


def _run(arguments: argparse.Namespace) -> int:
    failed = 0
    with tempfile.TemporaryDirectory() as folder:
        for name in arguments.names or NAMES:
            runner = Runner(Path(folder, name), arguments.python, arguments.tag)
            Path(folder, name).mkdir()
            for job_name, job, matrix in jobs_of(yaml.safe_load((FOLDER / f"{name}.yaml").read_text())):
                if arguments.jobs and job_name not in arguments.jobs:
                    continue
                title = " ".join((name, job_name, *matrix.values()))
                print(f"{title} ...", file=sys.stderr, flush=True)
                try:
                    outcome = "; ".join(("passed", *runner.run(job, matrix)))
                except LeftOut as reason:
                    outcome = f"left out: {reason}"
                except StepFailed as step:
                    outcome, failed = f"FAILED: {step}", failed + 1
                print(f"{title}: {outcome}", flush=True)
    return int(failed > 0)


def main(argv: Sequence[str] | None = None) -> int:
    parser = Parser(prog="python -m tools.workflows", description="Run what the workflows run, on this machine.")
    add_names(parser, "workflow", NAMES)
    parser.add_argument("--jobs", nargs="+", metavar="JOB", help="these alone; a job that they need must be among them")
    parser.add_argument("--python", nargs="+", default=(), metavar="3.N", help="of a matrix, these alone (all)")
    parser.add_argument("--tag", default=f"v{__version__}", help="that a release is built of (%(default)s)")
    return run_command(parser, argv, _run)


if __name__ == "__main__":
    sys.exit(main())
