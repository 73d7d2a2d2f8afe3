"""Houses on disk: a level by its file is the level that was prepared, and no broken file is played on."""

import os
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from pacman_env.cli.warm_up import _prepare_houses
from pacman_env.config import Config, make_config
from pacman_env.engine import cache_folder
from pacman_env.levels import level_files, level_source
from pacman_env.levels.assets import MapAssets
from pacman_env.levels.coarse_map import add_coarse_map
from pacman_env.levels.house_families import FAMILIES, HOUSES, LONG_HOUSES, WIDE_HOUSES, HouseFamily
from pacman_env.levels.level import COARSE_MAP, PREDICTION, Level
from pacman_env.levels.level_files import LevelFiles
from pacman_env.levels.level_source import TEST_LEVEL, GeneratedMaps, prepare_level
from tests.envs import helpers

CONFIG = make_config()


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A cache without houses; compiled code is found where it always is."""
    kernels = cache_folder.kernel_folder()
    monkeypatch.setenv("PACMAN_ENV_CACHE", str(tmp_path))
    monkeypatch.setattr(cache_folder, "unkept", [])
    assert kernels == cache_folder.kernel_folder()
    return tmp_path


@pytest.fixture
def prepared(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """The levels that were prepared, not loaded."""
    found: list[int] = []

    def counted(level: int, config: Config, family: HouseFamily = HOUSES) -> MapAssets:
        found.append(level)
        return prepare_level(level, config, family)

    monkeypatch.setattr(level_source, "prepare_level", counted)
    return found


def files(cache: Path) -> list[Path]:
    return sorted((cache / "houses").rglob("*.level"))


def fresh(level: int, config: Config = CONFIG, family: HouseFamily = HOUSES) -> Level:
    """The level without a file."""
    return Level.of(prepare_level(level, config, family), config)


def everything(level: Level) -> dict[str, Any]:
    level.add_prediction_arrays()
    steps = level.find(PREDICTION)
    assert steps is not None
    found = {name: array for name, array in level.arrays.items() if name != "later"}
    found |= steps.arrays | {f"coarse {k}": v for k, v in add_coarse_map(level).arrays.items()}
    return found | {"facts": level.facts}


def same(one: Level, other: Level) -> bool:
    return helpers.same(everything(one), everything(other))


@pytest.mark.parametrize(("level", "family"), [(TEST_LEVEL + 1, HOUSES), (5, WIDE_HOUSES), (5, LONG_HOUSES)])
def test_stored_level_equals_prepared_one(level: int, family: HouseFamily, cache: Path, prepared: list[int]) -> None:
    config = make_config(**{"pellets.spacing_m": family.spacing_m})
    maps = GeneratedMaps(config, level // TEST_LEVEL * TEST_LEVEL, 100, family)
    first, own = maps.prepare(level), fresh(level, config, family)
    assert len(files(cache)) == 1
    second = maps.prepare(level)
    assert prepared == [level]
    assert second.find(COARSE_MAP) is not None
    assert second.find(PREDICTION) is not None
    assert same(first, own)
    assert same(second, own)
    assert second.assets.occupancy.hash == own.assets.occupancy.hash


def _shorten(file: Path) -> None:
    os.truncate(file, file.stat().st_size - 1)


def _change_head(file: Path) -> None:
    content = bytearray(file.read_bytes())
    content[3] ^= 1
    file.write_bytes(content)


def _exchange(file: Path) -> None:
    """The file of another level."""
    other = GeneratedMaps(CONFIG, 0, 100)
    other.prepare(8)
    os.replace(file.with_name("8.level"), file)


@pytest.mark.parametrize("damage", [_shorten, _change_head, _exchange])
def test_damaged_file_is_prepared_again(damage: Callable[[Path], None], cache: Path, prepared: list[int]) -> None:
    maps = GeneratedMaps(CONFIG, 0, 100)
    first = fresh(7)
    maps.prepare(7)
    damage(files(cache)[0])
    assert same(maps.prepare(7), first)
    assert prepared.count(7) == 2
    assert same(maps.prepare(7), first)
    assert prepared.count(7) == 2


def test_other_settings_have_other_files(cache: Path, prepared: list[int]) -> None:
    for changes in ({}, {"refuges.nooks": 1}, {"robot.radius_m": 0.16}, {"clyde.speed_mps": 0.3}):
        GeneratedMaps(CONFIG.with_fields(**changes), 0, 100).prepare(1)
    assert len(files(cache)) == len(prepared) == 3  # the speed is no part of a house


def test_families_have_files_of_their_own(cache: Path, prepared: list[int]) -> None:
    for family in FAMILIES.values():
        GeneratedMaps(CONFIG, 0, 100, family).prepare(1)
    assert len(files(cache)) == len(prepared) == len(FAMILIES)


def test_endless_houses_are_not_kept(cache: Path, prepared: list[int]) -> None:
    maps = GeneratedMaps.named("generated", CONFIG, None, 0)
    for _ in range(2):
        maps.prepare(123_456)
    assert prepared == [123_456, 123_456]
    assert not files(cache)


def test_cache_that_cannot_be_made_is_done_without(cache: Path, prepared: list[int]) -> None:
    (cache / "houses").write_text("in the way")
    maps = GeneratedMaps(CONFIG, 0, 100)
    with pytest.warns(RuntimeWarning):  # once in a process
        first = maps.prepare(1)
    assert same(GeneratedMaps(CONFIG, 0, 100).prepare(1), first)
    assert prepared == [1, 1]


@pytest.mark.skipif(os.name != "posix" or os.geteuid() == 0, reason="root writes everywhere")
def test_read_only_cache_is_used(cache: Path, prepared: list[int]) -> None:
    maps = GeneratedMaps(CONFIG, 0, 100)
    first, folder = maps.prepare(1), files(cache)[0].parent
    folder.chmod(0o500)
    try:
        assert same(maps.prepare(1), first)
        with pytest.warns(RuntimeWarning):
            maps.prepare(2)
    finally:
        folder.chmod(0o700)
    assert prepared == [1, 2]


def test_sets_used_longest_ago_are_removed(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(level_files, "_KEEP_BYTES", 15 << 20)  # of two or three houses
    for radius in (0.17, 0.171, 0.172, 0.173):
        GeneratedMaps(CONFIG.with_fields(**{"robot.radius_m": radius}), 0, 100).prepare(1)
        time.sleep(0.02)
    kept = {file.parent.name for file in files(cache)}
    assert LevelFiles(CONFIG.with_fields(**{"robot.radius_m": 0.173}), "generated").key in kept
    assert LevelFiles(CONFIG.with_fields(**{"robot.radius_m": 0.17}), "generated").key not in kept


def test_warm_up_prepares_what_is_not_kept(
    cache: Path, prepared: list[int], capsys: pytest.CaptureFixture[str]
) -> None:
    _prepare_houses(2)
    assert prepared == [0, 1, TEST_LEVEL, TEST_LEVEL + 1]
    _prepare_houses(2)
    assert len(prepared) == 4
    assert len(files(cache)) == 4
    assert capsys.readouterr().out.count("4 houses") == 2


def test_processes_prepare_one_level_at_once(cache: Path, prepared: list[int]) -> None:
    script = """
from pacman_env.config import make_config
from pacman_env.levels.level_source import GeneratedMaps
print(GeneratedMaps(make_config(), 0, 100).prepare(4).assets.occupancy.hash)
"""
    environment = {**os.environ, "PACMAN_ENV_CACHE": str(cache)}
    kernels = cache_folder.kernel_folder()
    assert kernels is not None
    (cache / "kernels").symlink_to(kernels.parent)
    both = [
        subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE, text=True, env=environment)
        for _ in range(2)
    ]
    hashes = {one.communicate()[0] for one in both}
    assert [one.returncode for one in both] == [0, 0]
    assert len(hashes) == 1
    assert [file.name for file in (cache / "houses").rglob("*") if file.is_file()] == ["4.level"]
    assert same(GeneratedMaps(CONFIG, 0, 100).prepare(4), fresh(4))
    assert not prepared
