"""A game that is killed at any moment, even within an event, loses no pellet, and counts all ghosts caught later."""

import json
import math
from typing import Any

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from pacman_env.config import make_config
from pacman_env.game.power import is_frightened
from tests.one_game import RobotSide

CONFIG = make_config("robot", **{"power.pellets": 2, "power.duration_s": 60.0, "power.return_s": 1.0})
PELLETS = np.array([(2.0, 0.0), (4.0, 0.0), (4.3, 0.0), (8.0, 0.0)])
POWER = (0, 3)
STOPS = [(2.0, 0.0), (4.15, 0.0), (8.0, 0.0), (6.0, 0.0)]  # at the second, two pellets are collected at once
FAR = (99.0, 99.0)


class Killed(Exception):
    pass


class SavedGame(RobotSide):
    """A game that saves itself before it shows an event, and is killed after a number of ``moments``."""

    moments = math.inf
    kept = ""

    def _hear(self, actions: list[Any]) -> None:
        if any(action.kind != "ignored" for action in actions):
            self.live_on()
            saved = self.referee.snapshot(self.now), self.executor.round.harmless_s(self.now)
            self.kept = json.dumps(saved)
            self.live_on()
        super()._hear(actions)

    def live_on(self) -> None:
        self.moments -= 1
        if self.moments < 0:
            raise Killed

    def resume(self) -> None:
        self.begin()
        referee, harmless_s = json.loads(self.kept)
        actions = self.referee.restore(referee, self.now)
        self.executor.round.restore(self.referee.taken, self.referee.ghosts_caught, harmless_s, self.now)
        self._hear(actions)
        self.report()

    def drive(self, stop: int, catch: bool, moments: float = math.inf) -> None:
        """Be at a stop, where a ghost is if it is frightened and a ``catch`` is wanted."""
        self.now += 1.5
        self.moments = moments
        at = STOPS[stop]
        ghosts = [at if catch and is_frightened(ghost, self.now) else FAR for ghost in self.executor.round.ghosts]
        try:
            self.check(at, ghosts)
        except Killed:
            self.moments = math.inf
            self.resume()


@given(st.lists(st.tuples(st.integers(0, 3), st.booleans(), st.integers(0, 20)), max_size=10))
def test_killed_game_completes_with_all_pellets(events: list[tuple[int, bool, int]]) -> None:
    game = SavedGame(CONFIG, PELLETS, np.zeros((0, 2)), POWER)
    for event in [*events, *((stop, False, 99) for stop in range(3))]:
        if game.referee.state == "running":
            game.drive(*event)
        if game.referee.state == "running":
            assert set(game.executor.round.left) == game.referee.left == set(range(4)) - game.referee.taken
            assert game.executor.round.record.caught == game.referee.ghosts_caught
    assert game.referee.state == "returning_home"
    assert game.referee.taken == set(range(4))
