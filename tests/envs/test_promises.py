"""What the environments promise of their own, over combinations of the typed arguments.

Determinism, memory, copies, masks, endless games and what is drawn for an episode. Outside judges are in
test_judges.py, arguments that are refused in test_arguments.py.
"""

from __future__ import annotations

import copy
import hashlib
import json
import pickle
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

from pacman_env.config import Config
from pacman_env.envs.pacmanbot import PacManBotEnv
from pacman_env.envs.pacmanbot_vector import PacManBotVectorEnv
from pacman_env.evaluation.checks.navigator_accuracy import deepest_contact
from pacman_env.game.round import clyde_speed_mps
from pacman_env.sb3 import PacManBotVecEnv
from pacman_env.sim.observation.situation import LAYOUT
from pacman_env.world.navigation.navigator import SUCCEEDED
from tests.envs.configurations import PAIRWISE, RANGES, SMALL, arguments, name
from tests.envs.helpers import QUICK, arrays, joined, make, make_vector, same

ROOT = Path(__file__).resolve().parents[2]
Environment = PacManBotEnv | PacManBotVectorEnv
combined = pytest.mark.parametrize("combination", PAIRWISE, ids=name)

#: Every observation and action, a generated map, several ghosts and both presets are among them.
LONG = [PAIRWISE[k] for k in (0, 3, 4, 9, 14)]
#: Nobody catches, nothing blocks.
HARMLESS: dict[str, Any] = {
    "clyde.speed_mps": 0.0,
    "nav2.clyde_keepout_m": 1e-6,
    "execution.death_radius_m": 1e-6,
    "time_limit_s": 300.0,
}


def play(env: Environment, decisions: int, seed: int) -> list[Any]:
    """Results of random actions, each held for six decisions, and of the resets between."""
    rng = np.random.default_rng(seed)
    results: list[Any] = []
    single = isinstance(env, PacManBotEnv)
    resets = single or env.autoreset_mode == AutoresetMode.DISABLED
    for k in range(decisions):
        if k % 6 == 0:
            env.action_space.seed(int(rng.integers(2**31)))
            action = env.action_space.sample()
        results.append(env.step(action))
        over = results[-1][2] | results[-1][3]
        if resets and np.any(over):
            options = None if isinstance(env, PacManBotEnv) else {"reset_mask": over.copy()}
            results.append(env.reset(options=options))
    return results


# --- the same bits


def digest(combination: dict[str, Any], decisions: int) -> str:
    """Hash of all that an environment returns."""
    env, state = make(**arguments(combination, time_limit_s=20.0)), hashlib.sha256()
    for result in [env.reset(seed=11), *play(env, decisions, seed=1)]:
        for array in arrays(result):
            state.update(array.tobytes())
        state.update(json.dumps([*result[1:-1], result[-1]]).encode())
    return state.hexdigest()


def digests() -> list[str]:
    return [digest(combination, 1000) for combination in LONG]


def test_1000_decisions_are_the_same_again_and_in_another_process() -> None:
    first = digests()
    assert first == digests()
    code = "from tests.envs.test_promises import digests; print(*digests())"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout.split() == first
    assert len(set(first)) == len(LONG)


# --- memory


@combined
def test_nothing_returned_is_changed_later(combination: dict[str, Any]) -> None:
    mode, chosen = combination["autoreset_mode"], arguments(combination)
    for env in (make(**chosen, render_mode="rgb_array"), make_vector(3, autoreset_mode=mode, **chosen)):
        returned: list[Any] = [env.reset(seed=0), play(env, 15, seed=1), env.situation.arrays(), env.render()]
        if combination["action"] == "goal":
            returned.append(env.action_masks())
        kept = copy.deepcopy(returned)
        play(env, 20, seed=2)
        env.render()
        env.reset(seed=7)
        assert same(returned, kept)
        all_arrays = arrays(tuple(returned[1]))
        starts = {array.__array_interface__["data"][0] for array in all_arrays}
        assert len(starts) == len(all_arrays) >= 15  # each is memory of its own


