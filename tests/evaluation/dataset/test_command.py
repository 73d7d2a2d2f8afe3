"""``pacman-env dataset``: files that Minari and pandas read, the same for any number of workers, whole or absent."""

import hashlib
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
import pytest

from pacman_env import __version__
from pacman_env.config import make_config
from pacman_env.envs.arguments import EnvArguments
from pacman_env.envs.game_runner import GameRunner
from pacman_env.evaluation.dataset import __main__ as dataset
from pacman_env.evaluation.dataset.recording import Recording, record, round_seeds, tasks_of
from pacman_env.world.maps.occupancy import load_map, map_file

minari = pytest.importorskip("minari")
pytest.importorskip("pyarrow")
pandas = pytest.importorskip("pandas")
minari_files = pytest.importorskip("pacman_env.evaluation.dataset.minari_files")

NAME = "pacman-env/short-v0"
SHORT = ["--map", "loop", "--set", "time_limit_s=40", "--set", "pellets.spacing_m=3", "--policy", "nearest"]


def written(folder: Path, *more: str) -> Path:
    assert dataset.main([NAME, *SHORT, "--episodes", "6", "--seed", "3", "--root", str(folder), *more]) == 0
    return folder / NAME


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return written(tmp_path_factory.mktemp("datasets"))


@pytest.fixture(scope="module")
def played() -> Any:
    """What the command of ``folder`` records."""
    arguments = dataset.make_parser().parse_args([NAME, *SHORT, "--episodes", "6", "--seed", "3"])
    env_id, named = dataset.arguments_of(arguments)
    made = EnvArguments(**{**dataset.IDS[env_id].kwargs, **named})
    (task,) = tasks_of(arguments.policy, made, round_seeds(arguments.seed, arguments.episodes))
    return record(task)


@pytest.fixture
def opened(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(folder.parents[1]))
    return minari.load_dataset(NAME)


def test_minari_reads_played_rounds(opened: Any, played: Any, folder: Path) -> None:
    assert (opened.total_episodes, opened.total_steps) == (6, len(played.actions))
    metadata = list(opened.storage.get_episode_metadata(range(6)))
    for episode, about, (decisions, looks) in zip(opened, metadata, played.slices(), strict=True):
        np.testing.assert_array_equal(episode.observations, played.observations[""][looks])
        np.testing.assert_array_equal(episode.actions, played.actions[decisions])
        np.testing.assert_array_equal(episode.rewards, played.rewards[decisions])
        np.testing.assert_array_equal(episode.terminations, played.terminated[decisions])
        np.testing.assert_array_equal(episode.truncations, played.truncated[decisions])
        np.testing.assert_array_equal(episode.infos["action_mask"], played.masks[looks])
        assert about["options"]["round_seed"] == played.rounds["seed"][episode.id]
    assert minari.MinariDataset(folder / "data").total_steps == opened.total_steps


def test_recovered_environment_repeats_recorded_round(opened: Any) -> None:
    env = opened.recover_environment()
    (about,) = opened.storage.get_episode_metadata([4])
    episode = opened[4]
    observation, _ = env.reset(options={"round_seed": int(about["options"]["round_seed"])})
    np.testing.assert_array_equal(observation, episode.observations[0])
    for k, action in enumerate(episode.actions.tolist()):
        observation, reward, terminated, truncated, _ = env.step(action)
        np.testing.assert_array_equal(observation, episode.observations[k + 1])
        assert (reward, terminated, truncated) == (episode.rewards[k], episode.terminations[k], episode.truncations[k])
    assert terminated or truncated


def test_pandas_reads_rows_for_decisions_and_rounds(folder: Path, played: Any) -> None:
    decisions, rounds = (pandas.read_parquet(folder / f"{name}.parquet") for name in ("decisions", "rounds"))
    assert rounds["decisions"].sum() == len(decisions) == len(played.actions)
    for number, (some, looks) in enumerate(played.slices()):
        rows = decisions[decisions["round"] == number]
        np.testing.assert_array_equal(rows["step"], np.arange(len(rows)))
        np.testing.assert_array_equal(np.stack(rows["observation"]), played.observations[""][looks][:-1])
        np.testing.assert_array_equal(np.stack(rows["action_mask"]), played.masks[looks][:-1] == 1)
        np.testing.assert_array_equal(rounds["last_observation"][number], played.observations[""][looks][-1])
        for name, array in (("action", played.actions), ("reward", played.rewards), ("elapsed_s", played.elapsed_s)):
            np.testing.assert_array_equal(rows[name], array[some])
        assert rows["reward"].sum() == pytest.approx(rounds["return"][number])
    assert rounds["seed"].tolist() == played.rounds["seed"].tolist()
    assert set(rounds["outcome"]) <= {"caught", "complete", "cleared", "timeout"}


