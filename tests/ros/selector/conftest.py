"""What tests of the goal selector get."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from tests.ros.played_round import Played
    from tests.ros.selector_game import Game


@pytest.fixture
def game(domain: int, tmp_path: Path) -> Iterator[Game]:
    """What is around a goal selector; the test starts the node."""
    from tests.ros import session
    from tests.ros.selector_game import Game

    with session.nodes(tmp_path) as nodes:
        yield Game(nodes)


@pytest.fixture
def played(domain: int, tmp_path: Path) -> Iterator[Played]:
    """A round that has begun, with a Clyde that is no danger."""
    from pacman_env.ros.game_nodes import GAME
    from tests.ros import session
    from tests.ros.played_round import SETTINGS, Played

    with session.game(tmp_path, settings=SETTINGS, extra={GAME: {"diagnostics_rate": 5.0}}) as nodes:
        yield Played(nodes)
