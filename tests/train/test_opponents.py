"""Who plays Clyde: the rules of his seat do what they are named after, and the pool gives each round its player."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("sb3_contrib")
pytest.importorskip("onnx")

from hypothesis import given
from hypothesis import strategies as st

from pacman_env.config import ConfigError
from pacman_env.envs.arguments import EnvArguments, Ghosts
from pacman_env.envs.core import EnvCore
from pacman_env.game.execution import DEAD, RUNNING
from pacman_env.policies.base import BasePolicy, Policy
from pacman_env.policies.registry import make_policy
from pacman_env.sim.observation.situation import HOLD, Situation
from tests.train.planners import random_planner
from train.arguments import FOLDER, Arguments, load_hyperparameters
from train.opponents import Arcade, Chase, Opponents, Table, Wander, completed_against, make_pool, robustness

GAMES = 16
ARGUMENTS = Arguments(hyper=load_hyperparameters(FOLDER / "PacManBot-v0.yaml", "headline"))
SEEDS = np.random.default_rng(0).integers(2**63, size=20_000, dtype=np.uint64)


def game(ghosts: Ghosts, games: int = GAMES) -> EnvCore:
    """Rounds in a few houses, begun."""
    result = EnvCore(games, EnvArguments("generated", ghosts=ghosts, start_level=0, num_levels=4))
    result.reset(np.arange(games), SEEDS[:games])
    return result


def hold(played: EnvCore, ticks: int) -> None:
    """The robot stands still."""
    for _ in range(ticks):
        played.step(np.full(played.batch.n, played.batch.hold))


def from_clydes_seat(ticks: int) -> Situation:
    """What Clyde sees after wandering for a while."""
    played = game(Wander())
    hold(played, ticks)
    return played.batch.situation(0)


def test_wandering_in_the_seat_is_the_original_clyde() -> None:
    original, seat = game("wander"), game(make_pool([], wander=1.0))
    for _ in range(100):
        hold(original, 1)
        hold(seat, 1)
        for name in ("x", "y", "vx", "vy"):
            np.testing.assert_array_equal(original.batch.ghosts[name], seat.batch.ghosts[name])


def test_the_chaser_comes_to_a_robot_that_stands_still() -> None:
    caught = {}
    for clyde in (Chase(), Wander()):
        played = game(clyde)
        played.batch.ghosts["speed"] = 0.5
        hold(played, 90)
        caught[clyde.name] = int((played.batch.games["end"] == DEAD).sum())
    assert caught["chase"] == GAMES
    assert caught["wander"] < GAMES // 2


def test_the_arcades_clyde_chases_from_afar_and_turns_to_his_corner_when_near() -> None:
    played = game(Wander(), 64)
    near = far = 0
    for _ in range(8):
        hold(played, 10)
        seen = played.batch.situation(0)
        distance = np.linalg.norm(seen.robot[:, :2] - seen.clyde, axis=1)
        chosen, chased = Arcade(2.0).select(seen), Chase().select(seen)
        np.testing.assert_array_equal(chosen[distance > 2.0], chased[distance > 2.0])
        far += int((distance > 2.0).sum())
        for i in np.flatnonzero(distance <= 2.0).tolist():
            places = seen.position[i, seen.mask[i] & (seen.kind[i] != HOLD)]
            corner = places.min(axis=0)
            there = seen.position[i, chosen[i]]
            assert np.linalg.norm(there - corner) == np.linalg.norm(places - corner, axis=1).min()
            near += 1
    assert min(near, far) > 20


def test_rules_choose_what_is_allowed_wherever_clyde_is() -> None:
    seen = from_clydes_seat(30)
    for clyde in (Chase(), Arcade(), Wander()):
        chosen = clyde.select(seen)
        assert seen.mask[np.arange(GAMES), chosen].all()
        assert clyde.select(seen.rows(np.array([3])))[0] == chosen[3]


def test_a_clyde_with_no_place_to_go_wanders_on() -> None:
    seen = from_clydes_seat(5)
    seen.mask[:] = seen.kind == HOLD
    for clyde in (Chase(), Arcade(100.0), Arcade(0.01)):
        assert (seen.kind[np.arange(GAMES), clyde.select(seen)] == HOLD).all()


@given(st.lists(st.floats(0.0, 1e6), min_size=1, max_size=6).filter(lambda shares: sum(shares) > 1.0))
def test_who_has_no_share_never_plays(shares: list[float]) -> None:
    numbers = Opponents([Wander()] * len(shares), shares).drawn(SEEDS[:500])
    assert (np.array(shares)[numbers] > 0).all()


def test_everyone_plays_his_share() -> None:
    pool = make_pool([Wander(), Wander()], wander=0.4)
    counts = np.bincount(pool.drawn(SEEDS), minlength=5) / len(SEEDS)
    np.testing.assert_allclose(counts, [0.4, 0.15, 0.15, 0.15, 0.15], atol=0.015)


class Named(BasePolicy):
    """Scores everything with its own number."""

    def __init__(self, number: int) -> None:
        self.name, self.number = str(number), number

    def scores(self, situation: Situation) -> np.ndarray:
        return np.full(situation.mask.shape, float(self.number))


def test_each_game_has_one_player_by_its_seed_alone() -> None:
    pool = Opponents([Named(k) for k in range(4)], [1, 2, 3, 4])
    played = game(Wander())
    before = pool.scores(played.batch.situation(0))
    np.testing.assert_array_equal(before[:, 0], pool.drawn(played.batch.games["seed"]))
    assert len(set(before[:, 0])) == 4
    hold(played, 20)
    seen = played.batch.situation(0)
    np.testing.assert_array_equal(pool.scores(seen), before)
    order = np.random.default_rng(1).permutation(GAMES)
    np.testing.assert_array_equal(pool.scores(seen.rows(order)), before[order])


def test_a_learned_clyde_plays_in_a_pool_as_he_plays_alone(tmp_path: Path) -> None:
    learned = make_policy(str(random_planner(tmp_path)))
    pool = Opponents([Wander(), learned], [1, 1])
    seen = from_clydes_seat(10)
    his = pool.drawn(seen.seed) == 1
    assert 0 < his.sum() < GAMES
    np.testing.assert_array_equal(pool.scores(seen)[his], learned.scores(seen)[his])


def test_a_learned_clyde_from_a_file_is_obeyed_in_a_ghosts_seat(tmp_path: Path) -> None:
    learned = make_policy(str(random_planner(tmp_path)))
    played = game(learned)
    for _ in range(20):
        running = played.batch.games["end"] == RUNNING
        chosen = learned.select(played.batch.situation(0))
        hold(played, 1)
        told = np.where(chosen == played.batch.hold, -1, chosen)
        np.testing.assert_array_equal(played.batch.ghosts["place"][running, 0], told[running])
    assert len(np.unique(told)) > 1


@pytest.mark.parametrize(
    ("members", "shares", "words"),
    [
        ([], [], "0 members and 0 shares"),
        ([Wander()], [0.5, 0.5], "1 members and 2 shares"),
        ([Wander(), Chase()], [1.0, -0.1], "must be at least 0"),
        ([Wander()], [0.0], "one of them above"),
        ([Wander()], [float("nan")], "must be at least 0"),
    ],
)
def test_a_pool_that_cannot_be_drawn_from_is_refused(members: list[Policy], shares: list[float], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        Opponents(members, shares)


def test_the_same_rounds_whoever_plays_and_however_many() -> None:
    many = completed_against(make_policy("nearest"), "wander", ARGUMENTS, 12)
    few = completed_against(make_policy("nearest"), Wander(), ARGUMENTS, 6)
    np.testing.assert_array_equal(many[:6], few)
    assert 0 < many.sum() < 12


def test_a_chaser_is_harder_than_a_wanderer() -> None:
    chased, wandered = (completed_against(make_policy("nearest"), c, ARGUMENTS, 12).sum() for c in (Chase(), "wander"))
    assert chased < wandered


def test_an_unknown_behaviour_is_refused() -> None:
    with pytest.raises(ConfigError, match="inky"):
        completed_against(make_policy("nearest"), "inky", ARGUMENTS, 2)


def test_the_table_plays_each_pair_once_and_leaves_the_others_empty() -> None:
    table = Table(ARGUMENTS, 4)
    table.play("nearest", ["wander"])
    first = table.completed["nearest"]["wander"]
    table.play("nearest", ["wander"])
    table.play("random", ["chase"])
    assert table.completed["nearest"]["wander"] is first
    assert table.shares()["nearest"] == {"wander": first.mean()}
    lines = table.render().splitlines()
    assert lines[0] == "| completed of 4 | wander | chase |"
    assert lines[2].startswith(f"| nearest | {first.mean():.1%} [")
    assert lines[2].endswith("|  |")
    assert lines[3].startswith("| random |  |")


def test_robustness_has_the_planner_the_rules_and_the_learned_clyde(tmp_path: Path) -> None:
    planner, clyde = random_planner(tmp_path, "planner", 1), random_planner(tmp_path, "clyde", 2)
    shares = robustness(planner, clyde, ARGUMENTS, 1).shares()
    assert list(shares) == ["planner", "lookahead", "clyde_aware"]
    assert all(list(row) == ["wander", "arcade", "chase", "clyde"] for row in shares.values())
