"""The pages that are written from the code, without Sphinx."""

import re
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

from pacman_env import OUTCOMES
from pacman_env.envs.pacmanbot import PacManBotEnv
from pacman_env.envs.registration import IDS
from tests.pages import public_names
from tools import ids


def test_reference_lists_every_public_name_once() -> None:
    pages = (Path(__file__).resolve().parents[2] / "docs" / "reference").glob("*.md")
    named = [name for page in pages for name in re.findall(r"^\.\. \S+:: pacman_env\.(\S+)", page.read_text(), re.M)]
    assert sorted(named) == sorted(public_names())


def test_flat_row_columns_match_documented_indices() -> None:
    env = PacManBotEnv(flat=True)
    text = ids.page("pacman_env/PacManBotFlat-v2", env)
    assert "| 0 to 237 | `planner_candidates` | (7, 34) |" in text
    assert "| 238 to 288 | `planner_globals` | (51,) |" in text
    assert env.observation_space.shape == (289,)
    parts = PacManBotEnv(flat=True, settings={"observation.flat": False})
    row, alone = env.reset(seed=2)[0], parts.reset(seed=2)[0]
    np.testing.assert_array_equal(row[238:], alone["planner_globals"])


@pytest.mark.parametrize("name", ["Rewards", "Episode End", "Arguments", "Version History"])
def test_docstring_sections_link_to_pages(name: str) -> None:
    section = ids.sections("pacman_env/PacManBot-v2")[name]
    assert section
    assert "`docs/" not in section


@pytest.mark.parametrize("env_id", IDS)
def test_id_page_states_how_time_limit_ends(env_id: str) -> None:
    env: Any = gym.make(env_id, settings={"time_limit_s": 5.0})
    env.reset(seed=0)
    drives = env.unwrapped.config.action == "velocity"
    ended: list[str] = []
    while not ended:
        *_, terminated, truncated, info = env.step(env.action_space.low if drives else env.action_space.n - 1)
        ended = ["termination"] * terminated + ["truncation"] * truncated
    assert info["outcome"] in ("timeout", OUTCOMES.tolist().index("timeout"))
    assert re.findall(r"time limit is a \*\*(\w+)\*\*", ids.page(env_id, env.unwrapped)) == ended


@pytest.mark.parametrize("env_id", IDS)
def test_id_page_shows_arguments_of_that_id(env_id: str) -> None:
    code = ids.sections(env_id)["Arguments"].split("```py\n")[1].split("```")[0]
    env = eval(code, {"gymnasium": gym})
    assert env.spec.id == env_id
    assert env.unwrapped.config.clyde.speed_mps == 0.35
    assert env.spec.kwargs.keys() >= IDS[env_id].kwargs.keys()
