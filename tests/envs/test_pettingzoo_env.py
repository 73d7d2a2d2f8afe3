"""What the multi-agent environment promises beyond PettingZoo's interface."""

from __future__ import annotations

import copy
import hashlib
import pickle
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

import pacman_env
from pacman_env.config import Config, ConfigError, RewardConfig, make_config
from pacman_env.envs.pettingzoo_env import PACMAN, PacManBotParallelEnv
from tests.envs.helpers import QUICK, arrays, joined, nothing_returned_is_changed_later, same

ROOT = Path(__file__).resolve().parents[2]
MIXED = ("policy", "chase", "arcade", "policy")
FAST_GHOSTS = {**QUICK, "clyde.speed_mps": 0.8}


def actions_of(env: PacManBotParallelEnv, rng: np.random.Generator) -> dict[str, Any]:
    """Any action of every agent, also those that the mask forbids."""
    actions = {agent: int(rng.integers(env.batch.candidates)) for agent in env.agents}
    if env.config.action == "velocity":
        space = env.action_space(PACMAN)
        actions[PACMAN] = rng.uniform(space.low, space.high).astype(np.float32)  # type: ignore[attr-defined]
    return actions


def play(env: PacManBotParallelEnv, steps: int, seed: int = 0, first: int | None = 5) -> list[Any]:
    """Results of random actions, each held for four steps, and of the resets between; goes on where ``first`` < 0."""
    rng = np.random.default_rng(seed)
    results: list[Any] = [] if first is not None and first < 0 else [env.reset(seed=first)]
    actions: dict[str, Any] = {}
    for k in range(steps):
        if not env.agents:
            results.append(env.reset())
        if k % 4 == 0:
            actions = actions_of(env, rng)
        results.append((*env.step(actions), env.state()))
    return results


# --- agents and spaces


@pytest.mark.parametrize(
    ("ghosts", "agents"),
    [
        (None, ["pacman", "clyde"]),
        ("policy", ["pacman", "clyde"]),
        (("policy",) * 4, ["pacman", "clyde", "blinky", "pinky", "inky"]),
        (("wander", "policy", "chase"), ["pacman", "blinky"]),
    ],
)
def test_agents_are_pacman_and_the_ghosts_that_are_told(ghosts: Any, agents: list[str]) -> None:
    env = pacman_env.parallel_env(ghosts=ghosts)
    assert env.possible_agents == agents
    assert env.agents == []
    observations, infos = env.reset(seed=0)
    assert env.agents == list(observations) == list(infos) == agents


@pytest.mark.parametrize(
    "arguments", [{}, {"map": "generated", "settings": {"num_levels": 3, "endless": True}, "preset": "ideal"}]
)
def test_observations_and_states_stay_inside_their_spaces(arguments: dict[str, Any]) -> None:
    env = pacman_env.parallel_env(ghosts=MIXED, **joined({"settings": QUICK}, arguments))
    for result in play(env, 150):
        for agent, observation in result[0].items():
            assert env.observation_space(agent).contains(observation), agent
        assert len(result) == 2 or env.state_space.contains(result[-1])


def test_a_ghost_sees_himself_as_clyde_whoever_is_nearer() -> None:
    env = pacman_env.parallel_env(ghosts=MIXED, settings=FAST_GHOSTS)
    for result in play(env, 60):
        for agent, seat in (("clyde", 0), ("inky", 3)):
            seen = result[0][agent]
            np.testing.assert_array_equal(seen["clyde"][[0, 1, 2, 3, 4, 6]], seen["ghosts"][seat])
        nearest = result[0][PACMAN]["ghosts"][:, 4].argmin()
        np.testing.assert_array_equal(result[0][PACMAN]["clyde"][:2], result[0][PACMAN]["ghosts"][nearest, :2])


# --- masks


def test_what_the_mask_forbids_makes_a_ghost_wander_on() -> None:
    # Wide as he is, he does not come near every place; and a house of 13 pellets has 20 slots here.
    settings = {**QUICK, "pellets.spacing_m": 2.0, "max_pellets": 20, "clyde.clearance_m": 0.75}
    told, wandering = (pacman_env.parallel_env(settings=settings) for _ in range(2))
    for env in (told, wandering):
        env.reset(seed=4)
    mask = told.step({PACMAN: 0, "clyde": 0})[0]["clyde"]["action_mask"]
    wandering.step({PACMAN: 0, "clyde": 0})
    forbidden = np.flatnonzero(mask == 0)
    assert forbidden.min() < 13
    assert forbidden.max() < told.batch.hold
    assert {13, 19} <= set(forbidden.tolist())
    for k in range(20):
        on = {PACMAN: k % 13, "clyde": told.batch.hold}
        results = told.step({PACMAN: k % 13, "clyde": int(forbidden[k % len(forbidden)])})
        assert same(results, wandering.step(on)), k
    assert not results[0]["clyde"]["candidates"][:, 3].any()  # no place is his current one


