"""What tests of single nodes get."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from tests.ros.session import Session


@pytest.fixture
def nodes(domain: int, tmp_path: Path) -> Iterator[Session]:
    """A lock-step session, to which the test adds the node."""
    from tests.ros import session

    with session.nodes(tmp_path) as nodes:
        yield nodes