def test_observation_arrays_become_groups_and_columns(tmp_path: Path) -> None:
    more = ["--id", "PacManBot-v1", "--observation", "features", "grid", "--episodes", "2"]
    there = written(tmp_path, *more)
    data = minari.MinariDataset(there / "data")
    (first, _) = data
    assert first.observations.keys() == data.observation_space.keys()
    assert first.observations["grid"].dtype == np.uint8
    assert data.observation_space.contains({key: array[0] for key, array in first.observations.items()})
    assert first.infos is None or "action_mask" not in first.infos  # it is in the observation
    decisions = pandas.read_parquet(there / "decisions.parquet")
    image = decisions["observation.grid"][0].reshape(first.observations["grid"].shape[1:])
    np.testing.assert_array_equal(image, first.observations["grid"][0])
    np.testing.assert_array_equal(decisions["action_mask"][0], first.observations["action_mask"][0] == 1)


def test_files_are_identical_for_any_number_of_workers(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    small: Callable[..., list[Recording]] = lambda *given: [  # noqa: E731
        Recording(one.policy, one.arguments, part) for one in tasks_of(*given) for part in np.array_split(one.seeds, 3)
    ]
    monkeypatch.setattr(dataset, "tasks_of", small)

    def hashes(folder: Path) -> dict[str, str]:
        files = (path for path in folder.rglob("*") if path.is_file())
        return {str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest() for path in files}

    one, two = (hashes(written(tmp_path / workers, "--workers", workers)) for workers in ("1", "2"))
    assert len(one) == 6
    assert one == two


def test_minari_loads_data_set_from_documented_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert dataset.main([NAME, *SHORT, "--episodes", "2"]) == 0
    monkeypatch.setenv("MINARI_DATASETS_PATH", "results/datasets")
    assert minari.load_dataset(NAME).total_episodes == 2


def test_card_and_facts_describe_how_data_was_made(folder: Path) -> None:
    facts = json.loads((folder / "facts.json").read_text())
    assert facts["version"] == __version__
    assert facts["map_hash"] == load_map("loop").hash
    assert facts["settings"]["time_limit_s"] == 40
    assert (facts["rounds"], facts["policy"], facts["seed"]) == (6, "nearest", 3)
    card = (folder / "README.md").read_text()
    assert f"pacman-env dataset {NAME} {' '.join(SHORT)} --episodes 6 --seed 3\n" in card
    for part in (load_map("loop").hash, f"pacman_env {__version__}", f"{facts['decisions']} decisions", "round_seed"):
        assert part in card
    for file in ("data/main_data.hdf5", "decisions.parquet", "rounds.parquet"):
        assert f"| `{file}` | {(folder / file).stat().st_size:,} |" in card
    minaris = json.loads((folder / "data" / "metadata.json").read_text())
    assert minaris["pacman_env"]["map_hash"] == load_map("loop").hash
    assert minaris["algorithm_name"] == "nearest"


@pytest.mark.parametrize("name", ["a-v0", "xx/y/a-v1", "__/--v0", "xx/a-v0-v12"])
def test_minari_lists_written_data_set(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path))
    assert dataset.main([name, *SHORT, "--episodes", "1", "--format", "minari", "--root", str(tmp_path)]) == 0
    assert list(minari.list_local_datasets()) == [name]
    assert not (tmp_path / name / "decisions.parquet").exists()
    assert minari.load_dataset(name).total_episodes == 1


def test_environment_of_map_file_is_recovered(tmp_path: Path) -> None:
    arguments = {"map": map_file("loop"), "settings": make_config("ideal", time_limit_s=40.0)}
    core = GameRunner(1, EnvArguments(**arguments))
    spaces = core.observation_space, core.action_space
    facts = {"dataset_id": NAME, "algorithm_name": "nearest"}
    with minari_files.MinariFiles(
        tmp_path, minari_files.spec_of("pacman_env/PacManBot-v1", arguments), spaces, facts
    ) as files:
        files.write(record(Recording("nearest", EnvArguments(**arguments), round_seeds(0, 1))))
    env = minari.MinariDataset(tmp_path / "data").recover_environment()
    assert env.unwrapped.config == core.config
    assert env.unwrapped.batch.source.first.occupancy.hash == load_map("loop").hash


def test_existing_data_set_is_not_changed(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = (folder / "README.md").stat().st_mtime_ns
    assert dataset.main([NAME, "--root", str(folder.parents[1])]) == 2
    assert capsys.readouterr().err.splitlines() == [f"pacman-env dataset: {folder}: already exists"]
    assert (folder / "README.md").stat().st_mtime_ns == before


@pytest.mark.parametrize("free", [2**20, 2**22])
def test_full_disk_is_reported_and_leaves_no_files(
    free: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("shutil.disk_usage", lambda folder: mock.Mock(free=free))
    assert dataset.main([NAME, *SHORT, "--episodes", "200", "--root", str(tmp_path)]) == 2
    assert "No space left on device" in capsys.readouterr().err
    assert not [path for path in tmp_path.rglob("*") if path.is_file()]
