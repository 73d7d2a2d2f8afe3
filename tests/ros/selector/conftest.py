"""What tests of the goal selector get."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from tests.ros.selector_game import Game


@pytest.fixture
def game(domain: int, tmp_path: Path) -> Iterator[Game]:
    """What is around a goal selector, in lock-step; the test starts the node."""
    from tests.ros import session
    from tests.ros.selector_game import Game

    with session.nodes(tmp_path) as nodes:
        yield Game(nodes)
