"""Games in parts over processes: the same games whoever steps them, and a worker's troubles are told."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from contextlib import closing
from functools import partial

import numpy as np
import pytest

pytest.importorskip("torch")
pytest.importorskip("sb3_contrib")

from stable_baselines3.common.monitor import Monitor

from pacman_env.envs.sb3_vec_env import PacManBotVecEnv
from tests.envs.helpers import QUICK
from train.game_workers import ParallelGames, Worker

SOME = partial(PacManBotVecEnv, map="house", settings=QUICK, observation=("features", "planner"))
PARTS = [partial(SOME, 3), partial(SOME, 1), partial(SOME, 2)]


@pytest.fixture(scope="module")
def worker() -> Iterator[Worker]:
    with closing(Worker()) as process:
        yield process


def test_games_shared_out_are_the_same_games(worker: Worker) -> None:
    """As many in one environment, in parts, and in parts of which a worker steps some."""
    games = [SOME(6), ParallelGames(PARTS), ParallelGames(PARTS, [worker])]
    rng = np.random.default_rng(0)
    ended = 0
    for env in games:
        env.seed(7)
    seen = [env.reset() for env in games]
    for _ in range(60):
        for other in seen[1:]:
            assert set(other) == set(seen[0])
            assert all((other[key] == seen[0][key]).all() for key in other)  # type: ignore[call-overload, index]
        masks = [np.stack(env.env_method("action_masks")) for env in games]
        assert (masks[1] == masks[0]).all()
        assert (masks[2] == masks[0]).all()
        actions = (rng.random(masks[0].shape) * masks[0]).argmax(axis=1)
        results = [env.step(actions) for env in games]
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
    for env in games:
        env.close()


def test_a_rule_says_what_it_would_choose_in_every_game(worker: Worker) -> None:
    games = ParallelGames(PARTS, [worker])
    whole = ParallelGames([partial(SOME, 6)])
    for env in (games, whole):
        env.seed(3)
        env.reset()
    for _ in range(10):
        choices = games.choices("lookahead")
        assert (choices == whole.choices("lookahead")).all()
        games.step(choices)
        whole.step(choices)
    assert choices.shape == (6,)


def test_a_worker_is_given_other_games(worker: Worker) -> None:
    for count in (1, 4):
        games = ParallelGames([partial(SOME, 1), partial(SOME, count)], [worker])
        games.reset()
        assert games.num_envs == 1 + count
        games.close()


def test_more_workers_than_parts_are_left_alone(worker: Worker) -> None:
    games = ParallelGames([partial(SOME, 2)], [worker])
    assert games.reset()["action_mask"].shape[0] == 2


def test_what_games_share_is_asked_of_them_and_nothing_is_changed() -> None:
    games = ParallelGames(PARTS)
    assert games.get_attr("render_mode") == [None] * 6
    assert games.get_attr("config", [1, 5]) == [games.here.parts[0].games.env.config] * 2
    assert games.env_is_wrapped(Monitor, [0, 1]) == [True, True]
    with pytest.raises(AttributeError, match="cannot be changed"):
        games.set_attr("render_mode", "rgb_array")
    with pytest.raises(AttributeError, match="no method 'render'"):
        games.env_method("render")


def test_parts_that_do_not_fit_are_refused() -> None:
    with pytest.raises(ValueError, match="no games"):
        ParallelGames([])
    with pytest.raises(ValueError, match="must be as many in each"):
        ParallelGames([partial(SOME, 1), partial(PacManBotVecEnv, 1, map="maze")])


def test_what_fails_in_a_worker_is_told_with_its_place_and_it_goes_on(worker: Worker) -> None:
    games = ParallelGames([partial(SOME, 1), partial(SOME, 1)], [worker])
    games.reset()
    worker.send("choices", [("no policy of this name",)])
    with pytest.raises(RuntimeError, match=r"in a worker:(.|\n)*game_workers\.py(.|\n)*no policy of this name"):
        worker.receive()
    assert games.step(np.zeros(2, dtype=np.int64))[1].shape == (2,)


def test_a_worker_that_is_gone_is_an_error_and_not_a_wait() -> None:
    with closing(Worker()) as lost:
        games = ParallelGames([partial(SOME, 1), partial(SOME, 1)], [lost])
        games.reset()
        assert lost.pid is not None
        os.kill(lost.pid, signal.SIGKILL)
        with pytest.raises(RuntimeError, match="a worker has ended with exit status -9"):
            games.step(np.zeros(2, dtype=np.int64))


def test_a_worker_ends_when_it_is_closed() -> None:
    process = Worker()
    process.close()
    assert process.exitcode == 0
