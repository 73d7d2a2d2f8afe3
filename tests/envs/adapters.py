"""One interface to every environment: an adapter plays an environment in the way of its library."""

import copy
import hashlib
from collections.abc import Iterable
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from gymnasium.vector import AutoresetMode

import pacman_env
from pacman_env.sb3 import PacManBotVecEnv
from tests.envs.cases import AXES, arguments, name, pairwise
from tests.envs.helpers import ID, QUICK

GAMES = 3
Observed = Iterable[tuple[spaces.Space[Any], Any]]
Ends = Iterable[tuple[Any, bool, bool]]


class Single:
    """The environment with one agent, and what the others have in common with it."""

    games = 1

    def __init__(self, **arguments: Any) -> None:
        self.env: Any = self.make(**arguments)

    def make(self, **arguments: Any) -> Any:
        return gym.make(ID, **arguments).unwrapped

    @property
    def core(self) -> Any:
        """Return the environment that has the batch and the configuration."""
        return self.env

    def reset(self, seed: int | None = None) -> Any:
        """Return everything that a reset returns."""
        return self.env.reset(seed=seed)

    def step(self, actions: Any) -> Any:
        return self.env.step(actions)

    def advance(self, actions: Any) -> list[Any]:
        """Step, and reset what is over; return the results of both."""
        result = self.step(actions)
        return [result, self.reset()] if result[2] or result[3] else [result]

    def sample(self, rng: np.random.Generator) -> Any:
        """Draw actions; the mask forbids some of them."""
        return sampled(self.env.action_space, rng)

    def bad_actions(self, good: Any) -> list[Any]:
        return bad_actions(self.env.action_space)

    def observed(self, result: Any) -> Observed:
        """Yield the observations of a result with their spaces."""
        yield self.env.observation_space, result[0]

    def infos(self, result: Any) -> Iterable[dict[str, Any]]:
        """Yield one info for each game."""
        yield result[-1]

    def ends(self, result: Any) -> Ends:
        """Yield outcome, termination and truncation of each game after a step."""
        yield result[4]["outcome"], result[2], result[3]

    def masks(self) -> Any:
        """Return the robot's masks (games, actions), None if the interface has none."""
        return np.atleast_2d(self.env.action_masks()) if self.core.config.action == "goal" else None

    def pictures(self) -> list[Any]:
        return [self.env.render()]


class Vector(Single):
    games = GAMES

    def make(self, **arguments: Any) -> Any:
        return gym.make_vec(ID, num_envs=GAMES, **arguments).unwrapped

    def advance(self, actions: Any) -> list[Any]:
        result = self.step(actions)
        over = result[2] | result[3]
        if self.env.autoreset_mode != AutoresetMode.DISABLED or not over.any():
            return [result]
        return [result, self.reset_some(over)]

    def reset_some(self, over: Any) -> Any:
        return self.env.reset(options={"reset_mask": over})

    def bad_actions(self, good: Any) -> list[Any]:
        return bad_arrays(good, self.env.single_action_space)

    def infos(self, result: Any) -> Iterable[dict[str, Any]]:
        infos = {key: value for key, value in result[1 if len(result) == 2 else 4].items() if key[0] != "_"}
        own = {key: value for key, value in infos.items() if not key.startswith("final_")}
        return ({key: value[game] for key, value in own.items()} for game in range(GAMES))

    def ends(self, result: Any) -> Ends:
        infos, over = result[4], result[2] | result[3]
        outcomes = np.where(over, infos.get("final_info", infos)["outcome"], infos["outcome"])
        return zip(outcomes, result[2], result[3], strict=True)

    def pictures(self) -> list[Any]:
        return list(self.env.render())


