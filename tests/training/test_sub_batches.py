"""Games in sub-batches: the same games however they are divided and stepped."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing
from functools import partial

import numpy as np
import pytest

pytest.importorskip("torch")
pytest.importorskip("sb3_contrib")

from stable_baselines3.common.monitor import Monitor

from pacman_env.sb3 import PacManBotVecEnv
from pacman_env.training.sub_batches import SubBatchedGames
from tests.envs.helpers import QUICK

SOME = partial(PacManBotVecEnv, map="house", settings=QUICK, observation=("features", "planner"))


def sub_batched(threads: int = 1) -> SubBatchedGames:
    return SubBatchedGames([SOME(count, num_threads=threads) for count in (3, 1, 2)], background=threads > 1)


@pytest.fixture
def games() -> Iterator[SubBatchedGames]:
    with closing(sub_batched(2)) as made:
        yield made


def test_games_shared_out_are_the_same_games(games: SubBatchedGames) -> None:
    """As many in one environment, in sub-batches, and in sub-batches that several threads step."""
    every = [SOME(6), sub_batched(), games]
    rng = np.random.default_rng(0)
    ended = 0
    for env in every:
        env.seed(7)
    seen = [env.reset() for env in every]
    for _ in range(60):
        for other in seen[1:]:
            assert set(other) == set(seen[0])
            assert all((other[key] == seen[0][key]).all() for key in other)  # type: ignore[call-overload, index]
        masks = [np.stack(env.env_method("action_masks")) for env in every]
        assert (masks[1] == masks[0]).all()
        assert (masks[2] == masks[0]).all()
        actions = (rng.random(masks[0].shape) * masks[0]).argmax(axis=1)
        results = [env.step(actions) for env in every]
        seen = [result[0] for result in results]
        for _, rewards, dones, infos in results[1:]:
            assert (rewards == results[0][1]).all()
            assert (dones == results[0][2]).all()
            for info, same in zip(infos, results[0][3], strict=True):
                assert {k: v for k, v in info.items() if k not in ("episode", "terminal_observation")} == {
                    k: v for k, v in same.items() if k not in ("episode", "terminal_observation")
                }
                assert info.get("episode", {}).get("r") == same.get("episode", {}).get("r")
        ended += int(results[0][2].sum())
    assert ended > 0
    for env in every:
        env.close()


def test_groups_are_stepped_one_while_another_is_chosen_for(games: SubBatchedGames) -> None:
    """The same games as when all are stepped at once; what is sent first need not be received first."""
    together = sub_batched()
    assert games.groups == [slice(0, 3), slice(3, 6)]
    rng = np.random.default_rng(0)
    for env in (together, games):
        env.seed(7)
        env.reset()
    for step in range(40):
        actions = rng.integers(together.action_space.n, size=6)  # type: ignore[attr-defined]
        expected = together.step(actions)
        for k, rows in enumerate(games.groups):
            games.send(k, actions[rows])
        for k in rng.permutation(2):
            rows = games.groups[k]
            observations, rewards, dones, infos = games.receive(k)
            assert all((observations[key] == expected[0][key][rows]).all() for key in expected[0])  # type: ignore[index]
            assert (rewards == expected[1][rows]).all()
            assert (dones == expected[2][rows]).all()
            assert [info["outcome"] for info in infos] == [info["outcome"] for info in expected[3][rows]], step


def test_a_rule_says_what_it_would_choose_in_every_game(games: SubBatchedGames) -> None:
    whole = SubBatchedGames([SOME(6)])
    for env in (games, whole):
        env.seed(3)
        env.reset()
    for _ in range(10):
        choices = games.choices("lookahead")
        assert (choices == whole.choices("lookahead")).all()
        games.step(choices)
        whole.step(choices)
    assert choices.shape == (6,)


def test_what_games_share_is_asked_of_them_and_nothing_is_changed() -> None:
    games = sub_batched()
    assert games.get_attr("render_mode") == [None] * 6
    assert games.get_attr("config", [1, 5]) == [games.games[0].env.config] * 2
    assert games.env_is_wrapped(Monitor, [0, 1]) == [True, True]
    with pytest.raises(AttributeError, match="cannot be changed"):
        games.set_attr("render_mode", "rgb_array")
    with pytest.raises(AttributeError, match="no method 'render'"):
        games.env_method("render")


def test_sub_batches_that_do_not_fit_are_refused() -> None:
    with pytest.raises(ValueError, match="no games"):
        SubBatchedGames([])
    with pytest.raises(ValueError, match="must be as many in each"):
        SubBatchedGames([SOME(1), PacManBotVecEnv(1, map="maze")])


@pytest.mark.parametrize("threads", [1, 2])
def test_what_fails_in_a_step_is_told_and_the_games_go_on(threads: int) -> None:
    games = sub_batched(threads)
    games.reset()
    games.send(0, np.full(3, 99))
    with pytest.raises(ValueError, match="choice 99 of game 0"):
        games.receive(0)
    with pytest.raises(RuntimeError, match="no actions were sent"):
        games.receive(0)
    assert games.step(np.zeros(6, dtype=np.int64))[1].shape == (6,)
    games.close()
