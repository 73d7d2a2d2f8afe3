"""What is particular to the environments with several agents: who they are, what they see, get and play."""

import re
from typing import Any

import numpy as np
import pytest

import pacman_env
from pacman_env.config import Config, ConfigError, RewardConfig, make_config
from pacman_env.envs.pettingzoo_env import PACMAN, PacManBotParallelEnv
from tests.envs.adapters import sampled
from tests.envs.cases import PAIRWISE, SEVERAL_LEARNERS, arguments, name
from tests.envs.helpers import QUICK, make, same

MIXED = ("policy", "chase", "arcade", "policy")
FAST_GHOSTS = {**QUICK, "clyde.speed_mps": 0.8}


def actions_of(env: PacManBotParallelEnv, rng: np.random.Generator) -> dict[str, Any]:
    """Draw actions of every agent; the masks forbid some of them."""
    return {agent: sampled(env.action_space(agent), rng) for agent in env.agents}


# --- one world


@pytest.mark.parametrize("row", PAIRWISE, ids=name)
def test_pacman_plays_gymnasium_game_against_wandering_ghosts(row: dict[str, Any]) -> None:
    # A frightened ghost of a policy obeys, all others would flee.
    chosen = arguments(row, several=True, **{"power.behaviour": "wander"})
    env = pacman_env.parallel_env(**chosen)
    wandering = ["wander" if ghost == "policy" else ghost for ghost in chosen.pop("ghosts")]
    single = make(ghosts=wandering, **chosen)
    assert env.observation_space(PACMAN) == single.observation_space
    assert env.action_space(PACMAN) == single.action_space
    rng = np.random.default_rng(1)
    for seed in (7, None, None):
        observations, infos = env.reset(seed=seed)
        assert same((observations[PACMAN], infos[PACMAN]), single.reset(seed=seed))
        while env.agents:
            actions = {**dict.fromkeys(env.agents, env.batch.hold), PACMAN: actions_of(env, rng)[PACMAN]}
            results = env.step(actions)
            assert same(tuple(result[PACMAN] for result in results), single.step(actions[PACMAN]))


def test_turn_based_game_equals_parallel_game() -> None:
    parallel = pacman_env.parallel_env(ghosts=MIXED, settings={**FAST_GHOSTS, "zero_sum": False})
    turns = pacman_env.env(ghosts=MIXED, settings={**FAST_GHOSTS, "zero_sum": False})
    rng = np.random.default_rng(0)
    for episode in range(4):
        observations, infos = parallel.reset(seed=3 if episode == 0 else None)
        turns.reset(seed=3 if episode == 0 else None)
        rewards, terminated, truncated = (dict.fromkeys(parallel.agents, value) for value in (0, False, False))
        asked, actions = [], actions_of(parallel, rng)
        for agent in turns.agent_iter():
            expected = (observations, rewards, terminated, truncated, infos)
            assert same(turns.last(), tuple(part[agent] for part in expected))
            np.testing.assert_array_equal(turns.state(), parallel.state())
            turns.step(actions.get(agent))
            asked.append(agent)
            if len(asked) == len(parallel.agents):
                assert asked == parallel.agents
                observations, rewards, terminated, truncated, infos = parallel.step(actions)
                asked, actions = [], actions_of(parallel, rng)
        assert sorted(asked) == sorted(parallel.possible_agents)  # each was told of the end


def test_wrong_action_of_turn_is_refused_and_correctable() -> None:
    env, twin = pacman_env.env(), pacman_env.parallel_env()
    env.reset(seed=1)
    twin.reset(seed=1)
    for agent in (PACMAN, "clyde"):
        for bad in (24, None):
            with pytest.raises(ValueError, match=f"action {bad} of {agent} is not in {re.escape('Discrete(24)')}"):
                env.step(bad)
        env.step(2)
    assert same(env.last()[0], twin.step({PACMAN: 2, "clyde": 2})[0][PACMAN])