def test_a_ghost_is_shown_where_he_was_sent() -> None:
    env = pacman_env.parallel_env()
    env.reset(seed=0)
    for place in (3, 3, 11, 20):
        observations = env.step({PACMAN: 0, "clyde": place})[0]
        np.testing.assert_array_equal(np.flatnonzero(observations["clyde"]["candidates"][:, 3]), [place])


# --- rewards


@pytest.mark.parametrize("ghosts", [("policy",), ("policy", "policy"), ("policy", "policy", "wander", "policy")])
def test_zero_sum_rewards_sum_to_zero_and_ghosts_get_equal_parts(ghosts: tuple[str, ...]) -> None:
    env = pacman_env.parallel_env(ghosts=ghosts, settings={**FAST_GHOSTS, "endless": True})
    seen = set()
    for result in play(env, 200):
        if len(result) > 2:
            pacman, *others = result[1].values()
            assert sum(others) == pytest.approx(-pacman, abs=1e-12)
            assert len(set(others)) == 1
            assert all(type(reward) is float for reward in result[1].values())
            seen.add(round(pacman))
    assert {-10, 0, 1} <= seen


def greedy(observation: dict[str, np.ndarray]) -> int:
    """The pellet nearest by path."""
    pellet = (observation["candidates"][:, 0] == 1) & (observation["action_mask"] == 1)
    return int(np.where(pellet, observation["candidates"][:, 7], np.inf).argmin())


def test_separate_rewards_are_as_documented_for_each_outcome() -> None:
    ends = {"caught": 10.0, "complete": -5.0, "timeout": -5.0, "running": 0.0}
    seen = set()
    env = pacman_env.parallel_env(ghosts=("policy", "wander", "policy"), settings={**QUICK, "zero_sum": False})
    for seed in range(25):
        observations, _ = env.reset(seed=seed)
        while env.agents:
            goal = greedy(observations[PACMAN]) if seed % 4 else env.batch.hold
            actions = {PACMAN: goal, "clyde": 0, "pinky": 1}
            observations, rewards, _, _, infos = env.step(actions)
            outcome = infos[PACMAN]["outcome"]
            assert rewards["clyde"] == rewards["pinky"] == pytest.approx(ends[outcome] - 0.002, abs=1e-12)
            seen.add(outcome)
    assert seen == ends.keys()


def test_the_ghosts_own_rewards_can_be_configured() -> None:
    own = RewardConfig(pellet=-1.0, death=3.0, completion=0.0, tick=0.5, timeout=0.0)
    config = make_config("robot", **{**QUICK, "clyde.ghosts": ("policy",), "ghost_reward": own, "zero_sum": False})
    env = pacman_env.parallel_env(settings=config)
    before, eaten = 0, 0
    observations, _ = env.reset(seed=1)
    while env.agents:
        observations, rewards, _, _, infos = env.step({PACMAN: greedy(observations[PACMAN]), "clyde": env.batch.hold})
        gained = infos["clyde"]["collected"] - before
        before += gained
        eaten += gained
        assert rewards["clyde"] == 0.5 - gained + 3.0 * (infos["clyde"]["outcome"] == "caught")
    assert eaten > 0


# --- ends


def test_at_the_end_all_agents_leave_and_a_reset_brings_them_back() -> None:
    env, seen = pacman_env.parallel_env(ghosts=("policy", "wander"), settings=QUICK), set()
    observations, _ = env.reset(seed=0)
    for _ in range(12):
        while env.agents:
            observations, _, terminated, truncated, infos = env.step({PACMAN: greedy(observations[PACMAN]), "clyde": 1})
            outcome = infos[PACMAN]["outcome"]
            assert terminated == dict.fromkeys((PACMAN, "clyde"), outcome in ("caught", "complete"))
            assert truncated == dict.fromkeys((PACMAN, "clyde"), outcome == "timeout")
            assert bool(env.agents) == (outcome == "running")
        seen.add(outcome)
        assert env.step({}) == env.step({PACMAN: 0, "clyde": 0}) == ({}, {}, {}, {}, {})
        observations, infos = env.reset()
        assert env.agents == [PACMAN, "clyde"]
        assert observations[PACMAN]["round"][0] == 0.0
    assert len(seen) >= 2


