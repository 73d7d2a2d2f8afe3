"""Masks, endless games and what is drawn for an episode."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from pacman_env.config import Config
from pacman_env.envs.pacmanbot import PacManBotEnv
from pacman_env.game.round import clyde_speed_mps
from pacman_env.world.navigation.navigator import SUCCEEDED
from tests.envs.cases import RANGES, SMALL
from tests.envs.helpers import QUICK, joined, make, make_vector

#: Nobody catches, nothing blocks.
HARMLESS: dict[str, Any] = {
    "clyde.speed_mps": 0.0,
    "nav2.clyde_keepout_m": 1e-6,
    "execution.death_radius_m": 1e-6,
    "time_limit_s": 300.0,
}
MAPS: list[dict[str, Any]] = [
    {"map": "house", "settings": {"execution.rules": "as_built"}},
    {"map": "maze", "preset": "ideal"},
    {"map": "open_plan"},
    {"map": "generated", "settings": {"start_level": 3, "num_levels": 1}},
]
on_maps = pytest.mark.parametrize("chosen", MAPS, ids=lambda chosen: "-".join(map(str, chosen.values())))


@on_maps
def test_allowed_goals_are_reached_or_reported(chosen: dict[str, Any]) -> None:
    one = make(**chosen).batch
    pellets, slots = one.assets.pellets, one.pellet_slots
    goals = np.r_[:pellets, slots : slots + one.assets.refuges]
    games = np.arange(len(goals))
    env = make_vector(len(goals), autoreset_mode="Disabled", **joined({"settings": HARMLESS}, chosen))
    env.reset(seed=4)
    state, reached, waiting = env.batch.games, np.zeros(len(goals), dtype=bool), np.ones(len(goals), dtype=bool)
    assert env.action_masks()[games, goals].all()
    away = np.hypot(*(env.situation.position[games, goals] - env.situation.robot[:, :2]).T)
    at_home = (goals >= slots) & (away <= env.config.nav2.goal_tolerance_m)  # refuges that need not be driven to
    while waiting.any():
        infos = env.step(np.where(waiting, goals, env.batch.hold))[4]
        situation, allowed = env.situation, env.action_masks()[games, goals]
        for i in np.flatnonzero(waiting & (situation.current != goals)):
            waiting[i] = False
            if i < pellets and not env.batch.alive[i, i]:
                reached[i] = infos["lost"][i] == 0
                assert infos["collected"][i] > 0 if reached[i] else infos["aborts"][i] == infos["lost"][i] == 1
            elif allowed[i]:  # a refuge, where the robot coasts a little after SUCCEEDED
                x, y = situation.position[i, goals[i]]
                reached[i] = i >= pellets and (at_home[i] or state["nav_last"][i] == SUCCEEDED)
                assert np.hypot(state["x"][i] - x, state["y"][i] - y) <= env.config.nav2.goal_tolerance_m + 0.2
                assert reached[i]
            else:  # aborted, or the navigator moved the goal too far from the pellet
                assert infos["aborts"][i] == 1 or state["nav_last"][i] == SUCCEEDED
            assert allowed[i] == (i >= pellets and reached[i])
        assert (infos["outcome"][waiting] == "running").all()
    assert reached.mean() > 0.9


@on_maps
def test_masks_forbid_only_candidates_waiting_after_abort(chosen: dict[str, Any]) -> None:
    env = make_vector(4, **joined({"settings": {**QUICK, "nav2.abort_rate": 0.2, "max_pellets": 20}}, chosen))
    env.reset(seed=1)
    back_off = round(env.config.execution.back_off_s / env.config.execution.tick_s)
    pellets, refuges = env.batch.pellet_slots, env.batch.assets.refuges
    until = np.zeros((4, env.batch.candidates), dtype=np.int64)  # the longest that a candidate may wait
    rng, waited = np.random.default_rng(0), 0
    actions = aborts = seeds = np.zeros(4, dtype=np.int64)
    for k in range(150):
        mask, there = env.action_masks(), np.zeros((4, env.batch.candidates), dtype=bool)
        there[:, :pellets] = env.batch.alive
        there[:, pellets : pellets + refuges] = there[:, -1] = True
        np.testing.assert_array_equal(env.situation.pellets_left, env.batch.alive.sum(axis=1))
        assert not (mask & ~there).any()
        assert (until > k)[there & ~mask].all()
        waited += int((there & ~mask).sum())
        # An abort makes the goal wait that was pursued, or sent just now.
        if k % 4 == 0:
            actions = np.array([rng.choice(np.flatnonzero(row)) for row in mask])
        sent = [{int(env.situation.current[i]), int(actions[i])} - {-1} for i in range(4)]
        infos = env.step(actions)[4]
        for i in range(4):
            if infos["round_seed"][i] != seeds[i] and k > 0:
                until[i] = 0
            elif infos["aborts"][i] > aborts[i]:
                until[i, list(sent[i])] = k + 2 + 8 * back_off
        aborts, seeds = infos["aborts"], infos["round_seed"]
    assert (waited > 0) == (env.config.execution.on_abort == "back_off" or refuges > 0)


def nearest_pellet(env: PacManBotEnv) -> int:
    paths = np.where(env.action_masks(), env.situation.path_robot[0], np.inf)
    return int(paths[: env.batch.pellet_slots].argmin())


@pytest.mark.parametrize("source", ["house", "generated"])
def test_endless_game_starts_rounds_until_death_or_timeout(source: str) -> None:
    settings = {**SMALL, "time_limit_s": 60.0, "clyde.speed_step_mps": 0.1, "pellets.spacing_m": 3.0}
    env = make(map=source, preset="ideal", settings={**settings, "endless": True})
    config, outcomes, rounds = env.config, set(), 1
    for seed in range(8):
        _, before = env.reset(seed=seed)
        assert (before["round"], before["score"]) == (1, 0)
        over = False
        while not over:
            observation, reward, terminated, truncated, info = env.step(nearest_pellet(env))
            over = terminated or truncated
            completed = info["round"] - before["round"]
            gained = info["score"] - before["score"]
            end = {"caught": config.reward.death, "timeout": config.reward.timeout}.get(info["outcome"], 0.0)
            expected = config.reward.tick + gained * config.reward.pellet + completed * config.reward.completion + end
            assert reward == pytest.approx(expected, abs=1e-9)
            speed = clyde_speed_mps(config.clyde.speed_mps, config.clyde.speed_step_mps, info["round"])
            assert observation["clyde"][6] == pytest.approx(speed, rel=1e-6)
            assert info["round_seed"] == before["round_seed"]  # it names the episode
            if completed:
                assert completed == 1
                assert info["collected"] == 0
                assert observation["round"].tolist() == [0.0, info["spawned"]]
                assert not over
            before = info
        outcomes.add(info["outcome"])
        rounds = max(rounds, info["round"])
    assert "caught" in outcomes <= {"caught", "timeout"}
    assert rounds >= 3


def test_endless_game_ends_at_time_limit_of_round() -> None:
    settings = {**SMALL, "execution.pickup_radius_m": 3.0, "execution.death_radius_m": 1e-6, "time_limit_s": 30.0}
    env = make(map="maze", settings={**settings, "endless": True})
    _, info = env.reset(seed=0)
    while info["round"] < 3:
        _, _, terminated, truncated, info = env.step(nearest_pellet(env))
        assert {terminated, truncated} == {False}
    results = [env.step(env.batch.hold) for _ in range(60)]
    assert [result[3] for result in results] == [False] * 59 + [True]
    assert results[-1][4]["outcome"] == "timeout"
    assert results[-1][0]["round"][0] == 30.0


@pytest.mark.parametrize("endless", [False, True])
def test_randomized_values_lie_in_range_and_follow_seed(endless: bool) -> None:
    settings = {**SMALL, **RANGES, "time_limit_s": 5.0, "endless": endless}
    names = [key.partition(".")[2] for key in RANGES]
    infos = make_vector(40, map="maze", settings=settings).reset(seed=100)[1]
    for key, (low, high) in zip(names, RANGES.values(), strict=True):
        assert ((low <= infos[key]) & (infos[key] <= high)).all()
        assert infos[key].std() > 0.1 * (high - low)
    late = make(map="maze", settings=settings)
    assert late.reset(seed=9)[1]["speed_mps"] != late.reset()[1]["speed_mps"]
    _, info = late.reset(seed=100)
    assert {key: info[key] for key in names} == {key: infos[key][0] for key in names}


def test_no_value_is_randomized_by_default() -> None:
    assert Config().randomize.ranges() == []
    _, plain = make().reset(seed=0)
    _, info = make(settings={"randomize.abort_rate": (0.0, 0.2)}).reset(seed=0)
    assert set(info) - set(plain) == {"abort_rate"}
