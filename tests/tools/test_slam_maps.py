"""Maps are fetched with git from a repository on this machine."""

import hashlib
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest

from pacman_env.command_line.slam_maps import listed_maps
from pacman_env.world.maps.occupancy import load_map
from tests.shared import shared_path
from tools.slam_maps import fetch, main

FILES = "maps/plan.yaml", "maps/plan.pgm"


@pytest.fixture
def listed(tmp_path: Path) -> dict[str, Any]:
    repository = tmp_path / "OWNER" / "NAME"
    (repository / "maps").mkdir(parents=True)
    load_map("maze").save(repository / FILES[0])
    for words in ("init", "add .", "-c user.name=n -c user.email=n@n commit -m Map"):
        subprocess.run(["git", *words.split()], cwd=repository, check=True, capture_output=True)
    commit = subprocess.check_output(["git", "rev-parse", "HEAD"], cwd=repository, text=True).strip()
    hashes = {file: hashlib.sha256((repository / file).read_bytes()).hexdigest() for file in FILES}
    return {"repository": "OWNER/NAME", "commit": commit, "files": hashes}


def test_map_is_fetched_once(listed: dict[str, Any], tmp_path: Path) -> None:
    assert fetch(listed, tmp_path / "home", tmp_path.as_uri())
    assert load_map(tmp_path / "home").hash == load_map("maze").hash
    shutil.rmtree(tmp_path / "OWNER")
    assert not fetch(listed, tmp_path / "home", tmp_path.as_uri())


def test_wrong_file_is_refused_and_not_written(listed: dict[str, Any], tmp_path: Path) -> None:
    listed["files"][FILES[1]] = "0" * 64
    with pytest.raises(ValueError, match=f"SHA-256 of {FILES[1]} = "):
        fetch(listed, tmp_path / "home", tmp_path.as_uri())
    assert not (tmp_path / "home").exists()


def test_every_map_without_repository_is_reported(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([str(tmp_path / "out"), "--from", tmp_path.as_uri()]) == 1
    assert [line.partition(":")[0] for line in capsys.readouterr().err.splitlines()] == list(listed_maps())


def test_listed_hashes_fit_the_maps_of_other_tests() -> None:
    folder = shared_path("maps")
    assert not any(fetch(one, folder / name, "") for name, one in listed_maps().items())
