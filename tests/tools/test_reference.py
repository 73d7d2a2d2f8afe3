"""The tables of the documentation are those of the code."""

import dataclasses
import re

import gymnasium as gym
import numpy as np
import pytest

from pacman_env.command_line.options import help_texts
from pacman_env.config import Config
from pacman_env.config.described import settings
from pacman_env.envs.registration import FLAT_ID, IDS
from pacman_env.observations.planner_columns import CANDIDATE_FEATURES, GLOBAL_FEATURES
from pacman_env.training.arguments import Hyperparameters
from tools import ids
from tools.common import ROOT
from tools.reference import TABLES, configuration, main

PAGES = sorted((ROOT / "docs").rglob("*.md"))


def test_committed_pages_contain_current_tables(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--check"]) == 0, capsys.readouterr().out


def test_every_table_appears_on_one_page() -> None:
    named = [name for page in PAGES for name in re.findall(r"<!-- table: ([\w-]+) -->", page.read_text())]
    assert sorted(named) == sorted(TABLES)


def test_configuration_table_lists_and_describes_every_field() -> None:
    rows = dict(re.findall(r"^\| `([\w.]+)` \| `(.*?)` \|.*\| \S.* \|$", configuration(), re.MULTILINE))
    wanted: dict[str, object] = {}
    for field in dataclasses.fields(Config):
        value = getattr(Config(), field.name)
        if dataclasses.is_dataclass(value):
            wanted |= {f"{field.name}.{f.name}": getattr(value, f.name) for f in dataclasses.fields(value)}
        else:
            wanted[field.name] = value
    assert rows == {name: repr(value).replace("'", '"') for name, value in wanted.items()}


def test_every_hyperparameter_has_a_help_text() -> None:
    assert list(help_texts(Hyperparameters)) == [field.name for field in dataclasses.fields(Hyperparameters)]


@pytest.fixture(scope="module")
def pages_of_ids() -> dict[str, str]:
    return {env_id: ids.page(env_id, gym.make(env_id).unwrapped) for env_id in IDS}


def test_committed_pages_of_ids_are_current(pages_of_ids: dict[str, str]) -> None:
    assert sorted(ids.PAGES.glob("*.md")) == sorted(ids.PAGES / f"{ids.file_name(env_id)}.md" for env_id in IDS)
    for env_id, text in pages_of_ids.items():
        assert (ids.PAGES / f"{ids.file_name(env_id)}.md").read_text(encoding="utf-8") == text, env_id


@pytest.mark.parametrize("env_id", ["pacman_env/PacManBot-v2", "pacman_env/PacManBotGhosts-v2"])
def test_documented_columns_match_observation_space(env_id: str, pages_of_ids: dict[str, str]) -> None:
    space = gym.make(env_id).observation_space
    for key, section in re.findall(r"^### `(\w+)`\n(.*?)(?=^##)", pages_of_ids[env_id], re.MULTILINE | re.DOTALL):
        rows = re.findall(r"^\| (\d+) \| `(\w+)` \| ([-\d.]+) \| ([-\d.]+) \|", section, re.MULTILINE)
        box = space[key]  # type: ignore[index]
        low, high = (np.atleast_2d(bound)[0] for bound in (box.low, box.high))
        np.testing.assert_allclose(low, [float(row[2]) for row in rows], atol=5e-4)
        np.testing.assert_allclose(high, [float(row[3]) for row in rows], atol=5e-4)


def test_page_of_flat_id_describes_every_planner_column(pages_of_ids: dict[str, str]) -> None:
    named = re.findall(r"^\| \d+ \| `(\w+)` \| \S", pages_of_ids[FLAT_ID], re.MULTILINE)
    assert [name for name in named if name in {*CANDIDATE_FEATURES, *GLOBAL_FEATURES}] == [
        *CANDIDATE_FEATURES,
        *GLOBAL_FEATURES,
    ]


def test_setting_provides_unit_and_description_of_field() -> None:
    shown = {setting.name: (setting.unit, setting.words) for setting in settings()}
    assert shown["robot.radius_m"] == ("m", "body (Create 3)")
    assert shown["robot.wheel_acceleration_mps2"] == ("m/s²", "Create 3")
    assert shown["localization.perfect"] == ("", "True: the believed pose always equals the true pose")
