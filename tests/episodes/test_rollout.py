import numpy as np
import pytest
from numpy.typing import NDArray

from pacman_env.config import Config
from pacman_env.episodes.rollout import MOST_ROUNDS, episode_seeds, play, play_in
from pacman_env.evaluation.rounds.scenarios import Levels, open_scenario
from pacman_env.game.ends import CAUGHT, CLEARED, COMPLETE, RUNNING, TIMEOUT
from pacman_env.heuristics.simple import Nearest
from pacman_env.levels.assets import map_assets
from pacman_env.observations.situation import Situation
from pacman_env.observations.situation_writer import situation_of
from pacman_env.policies.registry import make_policy
from pacman_env.sim.batch import GameBatch
from tests.evaluation.helpers import CONFIG, ENDLESS, LEVELS, LEVELS_CONFIG, played, played_endless, played_on_levels


def test_episode_seeds_differ_and_have_a_fixed_order() -> None:
    np.testing.assert_array_equal(episode_seeds(3, 50)[:7], episode_seeds(3, 7))
    seeds = np.concatenate([episode_seeds(seed, 100) for seed in range(5)])
    assert seeds.dtype == np.uint64
    assert len(np.unique(seeds)) == 500
    with pytest.raises(ValueError, match="seed = -1"):
        episode_seeds(-1, 2)


def test_rounds_do_not_depend_on_their_batch() -> None:
    for policy in ("clyde_aware", "random_pellet"):
        np.testing.assert_array_equal(played(policy)[0], played(policy, batch_size=5)[0])
        np.testing.assert_array_equal(played(policy)[0][:5], played(policy, 5, 1)[0])
    np.testing.assert_array_equal(played_endless("clyde_aware"), played_endless("clyde_aware", 3))
    records = played_on_levels("lookahead")
    np.testing.assert_array_equal(records, played_on_levels("lookahead", 3))
    np.testing.assert_array_equal(records["level"], open_scenario(LEVELS, LEVELS_CONFIG).levels_of(episode_seeds(5, 8)))
    assert len(set(records["level"])) == 2


def test_records_and_times_describe_their_rounds() -> None:
    records, times = played("nearest")
    assert len(times) >= 10
    assert (times > 0).all()
    np.testing.assert_array_equal(records["seed"], episode_seeds(5, 12))
    assert set(records["end"]) <= {CAUGHT, COMPLETE, CLEARED, TIMEOUT}
    assert len(set(records["end"])) > 1
    assert (records["spawned"] == map_assets("house", CONFIG).pellets).all()
    assert (records["collected"] + records["lost"] <= records["spawned"]).all()
    np.testing.assert_array_equal(records["end"] == COMPLETE, records["collected"] == records["spawned"])
    np.testing.assert_array_equal(records["end"] == TIMEOUT, records["time_s"] == CONFIG.time_limit_s)
    assert (records["time_s"] > 0).all()


@pytest.mark.parametrize("when", ["tick", "event"])
@pytest.mark.parametrize("config", [CONFIG, ENDLESS], ids=["round", "endless"])
def test_record_is_that_of_a_game_by_hand(config: Config, when: str) -> None:
    config = config.with_fields(**{"decisions.when": when})
    batch, policy = GameBatch(map_assets("house", config), config, 1), make_policy("nearest")
    batch.reset(np.arange(1), episode_seeds(5, 1))
    policy.reset(np.ones(1, np.bool_), config)
    steps = 0
    while batch.games["end"][0] == RUNNING:
        batch.step(policy.select(situation_of(batch)))
        steps += round(batch.elapsed_s[0] / config.physics_step_s)
    played_alone, _ = play(map_assets("house", config), config, "nearest", episode_seeds(5, 1))
    record, game = played_alone[0], batch.games[0]
    assert record["end"] == game["end"]
    assert record["collected"] == game["score" if config.endless else "collected"]
    assert record["rounds"] == (game["round"] - 1 if config.endless else game["collected"] == game["spawned"])
    assert record["time_s"] == pytest.approx(steps * config.physics_step_s)


