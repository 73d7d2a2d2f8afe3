import os
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from pacman_env.engine import cache_folder
from pacman_env.levels import assets as cache_module
from pacman_env.levels.assets import Arrays, cached_arrays

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


def test_arrays_are_computed_once(cache: Path) -> None:
    compute = Computed()
    first, second = get(compute), get(compute)
    assert compute.times == 1
    for name in ("a", "b"):
        np.testing.assert_array_equal(first[name], second[name])
        assert first[name].dtype == second[name].dtype
    assert sorted(p.name for p in cache.iterdir()) == [KEY]  # no temporary folder is left
    assert (cache / KEY).stat().st_mode == cache.stat().st_mode  # whoever can read the cache can read it
    assert get(compute, "11")["a"][0, 0] == 2  # another key has its own arrays
    second["a"][:] = 99
    assert first["a"][0, 0] == get(compute)["a"][0, 0] == 1


def shortened(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-3])


def bad_header(path: Path) -> None:
    path.write_bytes(path.read_bytes().replace(b"'shape': (", b"'shape': [", 1))


def pickled(path: Path) -> None:
    np.save(path, np.array([{"a": 1}], dtype=object), allow_pickle=True)


@pytest.mark.parametrize("damage", [shortened, bad_header, pickled, os.remove])
def test_damaged_file_is_replaced(cache: Path, damage: object) -> None:
    compute = Computed()
    get(compute)
    damage(cache / KEY / "a.npy")  # type: ignore[operator]
    assert get(compute)["a"][0, 0] == 2
    assert get(compute)["a"][0, 0] == 2
    assert compute.times == 2


def test_unwritable_cache_is_no_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").write_text("in the way")
    monkeypatch.setenv("PACMAN_ENV_CACHE", str(tmp_path / "file"))
    monkeypatch.setattr(cache_folder, "unkept", [])
    compute = Computed()
    with pytest.warns(RuntimeWarning) as said:
        assert [int(get(compute)["a"][0, 0]) for _ in range(2)] == [1, 2]
    assert len(said) == 1


def test_error_while_computing_stores_nothing(cache: Path) -> None:
    def fails() -> Arrays:
        raise RuntimeError("no")

    with pytest.raises(RuntimeError, match="no"):
        cached_arrays(KEY, ("a", "b"), fails)
    assert not cache.exists()


def test_concurrent_readers_get_whole_arrays(cache: Path) -> None:
    def whole(_: int) -> bool:
        arrays = cached_arrays(KEY, ("a",), lambda: {"a": np.arange(200_000)})
        return bool((arrays["a"] == np.arange(200_000)).all())

    with ThreadPoolExecutor(8) as pool:
        assert all(pool.map(whole, range(30)))
    assert sorted(p.name for p in cache.iterdir()) == [KEY]


def test_arrays_unused_longest_are_removed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PACMAN_ENV_CACHE", str(tmp_path))
    monkeypatch.setattr(cache_module, "KEEP_BYTES", 2500)
    for age, key in ((30, "a"), (20, "b")):
        cached_arrays(key, ("x",), lambda: {"x": np.zeros(100)})
        os.utime(tmp_path / "maps" / key, (time.time() - age,) * 2)
    cached_arrays("a", ("x",), lambda: pytest.fail("is there"))  # used again: now b is the oldest
    cached_arrays("c", ("x",), lambda: {"x": np.zeros(100)})
    assert sorted(f.name for f in (tmp_path / "maps").iterdir()) == ["a", "c"]
