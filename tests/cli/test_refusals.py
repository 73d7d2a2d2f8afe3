"""Commands refuse wrong arguments with one line and status 2, and write nothing."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path

import pytest

from pacman_env.world.maps.occupancy import load_map
from tests.evaluation.helpers import refused_in_one_line

#: Arguments that a command needs beside the wrong ones.
COMMANDS = {
    "compare.__main__": ["--episodes", "1"],
    "report.__main__": ["--quick"],
    "leaderboard.__main__": [],
    "replay": [],
    "benchmark": ["--seconds", "0.01"],
}
_COMPARE, _REPORT, _LEADERBOARD, _REPLAY, _BENCHMARK = COMMANDS
#: What ``rounds.scenarios`` reads is refused alike in all commands; one of them is tried.
REFUSED = [
    (_COMPARE, "--map nowhere", "nowhere"),
    (_COMPARE, "--policies nearst", "unknown policy 'nearst'"),
    (_COMPARE, "--policies nearest run.zip", "run.zip: "),
    (_COMPARE, "--preset perfect", "unknown preset 'perfect': choose one of ideal, robot"),
    (_COMPARE, "--episodes 0", "must be at least 1"),
    (_COMPARE, "--episodes 99999999999999999999", "must be at most 1000000000"),
    (_COMPARE, "--episodes many", "'many' is no whole number"),
    (_COMPARE, "--workers -1", "must be at least 0"),
    (_COMPARE, "--seed -1", "must be at least 0"),
    (_COMPARE, "--clyde-speed -0.1", "clyde.speed_mps"),
    (_COMPARE, "--clyde-speed nan", "'nan' is not a finite number"),
    (_COMPARE, "--clyde-spawn-distance -1", "spawn_distance_m"),
    (_COMPARE, "--spacing 0", "pellets.spacing_m"),
    (_COMPARE, "--spacing 2 --set pellets.spacing_m=2", "given twice"),
    (_COMPARE, "--set clyde.speed_mps=1", "--clyde-speed"),
    (_COMPARE, "--set randomize.clyde_speed_mps=0.1,0.2", "randomize.clyde_speed_mps = (0.1, 0.2): must be None"),
    (_COMPARE, "--set nav2.haste=1", "unknown configuration field 'nav2.haste'"),
    (_COMPARE, "--set action=velocity", "action = 'velocity': played by policies that name goals"),
    (_COMPARE, "--set clyde.ghosts=policy", "clyde.ghosts[0] = 'policy': name the .onnx file that moves it"),
    (_COMPARE, "--endless --set endless=true", "endless: given twice"),
    (_COMPARE, "--map generated:test", "--map generated:test: generated houses are given as --levels test"),
    (_COMPARE, "--map house house.yaml", "two maps are called house"),
    (_COMPARE, "--levels validation", "invalid choice: 'validation'"),
    (_COMPARE, "--levels test --num-levels 1001", "num_levels = 1001"),
    (_COMPARE, "--levels test --start-level 5", "start_level = 5"),
    (_COMPARE, "--start-level 5", "--start-level: is for --levels"),
    (_COMPARE, "--video film.avi", "must end in .mp4 or .gif"),
    (_COMPARE, "--plot plot.jpg", "must end in .png"),
    (_COMPARE, "--json x.png", "is the plot's file too"),
    (_REPORT, "--baseline nearst", "unknown policy 'nearst'"),
    (_REPORT, "--episodes 1", "must be at least 2"),
    (_REPORT, "--speeds -1", "clyde.speed_mps"),
    (_REPORT, "--set endless=true", "endless = True: is what --endless N plays"),
    (_REPORT, "--set randomize.clyde_speed_mps=0.1,0.2", "randomize.clyde_speed_mps = (0.1, 0.2): must be None"),
    (_REPORT, "--variant calm", "must be NAME=SETTINGS"),
    (_REPORT, "--variant v=action=velocity", "--variant v: action = 'velocity'"),
    (_REPORT, "--variant v=refuges.nooks=0 v=refuges.nooks=1", "--variant v: given twice"),
    (_REPORT, "--variant v=clyde.spawn_distance_m=-1", "spawn_distance_m"),
    (_REPORT, "--out page.htm", "must end in .html"),
    (_REPORT, "--json page.html --out page.html", "is the page's file too"),
    (_LEADERBOARD, "--suite slow", "no suite 'slow': choose one of full, brief, learned, search, quick"),
    (_LEADERBOARD, "--suites absent.yaml", "absent.yaml: cannot be read"),
    (_LEADERBOARD, "--policies absent.onnx", "absent.onnx: cannot be read"),
    (_LEADERBOARD, "--policies run.zip", "run.zip: must be a name or an .onnx file"),
    (_LEADERBOARD, "--policies nearest", "--planner ppo: is none of --policies nearest"),
    (_LEADERBOARD, "--maps nowhere", "nowhere"),
    (_LEADERBOARD, "--maps generated:test", "--maps generated:test: test levels are in the suite"),
    (_LEADERBOARD, "--out page.html", "--out page.html: must end in .md"),
    (_LEADERBOARD, "--json numbers.md", "--json numbers.md: must end in .json"),
    (_LEADERBOARD, "--from absent.json", "absent.json: cannot be read"),
    (_REPLAY, "", "SEED"),
    (_REPLAY, "-1", "must be at least 0"),
    (_REPLAY, "18446744073709551616", "must be at most"),
    (_REPLAY, "1 --out film.avi", "must end in one of .mp4, .gif, .html"),
    (_REPLAY, "1 --map house --levels test", "not beside --map"),
    (_REPLAY, "1 --set action=velocity", "action = 'velocity'"),
    (_REPLAY, "1 --set randomize.clyde_speed_mps=0.1,0.2", "randomize.clyde_speed_mps = (0.1, 0.2): must be None"),
    (_BENCHMARK, "--rounds 0", "0: must be at least 1"),
    (_BENCHMARK, "--seconds -1", "-1: must be at least 0"),
    (_BENCHMARK, "--json .", "is a folder"),
]


@pytest.mark.parametrize(("command", "arguments", "message"), REFUSED)
def test_command_refuses_wrong_arguments(
    command: str,
    arguments: str,
    message: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    if "house.yaml" in arguments:
        load_map("house").save(tmp_path / "house.yaml")
    main = import_module(f"pacman_env.evaluation.{command}").main
    refused_in_one_line(main, [*COMMANDS[command], *arguments.split()], message, tmp_path, monkeypatch, capsys)
