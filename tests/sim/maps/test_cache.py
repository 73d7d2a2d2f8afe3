from __future__ import annotations

import os
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from pacman_env.engine import cache_folder
from pacman_env.sim.maps import assets as cache_module
from pacman_env.sim.maps.assets import Arrays, cached_arrays

KEY = "0123abcd"


class Computed:
    """Counts how often the arrays were computed; the first one tells which time it was."""

    def __init__(self) -> None:
        self.times = 0

    def __call__(self) -> Arrays:
        self.times += 1
        return {"a": np.full((3, 4), self.times, dtype=np.int16), "b": np.arange(5, dtype=np.float32)}


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("PACMAN_ENV_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache" / "maps"


def get(compute: Computed, key: str = KEY) -> Arrays:
    return cached_arrays(key, ("a", "b"), compute)


def test_arrays_are_computed_once_and_come_back_as_they_were(cache: Path) -> None:
    compute = Computed()
    first, second = get(compute), get(compute)
    assert compute.times == 1
    for name in ("a", "b"):
        np.testing.assert_array_equal(first[name], second[name])
        assert first[name].dtype == second[name].dtype
    assert sorted(p.name for p in cache.iterdir()) == [KEY]  # no temporary folder is left


def test_every_key_has_arrays_of_its_own(cache: Path) -> None:
    compute = Computed()
    assert [int(get(compute, key)["a"][0, 0]) for key in ("00", "11", "00")] == [1, 2, 1]


def test_writing_to_arrays_changes_neither_the_file_nor_other_readers(cache: Path) -> None:
    compute = Computed()
    get(compute)
    one, other = get(compute), get(compute)
    one["a"][:] = 99
    assert other["a"][0, 0] == 1
    assert get(compute)["a"][0, 0] == 1
    assert compute.times == 1


def shortened(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-3])


def emptied(path: Path) -> None:
    path.write_bytes(b"")


def replaced_by_noise(path: Path) -> None:
    path.write_bytes(np.random.default_rng(0).bytes(300))


def header_only(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:9])


def bad_header(path: Path) -> None:
    path.write_bytes(path.read_bytes().replace(b"'shape': (", b"'shape': [", 1))


def pickled(path: Path) -> None:
    np.save(path, np.array([{"a": 1}], dtype=object), allow_pickle=True)


@pytest.mark.parametrize("damage", [shortened, emptied, replaced_by_noise, header_only, bad_header, pickled, os.remove])
def test_a_damaged_file_is_computed_again_and_replaced(cache: Path, damage: object) -> None:
    compute = Computed()
    get(compute)
    damage(cache / KEY / "a.npy")  # type: ignore[operator]
    assert get(compute)["a"][0, 0] == 2
    assert get(compute)["a"][0, 0] == 2
    assert compute.times == 2


def test_a_cache_that_cannot_be_written_is_no_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").write_text("in the way")
    monkeypatch.setenv("PACMAN_ENV_CACHE", str(tmp_path / "file"))
    monkeypatch.setattr(cache_folder, "unkept", [])
    compute = Computed()
    with pytest.warns(RuntimeWarning) as said:
        assert [int(get(compute)["a"][0, 0]) for _ in range(2)] == [1, 2]
    assert len(said) == 1


def test_arrays_can_be_read_by_whoever_can_read_the_cache(cache: Path) -> None:
    get(Computed())
    assert (cache / KEY).stat().st_mode == cache.stat().st_mode


def test_an_error_while_computing_is_the_callers_and_stores_nothing(cache: Path) -> None:
    def fails() -> Arrays:
        raise RuntimeError("no")

    with pytest.raises(RuntimeError, match="no"):
        cached_arrays(KEY, ("a", "b"), fails)
    assert not cache.exists()


def test_readers_and_writers_at_the_same_time_all_get_whole_arrays(cache: Path) -> None:
    def whole(_: int) -> bool:
        arrays = cached_arrays(KEY, ("a",), lambda: {"a": np.arange(200_000)})
        return bool((arrays["a"] == np.arange(200_000)).all())

    with ThreadPoolExecutor(8) as pool:
        assert all(pool.map(whole, range(60)))
    assert sorted(p.name for p in cache.iterdir()) == [KEY]


def test_what_was_not_used_for_longest_makes_room(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PACMAN_ENV_CACHE", str(tmp_path))
    monkeypatch.setattr(cache_module, "KEEP_BYTES", 2500)
    for age, key in ((30, "a"), (20, "b")):
        cached_arrays(key, ("x",), lambda: {"x": np.zeros(100)})
        os.utime(tmp_path / "maps" / key, (time.time() - age,) * 2)
    cached_arrays("a", ("x",), lambda: pytest.fail("is there"))  # used again: now b is the oldest
    cached_arrays("c", ("x",), lambda: {"x": np.zeros(100)})
    assert sorted(f.name for f in (tmp_path / "maps").iterdir()) == ["a", "c"]
