"""What importing the package does to Gymnasium, and what it does not load."""

import subprocess
import sys

import gymnasium as gym
import pettingzoo
import pytest

import pacman_env
from pacman_env.envs.registration import IDS
from tests.envs.helpers import ID

HAS_REGISTRY = pytest.mark.skipif(not hasattr(pettingzoo, "register"), reason="PettingZoo before 1.27 has no registry")


def test_registering_again_changes_nothing() -> None:
    before = gym.spec(ID)
    pacman_env.register_envs()
    assert gym.spec(ID) is before


def test_removed_registration_is_restored(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delitem(gym.registry, ID)
    pacman_env.register_envs()
    assert gym.spec(ID).entry_point == "pacman_env.envs.pacmanbot:PacManBotEnv"


def test_gymnasium_finds_id_by_module() -> None:
    code = f"import gymnasium; print(gymnasium.make('pacman_env:{ID}').spec.id)"
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert out.stdout.strip() == ID


@pytest.mark.parametrize("library", ["gymnasium", pytest.param("pettingzoo", marks=HAS_REGISTRY)])
@pytest.mark.parametrize("first", ["pacman_env", "library"])
def test_ids_are_registered_in_any_import_order(library: str, first: str) -> None:
    names = sorted(name for name, entry in IDS.items() if library == "gymnasium" or entry.several is not None)
    imports = ("pacman_env", library) if first == "pacman_env" else (library, "pacman_env")
    code = (
        f"import sys, importlib.util, {imports[0]}\nfor _ in range(2): importlib.util.find_spec({library!r})\n"
        f"import {imports[1]}\nregistry = getattr({library}, 'registry', None) or {library}.parallel_registry\n"
        f"print(sorted(name for name in registry if name.startswith('pacman_env')) == {names},"
        f" [f for f in sys.meta_path if getattr(f, '_module', '') == {library!r}])"
    )
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert out.stdout.strip() == "True []"
