from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from pacman_env import __version__, files
from pacman_env.cli.main import MODULES, main
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


def test_check_prints_json(room: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["map", "check", str(room), "--json", "--home", "1.5", "-0.5", "--spacing", "1"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["home"] == [1.5, -0.5]
    assert [(p["id"], p["x"], p["reachable"]) for p in report["pellets"]] == [(0, 0.0, True), (1, 1.0, True)]


def test_map_check_returns_0_despite_warnings(room: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["map", "check", str(room), "--home", "50", "50", "--spacing", "1.0"]) == 0
    assert "warning: home (50, 50) is not free" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["nowhere"], "nowhere: neither a YAML file"),
        (["ROOM", "--spacing", "0"], "pellets.spacing_m"),
        (["ROOM", "--set", "pellets.spacing_m=0"], "pellets.spacing_m"),
        (["ROOM", "--spacing", "0.001"], "room: pellets.spacing_m = 0.001: below the map's resolution"),
        (["BROKEN"], "key 'image' is missing"),
    ],
)
def test_map_check_error_ends_with_one_line(
    room: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], words: str
) -> None:
    broken = room.with_name("broken.yaml")
    broken.write_text(room.read_text().replace("image:", "picture:"))
    places = {"ROOM": str(room), "BROKEN": str(broken)}
    assert main(["map", "check", *(places.get(a, a) for a in arguments)]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert words in err
    assert err.startswith("pacman-env map check: ")
    assert err.count("\n") == 1
    assert err.endswith(" (see docs/maps.md)\n") is {"--spacing", "--set"}.isdisjoint(
        arguments
    )  # which is about no file


@pytest.mark.parametrize(
    "arguments",
    [
        ["fly"],
        ["map"],
        ["map", "check"],
        ["map", "check", "x", "--home", "1"],
        ["map", "check", "x", "--home", "nan", "0"],
        ["map", "check", "x", "--spacing", "two"],
        ["play", "house"],
        ["play", "--seed", "-1"],
        ["web", "--seed", "9007199254740992"],  # a browser would round it
        ["ros", "up", "--seed", "2147483648"],  # a parameter of the ghosts' node
        ["play", "--speed", "fast"],
        ["play", "--fps", "inf"],
    ],
)
def test_bad_arguments_end_with_line_and_status_2(capsys: pytest.CaptureFixture[str], arguments: list[str]) -> None:
    with pytest.raises(SystemExit) as caught:
        main(arguments)
    assert caught.value.code == 2
    err = capsys.readouterr().err
    assert err.startswith("pacman-env")
    assert err.count("\n") == 1


@pytest.mark.parametrize(
    ("arguments", "meant"),
    [(["comapre"], "compare"), (["map", "chek", "house"], "check"), (["ros", "doctr"], "doctor")],
)
def test_mistyped_command_is_answered_with_nearest_name(
    capsys: pytest.CaptureFixture[str], arguments: list[str], meant: str
) -> None:
    with pytest.raises(SystemExit):
        main(arguments)
    assert f"did you mean {meant}" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--map", "nowhere"], "nowhere: neither a YAML file"),
        (["--map", "hose"], "did you mean house"),
        (["--preset", "fast"], "unknown preset 'fast'"),
        (["--execution", "slow"], "unknown execution 'slow'"),
        (["--clyde-speed", "-1"], "clyde.speed_mps"),
        (["--time-limit", "0"], "time_limit_s"),
        (["--speed", "0"], "speed = 0.0"),
        (["--fps", "0"], "fps = 0.0"),
    ],
)
def test_play_refuses_wrong_arguments_in_one_line(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, arguments: list[str], words: str
) -> None:
    pytest.importorskip("pygame")
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    assert main(["play", *arguments]) == 2
    err = capsys.readouterr().err
    assert words in err
    assert err.count("\n") == 1


def test_play_without_pygame_ends_with_one_line(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "pygame", None)
    assert main(["play"]) == 2
    assert capsys.readouterr().err == f"pacman-env play: a window needs pygame: {files.install_command('render')}\n"


