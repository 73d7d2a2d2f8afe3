"""``pacman-env dataset``: data sets that Minari reads, the same for any number of workers, whole or absent."""

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
import pytest

pytest.importorskip("jax")
pytest.importorskip("minari")

import minari

from pacman_env import __version__
from pacman_env.episodes.rollout import episode_seeds
from pacman_env.evaluation import dataset
from pacman_env.executors.executor import Done, InProcess
from pacman_env.world.maps.occupancy import load_map

NAME = "pacman-env/house-v0"  # which docs/data.md reads
SHORT = ["--map", "loop", "--set", "time_limit_s=40", "--set", "pellets.spacing_m=3", "--policy", "nearest"]


def written(folder: Path, *more: str) -> Any:
    assert dataset.main([NAME, *SHORT, "--episodes", "6", "--seed", "3", "--root", str(folder), *more]) == 0
    return minari.MinariDataset(folder / NAME / "data")


def content(data: Any) -> list[tuple[Any, ...]]:
    """Return what must be equal in two data sets."""
    about = data.storage.get_episode_metadata(range(data.total_episodes))
    names = ("observations", "actions", "rewards", "terminations", "truncations", "infos")
    return [({name: getattr(one, name) for name in names}, note) for one, note in zip(data, about, strict=True)]


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("datasets")
    written(folder)
    return folder


@pytest.fixture
def opened(root: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(root))
    return minari.load_dataset(NAME)


def test_recovered_environment_repeats_recorded_rounds(opened: Any) -> None:
    env = opened.recover_environment()
    seeds = [int(about["options"]["round_seed"]) for _, about in content(opened)]
    assert seeds == [int(seed) % 2**63 for seed in episode_seeds(3, 6)]  # the rounds of ``compare --seed 3``
    for episode, (_, about) in zip(opened, content(opened), strict=True):
        observation, info = env.reset(options={"round_seed": int(about["options"]["round_seed"])})
        for k, action in enumerate(episode.actions.tolist()):
            np.testing.assert_array_equal(observation, episode.observations[k])
            np.testing.assert_array_equal(env.unwrapped.action_masks(), episode.infos["action_mask"][k])
            observation, reward, terminated, truncated, info = env.step(action)
            ends = episode.rewards[k], episode.terminations[k], episode.truncations[k]
            assert (reward, terminated, truncated) == ends
            assert info["elapsed_s"] == episode.infos["elapsed_s"][k + 1]
        np.testing.assert_array_equal(observation, episode.observations[-1])
        assert terminated or truncated
        assert about["outcome"] in ("caught", "complete", "cleared", "timeout")


def test_metadata_describes_how_data_was_made(opened: Any) -> None:
    metadata = opened.storage.metadata
    facts = metadata["pacman_env"]
    assert facts["command"] == f"pacman-env dataset {NAME} {' '.join(SHORT)} --episodes 6 --seed 3"
    assert (facts["version"], facts["seed"], facts["map_hash"]) == (__version__, 3, load_map("loop").hash)
    assert facts["settings"]["time_limit_s"] == 40
    assert metadata["algorithm_name"] == "nearest"
    assert "author" not in metadata


def test_arrays_of_observation_become_groups(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    data = written(Path("relative"), "--id", "PacManBot-v2", "--observation", "features", "grid", "--episodes", "1")
    (first,) = data
    assert data.observation_space.contains({key: array[0] for key, array in first.observations.items()})
    assert first.observations["grid"].dtype == np.uint8
    assert "action_mask" not in (first.infos or {})  # it is in the observation


def test_choices_without_action_are_counted(tmp_path: Path) -> None:
    few = content(written(tmp_path, "--policy", "lookahead", "--set", "observation.nearest_pellets=1"))
    assert sum(about["unlisted"] for _, about in few) > 0


def test_documentation_reads_data_set(opened: Any, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("pandas")
    page = Path(__file__).resolve().parents[2] / "docs" / "data.md"
    blocks = re.findall(r"```py\n(.*?)```", page.read_text(), re.DOTALL)
    names: dict[str, Any] = {}
    for block in blocks:
        exec(compile(block, "docs/data.md", "exec"), names)
    assert len(names["decisions"]) == opened.total_steps
    assert names["masks"].shape == (len(names["episode"].actions) + 1, 7)
    assert "count" in capsys.readouterr().out


class _Backwards(InProcess):
    """Ends the last task first, as several workers may."""

    def run(self, function: Callable[..., Any], tasks: Any) -> Any:
        for number, task in reversed(list(enumerate(tasks))):
            yield Done(number, function(task))


def test_content_does_not_depend_on_workers(opened: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(dataset, "TASK_ROUNDS", 2)
    monkeypatch.setattr(dataset, "executor_of", lambda arguments: _Backwards())
    np.testing.assert_equal(content(written(tmp_path)), content(opened))


def test_rounds_of_level_are_adjacent(tmp_path: Path) -> None:
    data = written(tmp_path, "--map", "generated", "--set", "num_levels=2", "--set", "time_limit_s=5")
    levels = [int(about["level"]) for _, about in content(data)]
    assert levels == sorted(levels)
    assert set(levels) == {0, 1}


@pytest.mark.parametrize("name", ["a-v0", "xx/y/a-v1"])
def test_minari_lists_written_data_set(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path))
    assert dataset.main([name, *SHORT, "--episodes", "1", "--root", str(tmp_path)]) == 0
    assert list(minari.list_local_datasets()) == [name]


def test_existing_data_set_is_not_changed(root: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = root / NAME / "data" / "main_data.hdf5"
    before = file.stat().st_mtime_ns
    assert dataset.main([NAME, "--root", str(root)]) == 2
    assert f"{root / NAME}: already exists" in capsys.readouterr().err
    assert file.stat().st_mtime_ns == before


@pytest.mark.parametrize(("failure", "status"), [(KeyboardInterrupt(), 130), (mock.Mock(free=2**20), 2)])
def test_failed_recording_leaves_no_files(
    failure: Any, status: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("shutil.disk_usage", mock.Mock(side_effect=[failure]))
    assert dataset.main([NAME, *SHORT, "--episodes", "1", "--root", str(tmp_path)]) == status
    assert not [path for path in tmp_path.rglob("*") if path.is_file()]
