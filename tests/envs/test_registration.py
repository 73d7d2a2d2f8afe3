"""What importing the package does to Gymnasium, and what it does not load."""

from __future__ import annotations

import subprocess
import sys

import gymnasium as gym
import pettingzoo
import pytest

import pacman_env
from pacman_env.envs.registration import IDS
from tests.envs.helpers import ID

HAS_REGISTRY = pytest.mark.skipif(not hasattr(pettingzoo, "register"), reason="PettingZoo before 1.27 has no registry")


def test_id_refers_to_single_and_vector_environment() -> None:
    spec = gym.spec(ID)
    assert spec.entry_point == "pacman_env.envs.pacmanbot:PacManBotEnv"
    assert spec.vector_entry_point == "pacman_env.envs.pacmanbot_vector:PacManBotVectorEnv"
    assert spec.max_episode_steps is None  # the game has its own limit, in seconds


def test_registering_again_changes_nothing() -> None:
    before = gym.spec(ID)
    pacman_env.register_envs()
    assert gym.spec(ID) is before


def test_removed_registration_is_restored(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delitem(gym.registry, ID)
    pacman_env.register_envs()
    assert gym.spec(ID).entry_point == "pacman_env.envs.pacmanbot:PacManBotEnv"


def test_package_import_loads_no_simulator() -> None:
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


def test_gymnasium_finds_id_by_module() -> None:
    code = f"import gymnasium; print(gymnasium.make('pacman_env:{ID}').spec.id)"
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert out.stdout.strip() == ID


@pytest.mark.parametrize("first", ["pacman_env", "pettingzoo"])
def test_pettingzoo_registers_names_in_any_import_order(first: str) -> None:
    second = {"pacman_env": "pettingzoo", "pettingzoo": "pacman_env"}[first]
    names = sorted(name for name, entry in IDS.items() if entry.several is not None)
    code = (
        f"import {first}, {second}; known = getattr(pettingzoo, 'parallel_registry', None);"
        f"print(known is None or sorted(n for n in known if n.startswith('pacman_env')) == {names})"
    )
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert out.stdout.strip() == "True"


def test_environments_are_made_without_warnings() -> None:
    code = f"import gymnasium, pacman_env\nfor name in {list(IDS)}: gymnasium.make(name)"
    done = subprocess.run([sys.executable, "-W", "error", "-c", code], capture_output=True, text=True, check=True)
    assert (done.stdout, done.stderr) == ("", "")


def test_unversioned_id_makes_latest_version() -> None:
    with pytest.warns(UserWarning, match=f"latest versioned environment `{ID}`"):  # Gymnasium's word on all such ids
        env = gym.make(ID.removesuffix("-v0"), map="loop")
    assert env.spec is not None
    assert env.spec.id == ID


@pytest.mark.parametrize("library", ["gymnasium", pytest.param("pettingzoo", marks=HAS_REGISTRY)])
def test_ids_are_registered_when_library_is_imported(library: str) -> None:
    code = (
        f"import importlib.util, sys, pacman_env\nfor _ in range(2): importlib.util.find_spec({library!r})\n"
        f"import {library}, importlib\nregistry = getattr({library}, 'registry', None) or {library}.parallel_registry\n"
        f"print({ID!r} in registry, [f for f in sys.meta_path if getattr(f, '_module', '') == {library!r}])"
    )
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert out.stdout.strip() == "True []"
