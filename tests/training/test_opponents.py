"""Who plays Clyde: the rules of his seat do what they are named after, and the pool gives each round its player."""

import numpy as np
import pytest

pytest.importorskip("sb3_contrib")
pytest.importorskip("onnx")

from hypothesis import given
from hypothesis import strategies as st

from pacman_env.envs.arguments import EnvArguments, Ghosts
from pacman_env.envs.game_runner import GameRunner
from pacman_env.observations.situation import Situation
from pacman_env.observations.situation_writer import situation_of
from pacman_env.policies.base import BasePolicy, Policy
from pacman_env.policies.opponents import BehaviourOpponent, Opponents
from pacman_env.training.arguments import FOLDER, Arguments, load_hyperparameters
from pacman_env.training.held_out import HeldOut
from pacman_env.training.lineups import LEARNED

GAMES = 16
ARGUMENTS = Arguments(hyper=load_hyperparameters(FOLDER / "PacManBot-v2.yaml", "headline"))
SEEDS = np.random.default_rng(0).integers(2**63, size=20_000, dtype=np.uint64)


def game(ghosts: Ghosts, games: int = GAMES) -> GameRunner:
    """Rounds in a few houses, begun."""
    result = GameRunner(games, EnvArguments("generated", ghosts=ghosts, settings={"start_level": 0, "num_levels": 4}))
    result.reset(np.arange(games), SEEDS[:games])
    return result


def hold(played: GameRunner, ticks: int) -> None:
    """The robot stands still."""
    for _ in range(ticks):
        played.step(np.full(played.batch.n, played.batch.hold))


@pytest.mark.parametrize("name", ["wander", "chase", "arcade"])
def test_behaviour_opponent_moves_like_ghost_of_environment(name: str) -> None:
    original, opponent = game(name), game(BehaviourOpponent(name))
    for _ in range(100):
        hold(original, 1)
        hold(opponent, 1)
        for field in ("x", "y", "vx", "vy"):
            np.testing.assert_array_equal(original.batch.ghosts[field], opponent.batch.ghosts[field])


@given(st.lists(st.floats(0.0, 1e6), min_size=1, max_size=6).filter(lambda shares: sum(shares) > 1.0))
def test_opponent_without_share_never_plays(shares: list[float]) -> None:
    numbers = Opponents([BehaviourOpponent("wander")] * len(shares), shares).drawn(SEEDS[:500])
    assert (np.array(shares)[numbers] > 0).all()


def test_opponents_play_in_proportion_to_their_shares() -> None:
    pool = Opponents([BehaviourOpponent("wander")] * 5, [0.4, 0.15, 0.15, 0.15, 0.15])
    counts = np.bincount(pool.drawn(SEEDS), minlength=5) / len(SEEDS)
    np.testing.assert_allclose(counts, [0.4, 0.15, 0.15, 0.15, 0.15], atol=0.015)


class Named(BasePolicy):
    """Chooses its own number."""

    def __init__(self, number: int) -> None:
        self.name, self.number = str(number), number

    def select(self, situation: Situation) -> np.ndarray:
        return np.full(len(situation.mask), self.number)


def test_opponent_of_game_depends_on_seed_alone() -> None:
    pool = Opponents([Named(k) for k in range(4)], [1, 2, 3, 4])
    played = game(BehaviourOpponent("wander"))
    before = pool.select(situation_of(played.batch, 0))
    np.testing.assert_array_equal(before["value"], pool.drawn(played.batch.games["seed"]))
    assert len(set(before.tolist())) == 4
    hold(played, 20)
    seen = situation_of(played.batch, 0)
    np.testing.assert_array_equal(pool.select(seen), before)
    order = np.random.default_rng(1).permutation(GAMES)
    np.testing.assert_array_equal(pool.select(seen.rows(order)), before[order])


@pytest.mark.parametrize(
    ("members", "shares", "words"),
    [
        ([], [], "0 members and 0 shares"),
        ([BehaviourOpponent("wander")], [0.5, 0.5], "1 members and 2 shares"),
        ([BehaviourOpponent("wander"), BehaviourOpponent("chase")], [1.0, -0.1], "must be at least 0"),
        ([BehaviourOpponent("wander")], [0.0], "one of them above"),
        ([BehaviourOpponent("wander")], [float("nan")], "must be at least 0"),
    ],
)
def test_invalid_pool_is_refused(members: list[Policy], shares: list[float], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        Opponents(members, shares)


def test_rounds_do_not_depend_on_number_of_rounds() -> None:
    many = HeldOut(ARGUMENTS, 12, ghosts=("wander",)).completed("nearest")
    few = HeldOut(ARGUMENTS, 6, ghosts=(LEARNED,)).completed("nearest", BehaviourOpponent("wander"))
    np.testing.assert_array_equal(many[:6], few)
    assert 0 < many.sum() < 12
