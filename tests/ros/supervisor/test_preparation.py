"""What processes of their own prepare before the nodes of a game start."""

import contextlib

from pacman_env.ros.game_nodes import SELECTOR, SIMULATOR, GameSetup
from pacman_env.ros.supervisor.preparation import GHOSTS, Preparation, PreparationJob, map_mark
from tests.waiting import wait_for


def test_game_is_compiled_once_before_its_nodes() -> None:
    setup, reports = GameSetup("house", "nearest", sim=True), list[str]()
    made = (
        PreparationJob((SELECTOR,), "nearest").mark,
        PreparationJob((SIMULATOR,)).mark,
        PreparationJob((GHOSTS,)).mark,
        map_mark(setup),
    )
    for mark in made:
        assert mark is not None
        mark.unlink(missing_ok=True)
    with contextlib.closing(Preparation(setup, reports.append)) as preparation:
        assert preparation.words == f"compiling (once): {SELECTOR}, {SIMULATOR}, {GHOSTS}"
        assert not preparation.done()
        preparation.check()
        wait_for(preparation.done, "the preparation")
    assert all(mark.exists() for mark in made if mark)
    with contextlib.closing(Preparation(setup, reports.append)) as preparation:
        assert preparation.words == ""
        wait_for(preparation.done, "the check")
    assert reports == []