def test_max_cycles_truncate_a_game_that_still_runs() -> None:
    env = pacman_env.parallel_env(settings={"max_cycles": 3, "zero_sum": False})
    for _ in range(2):
        env.reset(seed=0)
        results = [env.step({PACMAN: 0, "clyde": 0}) for _ in range(3)]
        assert [result[3]["clyde"] for result in results] == [False, False, True]
        assert not results[-1][2][PACMAN]
        assert results[-1][4][PACMAN]["outcome"] == "running"
        assert results[-1][1]["clyde"] == -0.002  # the game's own time limit is not reached
        assert env.agents == []


# --- errors


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"settings": {"zero_sum": "shared"}}, "zero_sum = 'shared': Expected `bool`"),
        ({"settings": {"max_cycles": 0}}, "max_cycles = 0: Expected `int` >= 1"),
        ({"ghosts": ("wander", "chase")}, "at least one must have the behaviour 'policy'"),
        ({"ghosts": 2}, "at least one must have the behaviour 'policy'"),
        ({"settings": Config()}, "at least one must have the behaviour 'policy'"),
        ({"ghosts": ("policy", "hide")}, "hide"),
        ({"ghosts": ("policy",) * 5}, "one to four"),
        ({"ghosts": ("policy", 3)}, r"ghosts\[1\] = 3"),
    ],
)
def test_an_argument_that_cannot_be_played_is_named(arguments: dict[str, Any], message: str) -> None:
    for interface in (pacman_env.parallel_env, pacman_env.env):
        with pytest.raises(ConfigError, match=message):
            interface(**arguments)


BAD: list[tuple[str, dict[str, Any], str]] = [
    ("goal", {"clyde": 0}, "no action of pacman"),
    ("goal", {PACMAN: 0}, "no action of clyde"),
    ("goal", {}, "no action of pacman, clyde"),
    *(("goal", {PACMAN: bad, "clyde": 0}, "pacman is not in Discrete") for bad in (-1, 24, 1.0, None, np.array([1]))),
    *(("goal", {PACMAN: 0, "clyde": bad}, "clyde is not in Discrete") for bad in (-1, 24, "1", None, 2**40)),
    *(
        ("velocity", {PACMAN: bad, "clyde": 0}, "pacman: must be two finite numbers")
        for bad in ([np.nan, 0.0], 1, None, "go")
    ),
    ("velocity", {PACMAN: [0.1, 0.1], "clyde": 24}, "clyde is not in Discrete"),
]


@pytest.mark.parametrize(("action", "actions", "message"), BAD)
def test_wrong_actions_are_named_and_leave_the_game_as_it_was(
    action: str, actions: dict[str, Any], message: str
) -> None:
    env, twin = (pacman_env.parallel_env(action=action, settings={"max_cycles": 2}) for _ in range(2))
    env.reset(seed=1)
    twin.reset(seed=1)
    good = {PACMAN: 1 if action == "goal" else np.array([0.2, 0.5]), "clyde": np.int32(3)}
    for _ in range(2):
        with pytest.raises(ValueError, match=message):
            env.step(actions)
        assert same((*env.step(good), env.agents), (*twin.step(good), twin.agents))


def test_agent_by_agent_a_wrong_action_is_refused_at_once_and_can_be_corrected() -> None:
    env, twin = pacman_env.env(), pacman_env.parallel_env()
    env.reset(seed=1)
    twin.reset(seed=1)
    for agent in (PACMAN, "clyde"):
        for bad in (24, None):
            with pytest.raises(ValueError, match=f"action {bad} of {agent} is not in {re.escape('Discrete(24)')}"):
                env.step(bad)
        env.step(2)
    assert same(env.last()[0], twin.step({PACMAN: 2, "clyde": 2})[0][PACMAN])


def test_nothing_can_be_asked_before_the_first_reset() -> None:
    env = pacman_env.parallel_env()
    for ask in (lambda: env.step({PACMAN: 0, "clyde": 0}), env.state):
        with pytest.raises(gym.error.ResetNeeded):
            ask()


# --- state


