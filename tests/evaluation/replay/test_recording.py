from __future__ import annotations

import itertools
import re

import numpy as np
import pytest

from pacman_env.config import Config
from pacman_env.envs.outcome import OUTCOMES
from pacman_env.episodes.rollout import episode_seeds, play
from pacman_env.evaluation.replay import RecordedGame, film
from pacman_env.evaluation.rounds.scenarios import Scenario, open_scenario
from pacman_env.game.ghosts import BEHAVIOURS
from tests.evaluation.helpers import CONFIG, ENDLESS, LEVELS, LEVELS_CONFIG, played, played_endless, played_on_levels

SEED = episode_seeds(5, 1)[0]


def watched(policy: str, scenario: Scenario = "house", config: Config = CONFIG, seed: np.uint64 = SEED) -> RecordedGame:
    game = RecordedGame(open_scenario(scenario, config), config, policy, seed, policy.upper())
    while not game.over:
        game.step()
    return game


@pytest.mark.parametrize("policy", ["clyde_aware", "lookahead", "nearest"])
def test_replayed_round_equals_comparison(policy: str) -> None:
    record = played(policy)[0][0]
    words = f" after {record['time_s']:.1f} s, {record['collected']} of {record['spawned']} pellets"
    assert watched(policy).outcome().startswith(OUTCOMES[record["end"]] + words)


def test_replayed_level_round_equals_comparison() -> None:
    record = played_on_levels("lookahead")[3]
    game = watched("lookahead", LEVELS, LEVELS_CONFIG, record["seed"])
    assert game.level == record["level"]
    assert f" after {record['time_s']:.1f} s, {record['collected']} of {record['spawned']} pellets" in game.outcome()


def test_replayed_endless_game_equals_comparison() -> None:
    record = max(played_endless("nearest"), key=lambda r: r["rounds"])
    game = watched("nearest", "house", ENDLESS, record["seed"])
    assert game.outcome() == (
        f"{OUTCOMES[record['end']]} in round {record['rounds'] + 1} after {record['time_s']:.1f} s,"
        f" {record['collected']} pellets"
    )
    numbers = [int(re.match(r"round (\d+), ", change.when)[1]) for change in game.changes]  # type: ignore[index]
    assert sorted(set(numbers)) == list(range(1, record["rounds"] + 2))


@pytest.mark.parametrize("when", ["tick", "event"])
def test_replayed_game_with_policy_ghosts_equals_comparison(when: str) -> None:
    ghosts = {"clyde.ghosts": ("nearest", "chase", "clyde:learned"), "clyde.speed_mps": 0.2}
    config = CONFIG.with_fields(**ghosts, **{"decisions.when": when})
    records, _ = play(open_scenario("house", config), config, "nearest", episode_seeds(5, 4))
    assert len(set(records["time_s"])) > 1
    for record in records:
        words = f" after {record['time_s']:.1f} s, {record['collected']} of {record['spawned']} pellets"
        outcome = watched("nearest", config=config, seed=record["seed"]).outcome()
        assert outcome.startswith(OUTCOMES[record["end"]] + words)


def test_replayed_endless_game_with_learned_ghost_equals_comparison() -> None:
    config = ENDLESS.with_fields(**{"clyde.ghosts": ("clyde:learned",), "clyde.speed_mps": 0.1})
    records, _ = play(open_scenario("house", config), config, "nearest", episode_seeds(5, 4))
    record = max(records, key=lambda r: r["rounds"])
    assert record["rounds"] > 0
    assert watched("nearest", config=config, seed=record["seed"]).outcome() == (
        f"{OUTCOMES[record['end']]} in round {record['rounds'] + 1} after {record['time_s']:.1f} s,"
        f" {record['collected']} pellets"
    )


def test_goal_changes_state_time_place_and_reason() -> None:
    changes = watched("clyde_aware").changes
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
    assert "the one before is gone" in "".join(change.why for change in changes)


def test_new_goal_scores_higher_than_previous_goal() -> None:
    reasons = [change.why for seed in episode_seeds(5, 6) for change in watched("lookahead", seed=seed).changes]
    pairs = [re.search(r"score (-[\d.]+) against (-[\d.]+) of the one before", why) for why in reasons]
    better = [(float(pair[1]), float(pair[2])) for pair in pairs if pair]
    assert better
    assert all(new >= old for new, old in better)


def test_film_shows_games_in_parallel_until_last_ends() -> None:
    games = [RecordedGame(open_scenario("house", CONFIG), CONFIG, name, SEED, name) for name in ("nearest", "random")]
    frames = list(film(games, 120))
    longest = max(played(policy)[0]["time_s"][0] for policy in ("nearest", "random"))
    assert len(frames) == 1 + round(longest / CONFIG.execution.tick_s)
    assert {frame.shape for frame in frames} == {(120, 2 * games[0].picture(120).shape[1], 3)}
    assert (frames[0] != frames[-1]).any()
    assert all(game.over for game in games)


@pytest.mark.parametrize("behaviour", [name for name in BEHAVIOURS if name != "policy"])
def test_ended_game_does_not_change(behaviour: str) -> None:
    config = CONFIG.with_fields(**{"clyde.ghosts": (behaviour,), "time_limit_s": 2.0})
    game = watched("nearest", config=config)
    outcome, changes = game.outcome(), list(game.changes)
    game.step()
    assert (game.outcome(), game.changes) == (outcome, changes)
