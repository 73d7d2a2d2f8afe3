import itertools
import re

import numpy as np
import pytest

from pacman_env.config import Config
from pacman_env.episodes.rollout import episode_seeds
from pacman_env.evaluation.replay import RecordedGame, film
from pacman_env.evaluation.rounds.scenarios import Scenario, open_scenario
from pacman_env.game.ends import ENDS
from tests.evaluation.helpers import CONFIG, ENDLESS, LEVELS, LEVELS_CONFIG, played, played_on

SEED = episode_seeds(5, 1)[0]


def watched(policy: str, seed: np.uint64, scenario: Scenario = "house", config: Config = CONFIG) -> RecordedGame:
    game = RecordedGame(open_scenario(scenario, config), config, policy, seed, policy.upper())
    while not game.over:
        game.step()
    return game


def moved_by(config: Config, *ghosts: str, when: str = "tick") -> Config:
    return config.with_fields(**{"clyde.ghosts": ghosts, "clyde.speed_mps": 0.1, "decisions.when": when})


MIXED = "nearest", "chase", "clyde:learned"
POWER = {"power.pellets": 3, "power.shortest_s": 20.0, "clyde.ghosts": ("chase", "wander")}


@pytest.mark.parametrize(
    ("policy", "scenario", "config"),
    [
        *((policy, "house", CONFIG) for policy in ("clyde_aware", "lookahead", "nearest")),
        ("lookahead", LEVELS, LEVELS_CONFIG),
        *(("nearest", "house", moved_by(CONFIG, *MIXED, when=when)) for when in ("tick", "event")),
        *(("nearest", "house", config) for config in (ENDLESS, moved_by(ENDLESS, "clyde:learned"))),
        *(("nearest", "house", config.with_fields(**POWER)) for config in (CONFIG, ENDLESS)),
    ],
)
def test_replayed_game_equals_comparison(policy: str, scenario: Scenario, config: Config) -> None:
    records = played_on(scenario, config, policy)
    record = max(records, key=lambda one: (one["rounds"], one["time_s"]))
    game = watched(policy, record["seed"], scenario, config)
    assert game.level == record["level"]
    end, after = ENDS[record["end"]].name, f" after {record['time_s']:.1f} s, {record['collected']}"
    caught = f", {record['ghosts_caught']} ghosts caught" if config.power.pellets else ""
    assert game.outcome().endswith(caught)
    if not config.endless:
        assert game.outcome().startswith(f"{end}{after} of {record['spawned']} pellets")
        return
    assert record["rounds"] > 0
    assert game.outcome() == f"{end} in round {record['rounds'] + 1}{after} pellets{caught}"
    numbers = [int(re.match(r"round (\d+), ", change.when)[1]) for change in game.changes]  # type: ignore[index]
    assert sorted(set(numbers)) == list(range(1, record["rounds"] + 2))


def test_goal_changes_state_time_place_and_reason() -> None:
    changes = watched("clyde_aware", SEED).changes
    assert changes[0].when == "0.0 s"
    assert len(changes) > 2
    assert len({change.when for change in changes}) == len(changes)
    for before, after in itertools.pairwise(changes):
        assert before.goal != after.goal
    for change in changes:
        assert re.match(r"pellet \d+ at \(-?\d+\.\d\d, -?\d+\.\d\d\)$", change.goal)
        assert re.search(r"score -\d+\.\d\d", change.why)
        assert "distance " in change.why
        assert "kind" not in change.why
    assert "the previous goal is gone" in "".join(change.why for change in changes)


def test_new_goal_scores_higher_than_previous_goal() -> None:
    reasons = [change.why for seed in episode_seeds(5, 6) for change in watched("lookahead", seed).changes]
    pairs = [re.search(r"score (-[\d.]+) against (-[\d.]+) of the previous goal", why) for why in reasons]
    better = [(float(pair[1]), float(pair[2])) for pair in pairs if pair]
    assert better
    assert all(new >= old for new, old in better)


def test_film_shows_games_in_parallel_until_last_ends() -> None:
    names = ("nearest", "random_pellet")
    games = [RecordedGame(open_scenario("house", CONFIG), CONFIG, name, SEED, name) for name in names]
    frames = list(film(games, 120))
    longest = max(played(policy)[0]["time_s"][0] for policy in names)
    assert len(frames) == 1 + round(longest / CONFIG.execution.tick_s)
    assert {frame.shape for frame in frames} == {(120, 2 * games[0].picture(120).shape[1], 3)}
    assert (frames[0] != frames[-1]).any()
    assert all(game.over for game in games)


def test_ended_game_does_not_change() -> None:
    game = watched("nearest", SEED, config=CONFIG.with_fields(time_limit_s=2.0))
    outcome, changes = game.outcome(), list(game.changes)
    game.step()
    assert (game.outcome(), game.changes) == (outcome, changes)