class Sb3(Vector):
    def make(self, **arguments: Any) -> Any:
        return PacManBotVecEnv(GAMES, **arguments)

    @property
    def core(self) -> Any:
        return self.env.env

    def reset(self, seed: int | None = None) -> Any:
        if seed is not None:
            self.env.seed(seed)
        return self.env.reset(), list(self.env.reset_infos)

    def step(self, actions: Any) -> Any:
        """Leave out how long an episode took in real time."""
        *result, infos = self.env.step(actions)
        for info in infos:
            info.get("episode", {}).pop("t", None)
        return *result, infos

    def advance(self, actions: Any) -> list[Any]:
        return [self.step(actions)]

    def sample(self, rng: np.random.Generator) -> Any:
        return np.stack([sampled(self.env.action_space, rng) for _ in range(GAMES)])

    def bad_actions(self, good: Any) -> list[Any]:
        return bad_arrays(good, self.env.action_space)

    def observed(self, result: Any) -> Observed:
        return ((self.env.observation_space, row(result[0], game)) for game in range(GAMES))

    def infos(self, result: Any) -> Iterable[dict[str, Any]]:
        extra = {"TimeLimit.truncated", "terminal_observation", "episode"}
        return ({key: value for key, value in info.items() if key not in extra} for info in result[-1])

    def ends(self, result: Any) -> Ends:
        for done, info in zip(result[2], result[3], strict=True):
            cut = info["TimeLimit.truncated"]
            yield info["outcome"], bool(done and not cut), bool(done and cut)

    def masks(self) -> Any:
        return np.stack(self.env.env_method("action_masks")) if self.core.config.action == "goal" else None

    def pictures(self) -> list[Any]:
        return list(self.env.get_images())


class Parallel(Single):
    def make(self, **arguments: Any) -> Any:
        return pacman_env.parallel_env(**arguments)

    def step(self, actions: Any) -> Any:
        return *self.env.step(actions), self.env.state()

    def advance(self, actions: Any) -> list[Any]:
        result = self.step(actions)
        return [result] if self.env.agents else [result, self.reset()]

    def sample(self, rng: np.random.Generator) -> Any:
        return {agent: sampled(self.env.action_space(agent), rng) for agent in self.env.possible_agents}

    def bad_actions(self, good: Any) -> list[Any]:
        bad = [{**good, agent: one} for agent in good for one in bad_actions(self.env.action_space(agent))]
        return [*bad, {}, *({agent: good[agent]} for agent in good)]

    def observed(self, result: Any) -> Observed:
        return ((self.env.observation_space(agent), seen) for agent, seen in result[0].items())

    def infos(self, result: Any) -> Iterable[dict[str, Any]]:
        return result[1 if len(result) == 2 else 4].values()

    def ends(self, result: Any) -> Ends:
        return ((result[4][agent]["outcome"], result[2][agent], result[3][agent]) for agent in result[0])

    def masks(self) -> Any:
        return None


class Turns(Parallel):
    """A step is a turn of every agent, and its result is what ``last()`` told them."""

    def make(self, **arguments: Any) -> Any:
        return pacman_env.env(**arguments)

    @property
    def core(self) -> Any:
        return self.env.unwrapped

    def reset(self, seed: int | None = None) -> Any:
        self.env.reset(seed=seed)
        return {}, {}

    def step(self, actions: Any) -> Any:
        told = {}
        for agent in list(self.env.agents):
            assert self.env.agent_selection == agent
            told[agent] = self.env.last()
            self.env.step(None if told[agent][2] or told[agent][3] else actions[agent])
        return *({agent: last[k] for agent, last in told.items()} for k in range(5)), self.env.state()

    def bad_actions(self, good: Any) -> list[Any]:
        first = self.env.possible_agents[0]
        return [{first: one} for one in bad_actions(self.env.action_space(first))]


class ParallelVec(Parallel):
    games = GAMES
    advance, infos, ends, pictures = Vector.advance, Vector.infos, Vector.ends, Vector.pictures  # type: ignore

    def make(self, **arguments: Any) -> Any:
        return pacman_env.parallel_vec_env(GAMES, **arguments)

    def reset_some(self, over: Any) -> Any:
        return self.env.reset(mask=over)

    def sample(self, rng: np.random.Generator) -> Any:
        agents = {agent: self.env.action_space(agent) for agent in self.env.possible_agents}
        return {agent: np.stack([sampled(space, rng) for _ in range(GAMES)]) for agent, space in agents.items()}

    def bad_actions(self, good: Any) -> list[Any]:
        bad = [{**good, a: one} for a in good for one in bad_arrays(good[a], self.env.action_space(a))]
        return [*bad, {}, None, {**good, "nobody": good[self.env.agents[0]]}]

    def observed(self, result: Any) -> Observed:
        agents = result[0].items()
        return ((self.env.observation_space(agent), row(seen, i)) for agent, seen in agents for i in range(GAMES))

    def masks(self) -> Any:
        masks = self.env.action_masks()
        return None if isinstance(masks, dict) else masks[:, 0]


