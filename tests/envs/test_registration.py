"""What importing the package does to Gymnasium, and what it does not load."""

from __future__ import annotations

import subprocess
import sys

import gymnasium as gym
import pytest

import pacman_env
from pacman_env.envs.registration import LEARNERS_ID
from tests.envs.helpers import ID


def test_importing_registers_both_environments_under_one_id() -> None:
    spec = gym.spec(ID)
    assert spec.entry_point == "pacman_env.envs.pacmanbot:PacManBotEnv"
    assert spec.vector_entry_point == "pacman_env.envs.pacmanbot_vector:PacManBotVectorEnv"
    assert spec.max_episode_steps is None  # the game has its own limit, in seconds


def test_registering_again_changes_nothing() -> None:
    before = gym.spec(ID)
    pacman_env.register_envs()
    assert gym.spec(ID) is before


def test_a_removed_registration_comes_back(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delitem(gym.registry, ID)
    pacman_env.register_envs()
    assert gym.spec(ID).entry_point == "pacman_env.envs.pacmanbot:PacManBotEnv"


def test_importing_loads_no_simulator() -> None:
    heavy = {
        "gymnasium",
        "numba",
        "pymunk",
        "cv2",
        "pygame",
        "torch",
        "matplotlib",
        "pacman_env.sim",
        "pacman_env.world",
    }
    code = f"import sys, pacman_env; print(sorted({heavy} & set(sys.modules)))"
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert out.stdout.strip() == "[]"


def test_gymnasium_finds_the_id_by_module() -> None:
    code = f"import gymnasium; print(gymnasium.make('pacman_env:{ID}').spec.id)"
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert out.stdout.strip() == ID


@pytest.mark.parametrize("first", ["pacman_env", "pettingzoo"])
def test_pettingzoo_knows_both_names_whichever_is_imported_first(first: str) -> None:
    second = {"pacman_env": "pettingzoo", "pettingzoo": "pacman_env"}[first]
    code = (
        f"import {first}, {second}; known = getattr(pettingzoo, 'parallel_registry', None);"
        f"print(known is None or sorted(n for n in known if n.startswith('pacman_env')) == {[ID, LEARNERS_ID]})"
    )
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert out.stdout.strip() == "True"
