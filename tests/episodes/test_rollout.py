from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from pacman_env.config import Config
from pacman_env.episodes.rollout import MOST_ROUNDS, allowed, episode_seeds, play, play_in
from pacman_env.evaluation.rounds.scenarios import Levels, open_scenario
from pacman_env.game.execution import CLEARED, COMPLETE, DEAD, RUNNING, TIMEOUT
from pacman_env.heuristics.simple import Nearest
from pacman_env.policies import registry
from pacman_env.sim.core.batch import GameBatch
from pacman_env.sim.maps.assets import map_assets
from pacman_env.sim.observation.situation import Situation
from tests.evaluation.helpers import CONFIG, ENDLESS, LEVELS, LEVELS_CONFIG, played, played_endless, played_on_levels


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
    policy.reset(np.ones(1, np.bool_), CONFIG)
    while batch.games["end"][0] == RUNNING:
        batch.step(policy.select(batch.situation()))
    record = played("nearest")[0][2]
    assert record["end"] == batch.games["end"][0]
    assert record["collected"] == batch.games["collected"][0]
    assert record["time_s"] == pytest.approx(batch.games["step"][0] * CONFIG.physics_step_s)


@pytest.mark.parametrize("threads", [1, 2])
def test_games_that_are_there_already_play_the_same_rounds_again(threads: int) -> None:
    source = open_scenario(Levels("test", count=7), LEVELS_CONFIG)
    seeds = episode_seeds(5, 8)
    expected = play(source, LEVELS_CONFIG, "clyde_aware", seeds)[0]
    batch = GameBatch(source, LEVELS_CONFIG, 4, threads)
    play_in(batch, "nearest", seeds)
    records, times = play_in(batch, "clyde_aware", seeds, timed=False)
    np.testing.assert_array_equal(records, expected)
    assert len(times) == 0
    with pytest.raises(ValueError, match="4 games for 3 seeds"):
        play_in(batch, "nearest", seeds[:3])


def test_ghosts_that_policies_move_play_as_in_existing_games() -> None:
    seeds = episode_seeds(5, 6)
    config = CONFIG.with_fields(**{"clyde.ghosts": ("wander", "nearest"), "clyde.speed_mps": 0.4})
    source = map_assets("house", CONFIG.with_fields(**{"clyde.ghosts": ("policy",)}))
    expected = play(source, config, "clyde_aware", seeds)[0]
    batch = GameBatch(source, config.with_fields(**{"clyde.ghosts": ("wander", "policy")}), 3)
    found = play_in(batch, "clyde_aware", seeds, ghosts={1: Nearest()})[0]
    np.testing.assert_array_equal(found, expected)
    alone = play(source, config.with_fields(**{"clyde.ghosts": ("wander", "wander")}), "clyde_aware", seeds)[0]
    assert (alone["time_s"] != found["time_s"]).any()


def test_a_choice_that_is_forbidden_becomes_hold() -> None:
    batch = GameBatch(map_assets("house", CONFIG), CONFIG, 5)
    batch.reset(np.arange(5), np.arange(5, dtype=np.uint64))
    batch.alive[0, 2] = False
    choices = np.array([2, 2, batch.candidates, -1, batch.hold])
    taken = allowed(batch.situation(), choices, batch.hold)
    assert taken.tolist() == [batch.hold, 2, batch.hold, batch.hold, batch.hold]


@pytest.mark.parametrize("batch_size", [1, 3])
def test_a_round_on_a_level_does_not_depend_on_the_batch(batch_size: int) -> None:
    records = played_on_levels("lookahead")
    np.testing.assert_array_equal(records, played_on_levels("lookahead", batch_size))
    np.testing.assert_array_equal(records["level"], open_scenario(LEVELS, LEVELS_CONFIG).levels_of(episode_seeds(5, 8)))
    assert len(set(records["level"])) == 2


@pytest.mark.parametrize("batch_size", [1, 3])
def test_an_endless_game_does_not_depend_on_the_batch(batch_size: int) -> None:
    np.testing.assert_array_equal(played_endless("clyde_aware"), played_endless("clyde_aware", batch_size))


def test_an_endless_game_counts_pellets_rounds_and_time_of_all_rounds() -> None:
    records = played_endless("nearest")
    np.testing.assert_array_equal(records["seed"], episode_seeds(5, 8))
    rounds, spawned = records["rounds"], records["spawned"]
    assert rounds.max() > 1
    assert (records["collected"] >= rounds * spawned).all()
    assert (records["collected"] < (rounds + 1) * spawned).all()
    assert set(records["end"]) <= {DEAD, CLEARED, TIMEOUT}


def test_the_record_of_an_endless_game_is_that_of_the_game_played_alone_by_hand() -> None:
    record = played_endless("nearest")[0]
    batch, policy = GameBatch(map_assets("house", ENDLESS), ENDLESS, 1), registry.make_policy("nearest")
    batch.reset(np.arange(1), episode_seeds(5, 1))
    ticks = 0
    while batch.games["end"][0] == RUNNING:
        batch.step(policy.select(batch.situation()))
        ticks += 1
    assert record["collected"] == batch.games["score"][0]
    assert record["rounds"] == batch.games["round"][0] - 1
    assert record["time_s"] == pytest.approx(ticks * ENDLESS.execution.tick_s)


def test_an_endless_game_that_nobody_ends_stops_after_so_many_rounds() -> None:
    config = ENDLESS.with_fields(
        **{"execution.pickup_radius_m": 50.0, "clyde.speed_mps": 0.0, "clyde.speed_step_mps": 0.0}
    )
    records, _ = play(map_assets("house", config), config, "nearest", episode_seeds(0, 3), batch_size=2)
    assert records["rounds"].tolist() == [MOST_ROUNDS] * 3
    assert records["end"].tolist() == [COMPLETE] * 3
    np.testing.assert_allclose(records["time_s"], MOST_ROUNDS * config.execution.tick_s)


class _Watcher(Nearest):
    """Remembers how many games it was asked about."""

    def __init__(self) -> None:
        super().__init__()
        self.asked: list[int] = []

    def select(self, situation: Situation) -> np.ndarray:
        self.asked.append(len(situation))
        return super().select(situation)


class _WithState(_Watcher):
    def reset(self, games: np.ndarray, config: Config) -> None:
        """Has something to forget."""


@pytest.mark.parametrize("kind", [_Watcher, _WithState])
def test_only_policies_without_a_state_are_spared_games_that_are_over(
    kind: type[_Watcher], monkeypatch: pytest.MonkeyPatch
) -> None:
    made: list[_Watcher] = []

    def make() -> _Watcher:
        made.append(kind())
        return made[-1]

    monkeypatch.setitem(registry.POLICIES._own, "watcher", make)
    records, _ = play(map_assets("house", CONFIG), CONFIG, "watcher", episode_seeds(5, 4))
    np.testing.assert_array_equal(records, played("nearest")[0][:4])
    asked = set(made[0].asked)
    assert asked == {4} if kind is _WithState else {1, 4} <= asked


@pytest.mark.parametrize("candidate", [999, -1])
def test_rounds_are_not_played_by_a_policy_that_chooses_no_candidate(candidate: int) -> None:
    class Lost(Nearest):
        def select(self, situation: Situation) -> NDArray[np.int64]:
            return np.full(len(situation), candidate)

    with pytest.raises(ValueError, match=r"^policy '.*Lost': select must return candidates 0 to \d+, got -?\d+$"):
        play(map_assets("house", CONFIG), CONFIG, Lost(), episode_seeds(5, 2))