def sampled(space: Any, rng: np.random.Generator) -> Any:
    space.seed(int(rng.integers(2**31)))
    return space.sample()


def bad_actions(space: Any) -> list[Any]:
    """Return what is no action of one game and agent."""
    if isinstance(space, spaces.Box):
        return [[np.nan, 0.0], [0.0, np.inf], 1, "go", None]
    return [-1, int(space.n), 2**40, 1.0, "1", None, np.array([1]), np.array(1.0)]


def bad_arrays(good: Any, space: Any) -> list[Any]:
    """Return what are no actions of several games."""
    if isinstance(space, spaces.Box):
        return [np.where([[False, True], *[[False] * 2] * (GAMES - 1)], np.nan, good), good[:2], None]
    beyond = [np.array([0, 1, bad]) for bad in (space.n, -1)]
    return [*beyond, good[:2], good[None], good + 0.0, good > 0, ["a", "b", "c"], None]


def row(data: Any, game: int) -> Any:
    """Return one game's part of an observation."""
    return {key: array[game] for key, array in data.items()} if isinstance(data, dict) else data[game]


def play(adapter: Single, steps: int, seed: int) -> list[Any]:
    """Return the results of random actions, each held for four steps, and of the resets between."""
    rng, results, actions = np.random.default_rng(seed), [], None
    for k in range(steps):
        actions = adapter.sample(rng) if k % 4 == 0 else actions
        results += adapter.advance(actions)
    return results


def fingerprint(data: Any) -> str:
    """Return a hash of nested results."""
    if isinstance(data, dict):
        text = "".join(f"{key}{fingerprint(data[key])}" for key in sorted(data))
    elif isinstance(data, (tuple, list)):
        text = "".join(map(fingerprint, data))
    elif isinstance(data, np.ndarray) and data.dtype != object:
        text = f"{data.dtype}{data.shape}{hashlib.sha256(data.tobytes()).hexdigest()}"
    else:
        text = fingerprint(data.tolist()) if isinstance(data, np.ndarray) else repr(data)
    return hashlib.sha256(text.encode()).hexdigest()


def episodes(case: str) -> str:
    """Return a fingerprint of the first episodes of a case."""
    adapter = made(case)
    return fingerprint([adapter.reset(seed=11), *play(adapter, 60, seed=1)])


def made(case: str, **more: Any) -> Single:
    adapter, chosen = CASES[case]
    return adapter(**copy.deepcopy(chosen), **more)


#: Adapters with the autoreset mode, if there is one to choose.
ADAPTERS = {
    "single": (Single, {}),
    "sb3": (Sb3, {}),
    "parallel": (Parallel, {}),
    "turns": (Turns, {}),
    **{f"vector {mode}": (Vector, {"autoreset_mode": mode}) for mode in ("NextStep", "SameStep", "Disabled")},
    **{f"parallel vector {mode}": (ParallelVec, {"autoreset_mode": mode}) for mode in ("SameStep", "Disabled")},
}
#: Adapter and arguments by name: any two of the axes' values meet.
CASES: dict[str, tuple[type[Single], dict[str, Any]]] = {}
for chosen in pairwise({"adapter": tuple(ADAPTERS), **AXES}):
    adapter, mode = ADAPTERS[chosen["adapter"]]
    CASES[name(chosen)] = adapter, {**arguments(chosen, several=issubclass(adapter, Parallel)), **mode}
#: Flat environments.
for key in ("single", "vector SameStep", "sb3", "parallel"):
    for source in ("loop", "generated"):
        settings = {**QUICK, "time_limit_s": 6.0, "endless": key == "vector SameStep"}
        adapter, mode = ADAPTERS[key]
        CASES[f"flat {key}-{source}"] = adapter, {"flat": True, "map": source, "settings": settings, **mode}
