from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pacman_env.config import PowerConfig, make_config
from pacman_env.game.ends import CAUGHT
from pacman_env.game.execution import CHECK, Board, Execution, rules, transition
from pacman_env.game.power import (
    AWAY_UNTIL,
    HARMLESS_UNTIL,
    choose_power_pellets,
    frightened_s,
    is_away,
    is_frightened,
    is_harmless,
)

PLACES = st.tuples(st.integers(-20, 20), st.integers(-20, 20)).map(lambda xy: (xy[0] / 2, xy[1] / 2))
PELLETS = np.array([(float(k), 0.0) for k in range(8)])
POWER = np.array([k in (2, 5) for k in range(8)])
FAR = (50.0, 50.0)


class Game:
    """One round with eight pellets in a row, two of them power pellets, and two ghosts."""

    def __init__(self, **changes: float) -> None:
        config = make_config("robot", **{"power.pellets": 2, **changes})
        self.power = config.power
        self.rules = SimpleNamespace(**rules(config, float), pellet_slots=len(PELLETS))
        self.record = Execution(0.25, frightened_s(config.power, 1), pellets=8, spawned=8)
        self.left = np.ones(8, np.bool_)
        self.ghosts = np.zeros((2, 5))
        self.now = 0.0

    def check(self, at: tuple[float, float], *ghosts: tuple[float, float], later: float = 0.0) -> None:
        self.now += later
        self.ghosts[:, :2] = [*ghosts, *[FAR] * (2 - len(ghosts))]
        board = Board(PELLETS, self.ghosts, self.left, POWER, np.zeros(9), np.zeros(9, np.int64))
        transition(self.record, CHECK, 0, at, self.now, False, board, self.rules)


@given(st.lists(PLACES, min_size=1, max_size=30, unique=True), PLACES, st.integers(0, 6))
def test_power_pellets_are_as_far_from_home_and_each_other_as_any_next_choice(
    places: list[tuple[float, float]], home: tuple[float, float], count: int
) -> None:
    position = np.array(places, float)
    chosen = np.flatnonzero(choose_power_pellets(position, home, count)).tolist()
    assert len(chosen) == min(count, len(places))
    given_places = [np.array(home)]
    while chosen:
        distance = np.min([np.hypot(*(position - place).T) for place in given_places], axis=0)
        farthest = max(chosen, key=lambda k: distance[k])
        others = [k for k in range(len(places)) if k in chosen or distance[k] > 0]
        assert distance[farthest] == max(distance[k] for k in others)
        given_places.append(position[farthest])
        chosen.remove(farthest)


@pytest.mark.parametrize(("round", "expected"), [(1, 20.0), (2, 16.7), (4, 10.1), (5, 6.8), (6, 6.6), (99, 6.6)])
def test_fright_is_shorter_in_each_round_down_to_a_least_time(round: int, expected: float) -> None:
    assert frightened_s(PowerConfig(), round) == pytest.approx(expected)


def test_frightened_ghosts_are_caught_one_after_the_other_for_doubled_points() -> None:
    game = Game()
    game.check((2.0, 0.0))
    assert (game.record.power, game.record.score) == (1, 5)
    game.check((3.0, 9.0), (3.0, 9.0), (3.1, 9.0), later=1.0)
    assert (game.record.caught, game.record.score, game.record.end) == (2, 5 + 20 + 40, 0)
    game.check((3.0, 9.0), (3.0, 9.0), later=4.0)  # it is still away
    assert (game.record.caught, game.record.end) == (2, 0)
    game.check((3.0, 9.0), (3.0, 9.0), later=1.0)  # it has started again, and is frightened no more
    assert (game.record.end, game.record.catcher) == (CAUGHT, 0)


def test_power_pellet_protects_from_the_ghost_next_to_it() -> None:
    game = Game()
    game.check((2.0, 0.0), (2.1, 0.0))
    assert (game.record.end, game.record.caught) == (0, 1)


def test_second_power_pellet_frightens_from_the_beginning_and_starts_a_new_streak() -> None:
    game = Game()
    game.check((2.0, 0.0))
    game.check((9.0, 9.0), (9.0, 9.0), later=1.0)
    game.check((5.0, 0.0), later=10.0)
    assert game.ghosts[:, HARMLESS_UNTIL].tolist() == [31.0, 31.0]
    before = game.record.score
    game.check((9.0, 9.0), FAR, (9.0, 9.0), later=1.0)
    assert game.record.score - before == 20


def test_ghost_that_is_away_is_not_frightened() -> None:
    game = Game()
    game.check((2.0, 0.0))
    game.check((9.0, 9.0), (9.0, 9.0), later=1.0)
    game.check((5.0, 0.0), later=1.0)
    assert is_away(game.ghosts[0], game.now)
    assert not is_frightened(game.ghosts[0], game.now)
    assert game.ghosts[0, HARMLESS_UNTIL] == game.ghosts[0, AWAY_UNTIL]
    assert is_frightened(game.ghosts[1], game.now)


STEPS = st.tuples(st.integers(0, 9), st.integers(0, 9), st.integers(0, 9), st.sampled_from((0.0, 0.5, 3.0, 12.0)))


@given(st.lists(STEPS, max_size=40))
def test_rules_of_power_hold_in_any_order_of_events(steps: list[tuple[int, int, int, float]]) -> None:
    game = Game()
    expected = 0
    for at, first, second, later in steps:
        places = [*PELLETS.tolist(), (3.0, 9.0), (6.0, 9.0)]
        collected, caught, power = game.record.collected, game.record.caught, game.record.power
        before = game.record.score
        over = game.record.end != 0
        was_harmless = [is_harmless(ghost, game.now + later) for ghost in game.ghosts]
        game.check(places[at], places[first], places[second], later=later)
        new_power = game.record.power - power
        for ghost in game.ghosts:
            assert not (is_away(ghost, game.now) and is_frightened(ghost, game.now))
            assert is_harmless(ghost, game.now) == (is_away(ghost, game.now) or is_frightened(ghost, game.now))
            assert ghost[HARMLESS_UNTIL] <= game.now + max(game.power.duration_s, game.power.return_s)
        if over:
            assert game.record.score == before  # nothing counts after the end
        if game.record.end == CAUGHT and not over:
            assert not was_harmless[game.record.catcher]
            assert new_power == 0
        catches = game.record.caught - caught
        streak = game.record.streak
        points = sum(20 * 2 ** min(k, 3) for k in range(streak - catches, streak))
        expected += game.record.collected - collected + 4 * new_power + points
        assert game.record.score == expected
