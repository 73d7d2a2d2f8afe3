"""What tests of the simulated robot's node get."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from tests.ros.simulated import Robot


@pytest.fixture
def make_robot(domain: int, tmp_path: Path) -> Iterator[Callable[..., Robot]]:
    """Makes the node in the two rooms, in lock-step, with the parameters given."""
    from tests.ros import simulated

    with ExitStack() as stack:
        yield lambda **parameters: stack.enter_context(simulated.robot(tmp_path, **parameters))


@pytest.fixture
def robot(make_robot: Callable[..., Robot]) -> Robot:
    """The node without further parameters."""
    return make_robot()