@pytest.mark.parametrize("shape", [shape for shape in SEVERAL_LEARNERS if shape != "nearest"])
def test_observation_shape_does_not_change_game(shape: str) -> None:
    chosen = SEVERAL_LEARNERS[shape]
    env = pacman_env.parallel_env(map="loop", **chosen)
    plain = pacman_env.parallel_env(map="loop", ghosts=chosen.get("ghosts", ("policy",)))
    (observations, infos), (seen, _) = env.reset(seed=4), plain.reset(seed=4)
    if "flat" in chosen["observation"]:
        assert env.observation_space(PACMAN) == env.observation_space("clyde")
    rng, where = np.random.default_rng(4), chosen["settings"]["observation.mask"]
    while env.agents:
        for agent in env.agents:
            mask = seen[agent]["action_mask"]
            if where != "method":
                own = infos[agent] if where == "info" else observations[agent]
                assert same(own["action_mask"], mask)
            if "observation.normalize" in chosen["settings"]:
                row = observations[agent] if where == "info" else observations[agent]["observation"]
                assert np.abs(row).max() <= 1.0
                assert all(isinstance(value, (int, float, np.ndarray)) for value in infos[agent].values())
        actions = actions_of(plain, rng)
        observations, rewards, *_, infos = env.step(actions)
        seen, expected, *_ = plain.step(actions)
        assert rewards == expected
    assert not plain.agents


# --- agents, what they see and may do


@pytest.mark.parametrize(
    ("ghosts", "agents"),
    [
        (None, ["pacman", "clyde"]),
        (("policy",) * 4, ["pacman", "clyde", "blinky", "pinky", "inky"]),
        (("wander", "policy", "chase"), ["pacman", "blinky"]),
    ],
)
def test_agents_are_pacman_and_policy_ghosts(ghosts: Any, agents: list[str]) -> None:
    env = pacman_env.parallel_env(ghosts=ghosts)
    assert env.metadata["name"] == "pacmanbot_v0"
    assert env.possible_agents == agents
    assert env.agents == []
    observations, infos = env.reset(seed=0)
    assert env.agents == list(observations) == list(infos) == agents


def test_ghost_observes_itself_as_clyde() -> None:
    env = pacman_env.parallel_env(ghosts=MIXED, settings=FAST_GHOSTS)
    env.reset(seed=0)
    rng = np.random.default_rng(0)
    for _ in range(60):
        seen = env.step(actions_of(env, rng))[0] if env.agents else env.reset()[0]
        for agent, seat in (("clyde", 0), ("inky", 3)):
            np.testing.assert_array_equal(seen[agent]["clyde"][[0, 1, 2, 3, 4, 6]], seen[agent]["ghosts"][seat])
        nearest = seen[PACMAN]["ghosts"][:, 4].argmin()
        np.testing.assert_array_equal(seen[PACMAN]["clyde"][:2], seen[PACMAN]["ghosts"][nearest, :2])


def test_forbidden_goal_makes_ghost_keep_wandering() -> None:
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


def test_ghost_observes_its_current_goal() -> None:
    env = pacman_env.parallel_env()
    env.reset(seed=0)
    for place in (3, 3, 11, 20):
        observations = env.step({PACMAN: 0, "clyde": place})[0]
        np.testing.assert_array_equal(np.flatnonzero(observations["clyde"]["candidates"][:, 3]), [place])


def test_state_contains_true_game_values_by_name() -> None:
    settings = {**FAST_GHOSTS, "power.pellets": 99}  # all of them
    env = pacman_env.parallel_env(ghosts=MIXED, settings=settings, map="maze")
    env.reset(seed=2)
    names, apart, rng, frightened = env.state_names, [], np.random.default_rng(0), False
    assert len(names) == len(set(names)) == env.state_space.shape[0]
    for k in range(120):
        actions = actions_of(env, rng) if k % 6 == 0 and env.agents else actions  # noqa: F821
        observations = env.step(actions)[0] if env.agents else env.reset()[0]
        assert env.state_space.contains(env.state())
        state = dict(zip(names, env.state().tolist(), strict=True))
        g, batch = env.batch.games[0], env.batch
        assert (state["x"], state["y"]) == (g["x"], g["y"])
        assert np.cos(state["heading"] - g["heading"]) == pytest.approx(1.0)
        assert -np.pi <= state["heading"] <= np.pi
        robot = observations[PACMAN]["robot"]
        believed = [state["believed_x"], state["believed_y"], *(f(state["believed_heading"]) for f in (np.cos, np.sin))]
        np.testing.assert_allclose(robot[:6], [*believed, state["v"], state["omega"]], atol=1e-6)
        for number, ghost in enumerate(("clyde", "blinky", "pinky", "inky")):
            expected = [batch.ghosts[0, number][part] for part in ("x", "y", "vx", "vy")]
            assert [state[f"{ghost}_{part}"] for part in ("x", "y", "vx", "vy")] == expected
            power = [state[f"{ghost}_{part}"] for part in ("frightened_s", "away_s")]
            assert np.float32(power).tolist() == observations[PACMAN]["ghost_power"][number, [1, 3]].tolist()
            frightened |= power[0] > 0
        pellets = [state[f"pellet_{k}"] for k in range(batch.pellet_slots)]
        assert pellets == batch.alive[0].astype(float).tolist()
        assert [state["time"], sum(pellets)] == observations[PACMAN]["round"].tolist()
        assert (state["round"], state["score"]) == (1, g["score"])
        apart.append(np.hypot(state["x"] - state["believed_x"], state["y"] - state["believed_y"]))
    assert frightened
    assert max(apart) > 0.01  # what the robot believes is not true