def test_existing_games_play_the_same_rounds() -> None:
    source = open_scenario(Levels("test", count=7), LEVELS_CONFIG)
    seeds = episode_seeds(5, 8)
    expected = play(source, LEVELS_CONFIG, "clyde_aware", seeds)[0]
    batch = GameBatch(source, LEVELS_CONFIG, 4, 2)
    play_in(batch, "nearest", seeds)
    records, times = play_in(batch, "clyde_aware", seeds, timed=False)
    np.testing.assert_array_equal(records, expected)
    assert len(times) == 0
    with pytest.raises(ValueError, match="4 games for 3 seeds"):
        play_in(batch, "nearest", seeds[:3])


def test_policy_ghosts_play_in_existing_games() -> None:
    seeds = episode_seeds(5, 6)
    config = CONFIG.with_fields(**{"clyde.ghosts": ("wander", "nearest"), "clyde.speed_mps": 0.4})
    source = map_assets("house", CONFIG.with_fields(**{"clyde.ghosts": ("policy",)}))
    expected = play(source, config, "clyde_aware", seeds)[0]
    batch = GameBatch(source, config.with_fields(**{"clyde.ghosts": ("wander", "policy")}), 3)
    found = play_in(batch, "clyde_aware", seeds, ghosts={1: Nearest()})[0]
    np.testing.assert_array_equal(found, expected)
    alone = play(source, config.with_fields(**{"clyde.ghosts": ("wander", "wander")}), "clyde_aware", seeds)[0]
    assert (alone["time_s"] != found["time_s"]).any()


def test_endless_game_stops_after_most_rounds() -> None:
    config = ENDLESS.with_fields(
        **{"execution.pickup_radius_m": 50.0, "clyde.speed_mps": 0.0, "clyde.speed_step_mps": 0.0}
    )
    records, _ = play(map_assets("house", config), config, "nearest", episode_seeds(0, 3), batch_size=2)
    assert records["rounds"].tolist() == [MOST_ROUNDS] * 3
    assert records["end"].tolist() == [COMPLETE] * 3
    np.testing.assert_allclose(records["time_s"], MOST_ROUNDS * config.execution.tick_s)


class Watcher(Nearest):
    """Nearest, and of how many games it was asked each time."""

    def __init__(self) -> None:
        super().__init__()
        self.asked: list[int] = []

    def select(self, situation: Situation) -> NDArray[np.int64]:
        self.asked.append(len(situation))
        return super().select(situation)


class WithState(Watcher):
    def reset(self, games: np.ndarray, config: Config) -> None:
        """Has something to forget."""


@pytest.mark.parametrize("kind", [Watcher, WithState])
def test_only_stateless_policies_skip_ended_games(kind: type[Watcher]) -> None:
    policy, config = kind(), CONFIG.with_fields(**{"nav2.controller": "pure_pursuit"})  # whose rounds end apart
    source = map_assets("house", config)
    records, _ = play_in(GameBatch(source, config, 4), policy, episode_seeds(5, 4), timed=False)
    np.testing.assert_array_equal(records, play(source, config, "nearest", episode_seeds(5, 12))[0][:4])
    assert set(policy.asked) == {4} if kind is WithState else {1, 4} <= set(policy.asked)


def test_events_ask_less_often_than_ticks() -> None:
    asked = {}
    for when in ("tick", "event"):
        config, policy = CONFIG.with_fields(**{"decisions.when": when, "clyde.speed_mps": 0.3}), Watcher()
        records, _ = play(map_assets("house", config), config, policy, episode_seeds(5, 4))
        asked[when] = sum(policy.asked) * config.execution.tick_s / records["time_s"].sum()
    assert asked["tick"] >= 1.0
    assert asked["event"] < 0.6


def test_policy_that_chooses_no_candidate_is_refused() -> None:
    class Lost(Nearest):
        def select(self, situation: Situation) -> NDArray[np.int64]:
            return np.full(len(situation), 999)

    with pytest.raises(ValueError, match=r"^policy '.*Lost': select must return candidates 0 to \d+, got 999$"):
        play(map_assets("house", CONFIG), CONFIG, Lost(), episode_seeds(5, 2))
