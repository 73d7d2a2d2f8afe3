"""The tables of the documentation are those of the code."""

import dataclasses
import re

import numpy as np
import pytest

from pacman_env.cli.options import help_texts
from pacman_env.config import Config
from pacman_env.config.described import settings
from pacman_env.sim.observation.robot_features import (
    CANDIDATE_POWER_COLUMNS,
    COLUMNS,
    GHOST_BEARING_COLUMNS,
    GHOST_POWER_COLUMNS,
    PELLET_BEARING_COLUMNS,
)
from pacman_env.training.arguments import Hyperparameters
from tests.envs.helpers import make
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
    wanted = {}
    for field in dataclasses.fields(Config):
        value = getattr(Config(), field.name)
        if dataclasses.is_dataclass(value):
            wanted |= {f"{field.name}.{f.name}": getattr(value, f.name) for f in dataclasses.fields(value)}
        else:
            wanted[field.name] = value
    assert rows == {name: repr(value).replace("'", '"') for name, value in wanted.items()}


def test_every_hyperparameter_has_a_help_text() -> None:
    assert list(help_texts(Hyperparameters)) == [field.name for field in dataclasses.fields(Hyperparameters)]


def test_documented_columns_match_observation_space() -> None:
    page = (ROOT / "docs" / "environments" / "pacmanbot.md").read_text()
    space = make(ghosts=2, observation=("features", "scan"), settings={"power.pellets": 1}).observation_space
    bearings = {"pellet_bearings": PELLET_BEARING_COLUMNS, "ghost_bearings": GHOST_BEARING_COLUMNS}
    power = dict.fromkeys(("candidate_power", "pellet_power"), CANDIDATE_POWER_COLUMNS)
    power["ghost_power"] = GHOST_POWER_COLUMNS
    for key, columns in {**COLUMNS, **bearings, **power}.items():
        section = page.split(f"### `{key}`\n")[1].split("\n###")[0]
        rows = re.findall(r"^\| (\d+) \| `(\w+)` \| ([-\d.]+) \| ([-\d.]+) \|", section, re.MULTILINE)
        assert [(int(k), name) for k, name, _, _ in rows] == [(k, c[0]) for k, c in enumerate(columns)]
        box = space[key]
        low, high = (np.atleast_2d(bound)[0] for bound in (box.low, box.high))  # type: ignore[attr-defined]
        np.testing.assert_allclose(low, [float(row[2]) for row in rows], atol=5e-4)
        np.testing.assert_allclose(high, [float(row[3]) for row in rows], atol=5e-4)


def test_setting_provides_unit_and_description_of_field() -> None:
    shown = {setting.name: (setting.unit, setting.words) for setting in settings()}
    assert shown["robot.radius_m"] == ("m", "body (Create 3)")
    assert shown["robot.wheel_acceleration_mps2"] == ("m/s²", "Create 3")
    assert shown["localization.perfect"] == ("", "True: belief = truth at every instant")