@combined
def test_nothing_that_the_vec_env_returned_is_changed_later(combination: dict[str, Any]) -> None:
    env = PacManBotVecEnv(3, **arguments(combination))
    env.action_space.seed(0)

    def steps(count: int) -> list[Any]:
        return [env.step(np.array([env.action_space.sample() for _ in range(3)])) for _ in range(count)]

    env.seed(1)
    returned = [env.reset(), *steps(20)]
    if combination["action"] == "goal":
        returned.append(env.env_method("action_masks"))
    kept = copy.deepcopy(returned)
    steps(20)
    env.reset()
    assert same(returned, kept)


# --- copies


def copies(env: Environment) -> list[Environment]:
    return [copy.deepcopy(env), pickle.loads(pickle.dumps(env))]


def seen(env: Environment) -> list[Any]:
    """The arrays of its situation; a level by its number, as a copy may keep it in another place."""
    situation = env.situation
    assert situation.maps is not None
    arrays = dict(zip(LAYOUT.fields, situation.arrays(), strict=True))
    return list({**arrays, "level": situation.maps.numbers[situation.level]}.values())


def continue_identically(env: Environment, decisions: int) -> None:
    """So do copies, through the ends of episodes and into resets without a seed."""
    others = copies(env)
    assert all(same(seen(other), seen(env)) for other in others)
    original = play(env, decisions, seed=5)
    original.append(env.reset())
    for other in others:
        assert same([*play(other, decisions, seed=5), other.reset()], original)


@combined
def test_copies_in_the_middle_of_an_episode_continue_identically(combination: dict[str, Any]) -> None:
    mode, chosen = combination["autoreset_mode"], arguments(combination, time_limit_s=8.0)
    for env in (make(**chosen), make_vector(3, autoreset_mode=mode, **chosen)):
        env.reset(seed=2)
        play(env, 9, seed=3)
        continue_identically(env, 30)


def many_rounds(**chosen: Any) -> dict[str, Any]:
    """Endless games whose rounds are over soon, and that nobody is caught in."""
    settings = {**SMALL, "execution.pickup_radius_m": 3.0, "execution.death_radius_m": 1e-6, "time_limit_s": 30.0}
    return {"settings": {**settings, "endless": True}, **chosen}


@pytest.mark.parametrize("action", ["goal", "velocity"])
@pytest.mark.parametrize("source", ["maze", "generated"])
def test_so_do_copies_of_an_endless_game_in_a_later_round(source: str, action: str) -> None:
    env = make_vector(3, **many_rounds(map=source, action=action, ghosts=("chase", "arcade")))
    env.reset(seed=1)
    rounds = [result[4]["round"] for result in play(env, 50, seed=0)]
    assert (rounds[-1] > 1).any()
    assert len(set(rounds[-1])) > 1  # the games are not in step
    continue_identically(env, 40)


@pytest.mark.parametrize("preset", ["robot", "ideal"])
def test_so_do_copies_of_robots_that_push_against_walls(preset: str) -> None:
    env = make_vector(6, map="maze", preset=preset, action="velocity", settings={"execution.death_radius_m": 1e-6})
    env.reset(seed=0)
    forwards = np.stack([np.full(6, env.config.robot.wheel_speed_mps), np.linspace(-0.3, 0.3, 6)], axis=1)
    for _ in range(4):
        for _ in range(15):
            env.step(forwards)
        others = copies(env)
        for _ in range(15):
            before = env.batch.games[["x", "y"]].copy()
            result = env.step(forwards)
            assert all(same(other.step(forwards), result) for other in others)
            assert all((other.batch.games == env.batch.games).all() for other in others)
        travelled = np.hypot(env.batch.games["x"] - before["x"], env.batch.games["y"] - before["y"])
        assert deepest_contact(env.batch) > 0.0
    assert (travelled < 0.5 * 0.5 * forwards[0, 0]).any()  # half of what the wheels turn


# --- masks


MAPS: list[dict[str, Any]] = [
    {"map": "house"},
    {"map": "house", "settings": {"execution.rules": "as_built"}},
    {"map": "maze", "preset": "ideal"},
    {"map": "loop"},
    {"map": "open_plan"},
    {"map": "generated", "settings": {"start_level": 3, "num_levels": 1}},
]


