"""What tests of the simulated robot's node get."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from tests.ros.simulated_robot.driven import Robot


@pytest.fixture
def make_robot(domain: int, tmp_path: Path) -> Iterator[Callable[..., Robot]]:
    """Makes the node in the two rooms with the parameters given; it gives the time."""
    from tests.ros import session
    from tests.ros.simulated_robot.driven import Robot

    with ExitStack() as stack:

        def make(**parameters: object) -> Robot:
            robot = stack.enter_context(session.nodes(tmp_path, session=Robot))
            robot.begin(**parameters)
            return robot

        yield make


@pytest.fixture
def robot(make_robot: Callable[..., Robot]) -> Robot:
    """The node without further parameters."""
    return make_robot()