def test_play_without_screen_ends_with_one_line() -> None:
    pytest.importorskip("pygame")
    without = {key: os.environ[key] for key in os.environ if "DISPLAY" not in key and key != "SDL_VIDEODRIVER"}
    command = [sys.executable, "-m", "pacman_env.cli.main", "play"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, env=without)
    if sys.platform == "linux":  # elsewhere a screen needs no name
        assert (done.returncode, done.stdout) == (2, "")
        assert done.stderr == "pacman-env play: no screen to open a window on\n"


def test_list_names_the_shipped_maps(
    room: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    maps = room.parent / "maps"
    maps.mkdir()
    for name in ("attic", "cellar"):
        (maps / f"{name}.yaml").write_bytes(room.read_bytes())
    monkeypatch.setattr(files, "__file__", str(room.parent / "pacman_env" / "files.py"))
    assert main(["map", "list"]) == 0
    assert capsys.readouterr().out == "attic\ncellar\n"


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


@pytest.mark.parametrize("command", MODULES)
def test_every_command_has_its_own_help(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("psutil")
    if MODULES[command][0].startswith("training"):
        pytest.importorskip("torch")
        pytest.importorskip("optuna")
    with pytest.raises(SystemExit, match="0"):
        main([command, "--help"])
    assert capsys.readouterr().out.startswith(f"usage: pacman-env {command} ")


def test_missing_library_of_command_ends_with_one_line(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "torch", None)
    for name in [name for name in sys.modules if name.startswith("pacman_env.training")]:
        monkeypatch.delitem(sys.modules, name)
    assert main(["train", "--quick"]) == 2
    assert capsys.readouterr().err == (
        f"pacman-env train: needs torch: {files.install_command('train')} (see docs/machines.md)\n"
    )


def test_version_option_prints_version_in_new_process() -> None:
    command = [sys.executable, "-m", "pacman_env.cli.main", "--version"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert (done.returncode, done.stdout, done.stderr) == (0, f"{__version__}\n", "")


def test_map_generate_writes_houses_of_levels(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["map", "generate", str(tmp_path / "houses"), "--level", "7", "--count", "2"]) == 0
    assert sorted(path.name for path in (tmp_path / "houses").iterdir()) == [
        *("generated-7.pgm", "generated-7.yaml", "generated-8.pgm", "generated-8.yaml")
    ]
    assert capsys.readouterr().out.split() == [str(tmp_path / "houses" / f"generated-{k}.yaml") for k in (7, 8)]
    assert occupancy.load_map(tmp_path / "houses" / "generated-7.yaml").name == "generated-7"


@pytest.mark.parametrize("as_json", [False, True])
def test_map_check_returns_1_for_unplayable_map(room: Path, capsys: pytest.CaptureFixture[str], as_json: bool) -> None:
    assert main(["map", "check", str(room), "--spacing", "9", *(["--json"] if as_json else [])]) == 1
    out = capsys.readouterr().out
    refusal = json.loads(out)["refusal"] if as_json else out.partition("cannot be played: ")[2]
    assert "no pellet that the robot can reach at a spacing of 9.0 m" in refusal


@pytest.mark.parametrize(
    "levels", [["--count", "0"], ["--level", "1000999", "--count", "2"], ["--level", "999999", "--count", "2"]]
)
def test_map_generate_refuses_levels_outside_one_split(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], levels: list[str]
) -> None:
    assert main(["map", "generate", str(tmp_path / "houses"), *levels]) == 2
    assert "training has 0 to 999999, testing 1000000 to 1000999" in capsys.readouterr().err
    assert not (tmp_path / "houses").exists()


def test_map_generate_keeps_existing_houses(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    kept = tmp_path / "generated-1.pgm"
    kept.write_text("mine")
    assert main(["map", "generate", str(tmp_path), "--count", "2"]) == 2
    assert capsys.readouterr().err == f"pacman-env map generate: {kept}: is there already\n"
    assert list(tmp_path.iterdir()) == [kept]
    assert kept.read_text() == "mine"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["warm-up", "foo"], "pacman-env warm-up: unrecognized arguments: foo"),
        (["map", "list", "foo"], "pacman-env map list: unrecognized arguments: foo"),
        (["completion"], "pacman-env completion: the following arguments are required: {bash,zsh,fish}"),
    ],
)
def test_wrong_arguments_name_command_and_accepted_values(
    arguments: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        main(arguments)
    assert ended.value.code == 2
    assert capsys.readouterr().err == f"{message}\n"
