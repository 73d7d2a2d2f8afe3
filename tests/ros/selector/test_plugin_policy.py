"""A policy of another package, by the goal selector's parameter ``policy``."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from tests.plugin_example import install
from tests.ros.selector_game import Game


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return install(tmp_path_factory.mktemp("plugin"))


@pytest.mark.parametrize("policy", ["shy", "pacman_plugin.policy:Shy"])
def test_goal_selector_plays_policy_of_installed_package(
    game: Game, policy: str, site: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(site)
    for name in [name for name in sys.modules if name.partition(".")[0] == "pacman_plugin"]:
        monkeypatch.delitem(sys.modules, name)
    game.start(policy=policy)
    game.begin()
    game.running_goal(1)
    assert game.condition(lambda c: c["policy"] == policy)