def test_the_state_is_the_true_game_under_its_names() -> None:
    env = pacman_env.parallel_env(ghosts=MIXED, settings=FAST_GHOSTS, map="maze")
    env.reset(seed=2)
    names, apart, rng = env.state_names, [], np.random.default_rng(0)
    assert len(names) == len(set(names)) == env.state_space.shape[0]
    for _ in range(30):
        observations = env.step(actions_of(env, rng))[0] if env.agents else env.reset()[0]
        state = dict(zip(names, env.state().tolist(), strict=True))
        g, batch = env.batch.games[0], env.batch
        assert (state["x"], state["y"]) == (g["x"], g["y"])
        assert np.cos(state["heading"] - g["heading"]) == pytest.approx(1.0)
        robot = observations[PACMAN]["robot"]
        believed = [state["believed_x"], state["believed_y"], *(f(state["believed_heading"]) for f in (np.cos, np.sin))]
        np.testing.assert_allclose(robot[:6], [*believed, state["v"], state["omega"]], atol=1e-6)
        for k, ghost in enumerate(("clyde", "blinky", "pinky", "inky")):
            expected = [batch.ghosts[0, k][part] for part in ("x", "y", "vx", "vy")]
            assert [state[f"{ghost}_{part}"] for part in ("x", "y", "vx", "vy")] == expected
        pellets = [state[f"pellet_{k}"] for k in range(batch.pellet_slots)]
        assert pellets == batch.alive[0].astype(float).tolist()
        assert [state["time"], sum(pellets)] == observations[PACMAN]["round"].tolist()
        assert (state["round"], state["score"]) == (1, g["collected"])
        apart.append(np.hypot(state["x"] - state["believed_x"], state["y"] - state["believed_y"]))
    assert max(apart) > 0.01  # what the robot believes is not true


# --- the same again


def test_what_was_returned_is_never_changed_later() -> None:
    env = pacman_env.parallel_env(ghosts=MIXED, settings=FAST_GHOSTS, observation=("features", "scan", "grid"))
    nothing_returned_is_changed_later(play, env, 40)


def digest() -> str:
    env = pacman_env.parallel_env(ghosts=MIXED, settings={**FAST_GHOSTS, "zero_sum": False})
    results = play(env, 300)
    hashed = hashlib.sha256(repr([(result[1:-1], len(result)) for result in results]).encode())
    for result in results:
        for array in arrays(result):
            hashed.update(array.tobytes())
    return hashed.hexdigest()


def test_a_seed_makes_the_same_300_steps_in_this_process_and_in_another() -> None:
    code = "from tests.envs.test_pettingzoo_env import digest; print(digest())"
    other = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert digest() == digest() == other.stdout.strip()


def pickled(env: Any) -> Any:
    return pickle.loads(pickle.dumps(env))


@pytest.mark.parametrize("copied", [copy.deepcopy, pickled])
@pytest.mark.parametrize(
    "arguments",
    [
        {},
        {"map": "generated", "settings": {"num_levels": 3, "endless": True}},
        {"action": "velocity", "settings": {"max_cycles": 20}},
    ],
)
def test_a_copy_made_in_mid_episode_goes_on_alike(copied: Callable[[Any], Any], arguments: dict[str, Any]) -> None:
    settings = {**QUICK, "execution.death_radius_m": 0.3}
    env = pacman_env.parallel_env(ghosts=MIXED, **joined({"settings": settings}, arguments))
    play(env, 11)
    assert env.agents
    twin = copied(env)
    assert same(twin.state(), env.state())
    assert same(play(env, 60, seed=9, first=-1), play(twin, 60, seed=9, first=-1))


def test_a_copy_made_between_two_agents_turns_goes_on_alike() -> None:
    env = pacman_env.env(ghosts=("policy", "policy"))
    env.reset(seed=0)
    for action in (1, 2, 3, 4):
        env.step(action)
    for twin in (copy.deepcopy(env), pickled(env)):
        original = copy.deepcopy(env)
        for action in range(9):
            assert twin.agent_selection == original.agent_selection
            assert same(twin.last(), original.last())
            twin.step(action)
            original.step(action)


# --- rendering


def test_pictures_come_in_the_mode_asked_for() -> None:
    env = pacman_env.parallel_env(render_mode="rgb_array")
    env.reset(seed=0)
    first = env.render()
    env.step({PACMAN: 0, "clyde": 0})
    assert first.dtype == np.uint8
    assert (first.shape[0], first.shape[2]) == (720, 3)
    assert (env.render() != first).any()
    with pytest.raises(ValueError, match=r"'ansi'.*rgb_array.*human"):
        pacman_env.parallel_env(render_mode="ansi")


def test_the_window_shows_every_reset_and_step_and_closes_twice(monkeypatch: pytest.MonkeyPatch) -> None:
    pygame = pytest.importorskip("pygame")
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    env = pacman_env.parallel_env(render_mode="human")
    env.reset(seed=0)
    shown = pygame.surfarray.array3d(pygame.display.get_surface())
    env.step({PACMAN: 0, "clyde": 0})
    assert (pygame.surfarray.array3d(pygame.display.get_surface()) != shown).any()
    env.close()
    env.close()