@pytest.mark.parametrize("chosen", MAPS, ids=lambda chosen: "-".join(map(str, chosen.values())))
def test_every_allowed_goal_is_reached_or_reported(chosen: dict[str, Any]) -> None:
    one = make(**chosen).batch
    pellets, slots = one.assets.pellets, one.pellet_slots
    goals = np.r_[:pellets, slots : slots + one.assets.refuges]
    env, games = (
        make_vector(len(goals), autoreset_mode="Disabled", **joined({"settings": HARMLESS}, chosen)),
        np.arange(len(goals)),
    )
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


@pytest.mark.parametrize("chosen", MAPS, ids=lambda chosen: "-".join(map(str, chosen.values())))
def test_every_pellet_left_and_every_refuge_is_allowed_unless_it_waits_after_an_abort(chosen: dict[str, Any]) -> None:
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


# --- endless games


def nearest_pellet(env: PacManBotEnv) -> int:
    ways = np.where(env.action_masks(), env.situation.path_robot[0], np.inf)
    return int(ways[: env.batch.pellet_slots].argmin())


@pytest.mark.parametrize("source", ["house", "generated"])
def test_endless_rounds_follow_one_another_until_death_or_time(source: str) -> None:
    settings = {**SMALL, "time_limit_s": 60.0, "clyde.speed_step_mps": 0.1, "pellets.spacing_m": 3.0}
    env = make(map=source, preset="ideal", settings={**settings, "endless": True})
    config, outcomes, rounds = env.config, set(), 1
    for seed in range(12):
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
            assert completed in (0, 1)
            assert info["round_seed"] == before["round_seed"]  # it names the episode
            if completed:
                assert info["collected"] == 0
                assert observation["round"][0] == 0.0
                assert observation["round"][1] == info["spawned"]
                assert not over
            before = info
        outcomes.add(info["outcome"])
        rounds = max(rounds, info["round"])
    assert "caught" in outcomes <= {"caught", "timeout"}
    assert rounds >= 3


def test_an_endless_game_ends_at_the_time_limit_of_one_of_its_rounds() -> None:
    env = make(**many_rounds(map="maze"))
    _, info = env.reset(seed=0)
    decisions = 0
    while info["round"] < 3:
        _, _, terminated, truncated, info = env.step(nearest_pellet(env))
        assert not terminated
        assert not truncated
        decisions += 1
    results = [env.step(env.batch.hold) for _ in range(60)]
    assert [result[3] for result in results] == [False] * 59 + [True]
    assert results[-1][4]["outcome"] == "timeout"
    assert results[-1][0]["round"][0] == 30.0
    assert decisions > 3


# --- what is drawn for an episode


@pytest.mark.parametrize("endless", [False, True])
def test_what_is_drawn_is_reported_lies_in_its_range_and_belongs_to_the_seed(endless: bool) -> None:
    settings = {**SMALL, **RANGES, "time_limit_s": 5.0}
    names = [key.partition(".")[2] for key in RANGES]
    env = make_vector(40, map="maze", settings={**settings, "endless": endless})
    infos = env.reset(seed=100)[1]
    for key, (low, high) in zip(names, RANGES.values(), strict=True):
        assert (low <= infos[key]).all()
        assert (infos[key] <= high).all()
        assert infos[key].std() > 0.1 * (high - low)
    assert len(names) == 9
    late = make(map="maze", settings={**settings, "endless": endless})
    play_some = [late.reset(seed=9), *play(late, 30, seed=0)]  # other episodes, whose values must not leak in
    assert len({result[-1]["speed_mps"] for result in play_some}) > 1
    _, info = late.reset(seed=100)
    assert {key: info[key] for key in names} == {key: infos[key][0] for key in names}
    fresh = make(map="maze", settings={**settings, "endless": endless})
    fresh.reset(seed=100)
    assert same(play(late, 30, seed=1), play(fresh, 30, seed=1))


def test_nothing_is_drawn_unless_asked_for() -> None:
    _, info = make().reset(seed=0)
    assert set(info) == {"outcome", "collected", "lost", "spawned", "aborts", "round_seed"}
    assert Config().randomize.ranges() == []
    _, info = make(settings={"randomize.abort_rate": (0.0, 0.2)}).reset(seed=0)
    assert set(info) - {"outcome", "collected", "lost", "spawned", "aborts", "round_seed"} == {"abort_rate"}
