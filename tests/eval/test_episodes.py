from __future__ import annotations

import numpy as np
import pytest

from eval.episodes import allowed, episode_seeds
from pacman_env.sim.assets import map_assets
from pacman_env.sim.batch import GameBatch
from pacman_env.sim.records import CLEARED, COMPLETE, DEAD, RUNNING, TIMEOUT
from tests.eval.helpers import CONFIG, played


def test_round_seeds_do_not_depend_on_how_many_there_are() -> None:
    np.testing.assert_array_equal(episode_seeds(3, 50)[:7], episode_seeds(3, 7))
    assert episode_seeds(3, 7).dtype == np.uint64


def test_round_seeds_are_all_different() -> None:
    seeds = np.concatenate([episode_seeds(seed, 100) for seed in range(5)])
    assert len(np.unique(seeds)) == 500


def test_a_negative_seed_is_refused() -> None:
    with pytest.raises(ValueError, match="seed = -1"):
        episode_seeds(-1, 2)


@pytest.mark.parametrize("policy", ["clyde_aware", "random"])
@pytest.mark.parametrize("batch_size", [1, 5])
def test_the_batch_a_round_is_played_in_does_not_matter(policy: str, batch_size: int) -> None:
    np.testing.assert_array_equal(played(policy)[0], played(policy, batch_size=batch_size)[0])


def test_fewer_rounds_are_the_first_of_more() -> None:
    np.testing.assert_array_equal(played("nearest", 5)[0], played("nearest")[0][:5])


def test_the_same_rounds_twice_give_the_same_records() -> None:
    again = played.__wrapped__("clyde_aware")
    np.testing.assert_array_equal(played("clyde_aware")[0], again[0])


def test_records_tell_how_rounds_went() -> None:
    records = played("nearest")[0]
    np.testing.assert_array_equal(records["seed"], episode_seeds(5, 12))
    assert set(records["end"]) <= {DEAD, COMPLETE, CLEARED, TIMEOUT}
    assert len(set(records["end"])) > 1
    assert (records["spawned"] == map_assets("house", CONFIG).pellets).all()
    assert (records["collected"] + records["lost"] <= records["spawned"]).all()
    np.testing.assert_array_equal(records["end"] == COMPLETE, records["collected"] == records["spawned"])
    np.testing.assert_array_equal(records["end"] == TIMEOUT, records["time_s"] == CONFIG.time_limit_s)
    assert (records["time_s"] > 0).all()


def test_single_decisions_are_timed_on_a_sample() -> None:
    _, times = played("clyde_aware")
    assert len(times) >= 10
    assert (times > 0).all()


def test_the_record_is_that_of_the_game_played_alone_by_hand() -> None:
    from pacman_env.policies.registry import make_policy

    batch, policy = GameBatch(map_assets("house", CONFIG), CONFIG, 1), make_policy("nearest")
    batch.reset(np.arange(1), episode_seeds(5, 3)[2:])
    policy.reset(np.ones(1, np.bool_))
    while batch.games["end"][0] == RUNNING:
        batch.step(policy.select(batch.situation()))
    record = played("nearest")[0][2]
    assert record["end"] == batch.games["end"][0]
    assert record["collected"] == batch.games["collected"][0]
    assert record["time_s"] == pytest.approx(batch.games["tick"][0] * CONFIG.execution.tick_s)


def test_a_choice_that_is_forbidden_becomes_hold() -> None:
    batch = GameBatch(map_assets("house", CONFIG), CONFIG, 5)
    batch.reset(np.arange(5), np.arange(5, dtype=np.uint64))
    batch.alive[0, 2] = False
    choices = np.array([2, 2, batch.candidates, -1, batch.hold])
    taken = allowed(batch.situation(), choices, batch.hold)
    assert taken.tolist() == [batch.hold, 2, batch.hold, batch.hold, batch.hold]
