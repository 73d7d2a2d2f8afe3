"""The steps of workflows run here in their order, with what their actions hand on, and what cannot run is named."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest
import yaml

from tools import workflows
from tools.workflows import FOLDER, NAMES, jobs_of, main

HERE = "{}.{}".format(*sys.version_info[:2])
WORKFLOW = f"""
jobs:
  try:
    needs: build
    strategy:
      matrix:
        os: [ubuntu-24.04, macos-15]
        python: ["{HERE}", "2.0"]
    runs-on: ${{{{ matrix.os }}}}
    steps:
      - uses: actions/setup-python@0
        with:
          python-version: ${{{{ matrix.python }}}}
      - uses: actions/download-artifact@0
        with: {{name: made, path: got}}
      - run: |
          cat got/one.txt
          python -c 'import sys; print(sys.version_info[:2])' >> seen.txt
          cat seen.txt
  build:
    runs-on: ubuntu-24.04
    env: {{WORD: hello}}
    steps:
      - uses: actions/checkout@0
      - run: test -f pyproject.toml && mkdir out && echo "$WORD $GITHUB_REF_NAME" > out/one.txt
      - uses: actions/upload-artifact@0
        with: {{name: made, path: out, if-no-files-found: error}}
      - uses: somebody/publish@0
  inside:
    runs-on: ubuntu-24.04
    container: ros:jazzy
    steps:
      - run: exit 1
"""
FAILS = """
jobs:
  bad:
    runs-on: ubuntu-24.04
    steps:
      - name: Two words
        run: |
          false
          echo not reached
      - run: echo not reached either
      - if: always()
        run: echo the end
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "good.yaml").write_text(WORKFLOW)
    (tmp_path / "fails.yaml").write_text(FAILS)
    monkeypatch.setattr(workflows, "FOLDER", tmp_path)
    monkeypatch.setattr(workflows, "NAMES", ["good", "fails"])
    return tmp_path


@pytest.mark.usefixtures("folder")
def test_jobs_run_after_those_that_they_need_and_get_what_those_uploaded(capfd: pytest.CaptureFixture[str]) -> None:
    assert main(["good", "--tag", "v9"]) == 0
    out = capfd.readouterr().out
    assert f"hello v9\n{tuple(sys.version_info[:2])}" in out
    assert [line for line in out.splitlines() if line.startswith("good ")] == [
        "good build: passed; without somebody/publish",
        "good inside: left out: in the container ros:jazzy",
        f"good try ubuntu-24.04 {HERE}: passed",
        "good try ubuntu-24.04 2.0: left out: no Python 2.0 on this machine that makes virtual environments",
        f"good try macos-15 {HERE}: left out: on macos-15",
        "good try macos-15 2.0: left out: on macos-15",
    ]


@pytest.mark.usefixtures("folder")
def test_a_step_that_fails_ends_its_job_but_for_what_always_runs(capfd: pytest.CaptureFixture[str]) -> None:
    assert main(["fails"]) == 1
    out = capfd.readouterr().out
    assert "fails bad: FAILED: Two words: exit status 1" in out
    assert "the end" in out
    assert "not reached" not in out


@pytest.mark.usefixtures("folder")
def test_jobs_and_pythons_can_be_chosen(capfd: pytest.CaptureFixture[str]) -> None:
    assert main(["good", "--jobs", "build", "try", "--python", "2.0"]) == 0
    out = capfd.readouterr().out
    assert f"good try ubuntu-24.04 {HERE}: left out: Python {HERE} was not asked for" in out
    assert "inside" not in out


def test_jobs_that_wait_for_one_another_are_named() -> None:
    jobs = {"a": {"needs": "b"}, "b": {"needs": ["a"]}}
    with pytest.raises(ValueError, match="a, b"):
        list(jobs_of({"jobs": jobs}))


@pytest.mark.parametrize("name", NAMES)
def test_every_workflow_of_the_project_can_be_laid_out(name: str) -> None:
    assert list(jobs_of(yaml.safe_load((FOLDER / f"{name}.yaml").read_text())))


@pytest.mark.daily
def test_a_release_is_built_and_its_wheel_plays_with_the_newest_packages(capfd: pytest.CaptureFixture[str]) -> None:
    assert main(["release", "--python", HERE]) == 0
    out = capfd.readouterr().out
    assert "release build: passed\n" in out
    assert f"release try ubuntu-24.04 {HERE}: passed\n" in out
