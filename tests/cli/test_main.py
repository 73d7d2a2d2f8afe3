import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from pacman_env import __version__
from pacman_env.cli.main import main
from pacman_env.config import PRESETS
from pacman_env.world.maps import occupancy
from pacman_env.world.maps.occupancy import OccupancyMap


@pytest.fixture
def room(tmp_path: Path) -> Path:
    """A free room of 3 x 2 m in walls, its lower left corner at (-1, -1)."""
    pixels = np.zeros((42, 62), np.uint8)
    pixels[1:-1, 1:-1] = 254
    return OccupancyMap.from_pixels("room", pixels, 0.05, (-1.0, -1.0, 0.0)).save(tmp_path / "room.yaml")


def test_check_prints_a_report(room: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["map", "check", str(room), "--spacing", "1.0"]) == 0
    out, err = capsys.readouterr()
    assert "room: 62 x 42 px, 0.05 m per px" in out
    assert "free to game   6.0 m2" in out
    assert "pellets        2, 0 of them unreachable" in out  # pixels (20, 20) and (40, 20)
    assert "(0.00, 0.10)" in out
    assert err == ""
    assert main(["map", "check", str(room), "--home", "50", "50", "--spacing", "1.0"]) == 0
    assert "warning: home (50, 50) is not free" in capsys.readouterr().out


def test_check_prints_json(room: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["map", "check", str(room), "--json", "--home", "1.5", "-0.5", "--spacing", "1"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["home"] == [1.5, -0.5]
    assert [(p["id"], p["x"], p["reachable"]) for p in report["pellets"]] == [(0, 0.0, True), (1, 1.0, True)]


@pytest.mark.parametrize(
    ("option", "said"),
    [("'--version'", __version__), ("'--help'", "usage: pacman-env "), ("", f"pacman_env {__version__}: ")],
)
def test_module_prints_help_without_loading_heavy_libraries(option: str, said: str) -> None:
    code = f"import runpy, sys; sys.argv = ['pacman-env', {option}]\n"
    code += "try: runpy.run_module('pacman_env.cli.main', run_name='__main__')\n"
    heavy = {"cv2", "gymnasium", "matplotlib", "numba", "numpy", "onnxruntime", "pymunk", "torch", "yaml"}
    code += f"finally: print(sorted({heavy} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=300)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.startswith(said)
    assert done.stdout.endswith("\n[]\n")


@pytest.mark.parametrize("command", ["web", "ros up"])
def test_help_names_all_presets(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main([*command.split(), "--help"])
    said = capsys.readouterr().out.rpartition("--preset")[2]
    assert all(preset in said.split("--")[0] for preset in PRESETS)


def test_map_generate_writes_houses_of_levels(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["map", "generate", str(tmp_path / "houses"), "--level", "7", "--count", "2"]) == 0
    assert sorted(path.name for path in (tmp_path / "houses").iterdir()) == [
        *("generated-7.pgm", "generated-7.yaml", "generated-8.pgm", "generated-8.yaml")
    ]
    assert capsys.readouterr().out.split() == [str(tmp_path / "houses" / f"generated-{k}.yaml") for k in (7, 8)]
    assert occupancy.load_map(tmp_path / "houses" / "generated-7.yaml").name == "generated-7"
    assert main(["map", "generate", str(tmp_path), "--map", "generated:long"]) == 0
    assert occupancy.load_map(tmp_path / "generated-long-0.yaml").name == "generated-long-0"


@pytest.mark.parametrize("as_json", [False, True])
def test_map_check_returns_1_for_unplayable_map(room: Path, capsys: pytest.CaptureFixture[str], as_json: bool) -> None:
    assert main(["map", "check", str(room), "--spacing", "9", *(["--json"] if as_json else [])]) == 1
    out = capsys.readouterr().out
    refusal = json.loads(out)["refusal"] if as_json else out.partition("cannot be played: ")[2]
    assert "no pellet that the robot can reach at a spacing of 9.0 m" in refusal


def test_map_generate_keeps_existing_houses(tmp_path: Path, refused: Callable[..., None]) -> None:
    kept = tmp_path / "generated-1.pgm"
    kept.write_text("mine")
    refused(main, ["map", "generate", str(tmp_path), "--count", "2"], f"{kept}: already exists")
    assert kept.read_text() == "mine"
