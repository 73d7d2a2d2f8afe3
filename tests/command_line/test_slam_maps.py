"""Names of maps made by SLAM on the command line."""

import argparse
from pathlib import Path

import pytest

from pacman_env.command_line import slam_maps


def test_names_become_files_once_fetched(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(slam_maps, "FOLDER", tmp_path)
    monkeypatch.chdir(tmp_path)
    with pytest.raises(argparse.ArgumentTypeError, match="scripts/slam_maps"):
        slam_maps.map_source("slam:tb4_maze")
    with pytest.raises(argparse.ArgumentTypeError, match="tb4_maze"):
        slam_maps.map_source("slam:tb4_mase")
    for name in slam_maps.listed_maps():
        (tmp_path / name).mkdir()
        (tmp_path / name / "map.yaml").touch()
    assert slam_maps.map_sources(["slam:tb4_maze", "house"]) == ["tb4_maze/map.yaml", "house"]
    assert len(slam_maps.map_sources(["slam"])) == 10