# --- rewards and ends


def test_zero_sum_rewards_are_shared_by_ghosts() -> None:
    ghosts = ("policy", "policy", "wander", "policy")
    env = pacman_env.parallel_env(ghosts=ghosts, settings={**FAST_GHOSTS, "endless": True})
    env.reset(seed=5)
    rng, seen = np.random.default_rng(0), set()
    for k in range(200):
        if not env.agents:
            env.reset()
        actions = actions_of(env, rng) if k % 4 == 0 else actions  # noqa: F821
        pacman, *others = env.step(actions)[1].values()
        assert sum(others) == pytest.approx(-pacman, abs=1e-12)
        assert len(set(others)) == 1
        assert type(pacman) is type(others[0]) is float
        seen.add(round(pacman))
    assert {-10, 0, 1} <= seen


def greedy(observation: dict[str, np.ndarray]) -> int:
    """Return the pellet nearest by path."""
    pellet = (observation["candidates"][:, 0] == 1) & (observation["action_mask"] == 1)
    return int(np.where(pellet, observation["candidates"][:, 7], np.inf).argmin())


OWN = RewardConfig(pellet=-1.0, death=3.0, completion=0.25, tick=0.5, timeout=-0.75)


@pytest.mark.parametrize("more", [{}, {"ghost_reward": OWN}], ids=["default", "own"])
def test_separate_ghost_rewards_follow_configuration(more: dict[str, Any]) -> None:
    chosen = {**QUICK, "clyde.ghosts": ("policy", "wander", "policy"), "zero_sum": False, **more}
    env, seen = pacman_env.parallel_env(settings=make_config("robot", **chosen)), set()
    reward = env.config.ghost_reward
    ends = {"caught": reward.death, "complete": reward.completion, "timeout": reward.timeout, "running": 0.0}
    for seed in range(25):
        observations, infos = env.reset(seed=seed)
        while env.agents:
            goal, before = greedy(observations[PACMAN]) if seed % 4 else env.batch.hold, infos[PACMAN]["collected"]
            actions = {PACMAN: goal, "clyde": 0, "pinky": 1}
            observations, rewards, terminated, truncated, infos = env.step(actions)
            outcome, gained = infos[PACMAN]["outcome"], infos[PACMAN]["collected"] - before
            expected = reward.tick + gained * reward.pellet + ends[outcome]
            assert rewards["clyde"] == rewards["pinky"] == pytest.approx(expected, abs=1e-12)
            assert terminated == dict.fromkeys(actions, outcome in ("caught", "complete"))
            assert truncated == dict.fromkeys(actions, outcome == "timeout")
            assert bool(env.agents) == (outcome == "running")
            seen.add(outcome)
        assert env.step({}) == env.step({PACMAN: 0, "clyde": 0}) == ({}, {}, {}, {}, {})
    assert seen == ends.keys()


# --- refusals, generator


@pytest.mark.parametrize(
    ("chosen", "message"),
    [
        ({"ghosts": 2}, "at least one must have the behaviour 'policy'"),
        ({"settings": Config()}, "at least one must have the behaviour 'policy'"),
        ({"settings": {"decisions.when": "event"}}, "decisions.when='event' is for one agent"),
    ],
)
def test_unplayable_argument_is_named(chosen: dict[str, Any], message: str) -> None:
    for interface in (pacman_env.parallel_env, pacman_env.env, pacman_env.parallel_vec_env):
        with pytest.raises(ConfigError, match=message):
            interface(**chosen)


@pytest.mark.parametrize("maker", [pacman_env.parallel_env, pacman_env.env])
def test_wrappers_draw_from_the_environment_generator(maker: Any) -> None:
    """As SuperSuit's ``frame_skip_v0`` does, before and after a reset."""
    env, twin = maker(map="loop").unwrapped, maker(map="loop").unwrapped
    assert 0 <= env.np_random.integers(10) < 10
    seeds = []
    for one in (env, twin):
        one.reset(seed=5)
        one.np_random.integers(4, 5)
        one.reset()
        seeds.append(int(one.batch.games["seed"][0]))
    assert seeds[0] == seeds[1]
