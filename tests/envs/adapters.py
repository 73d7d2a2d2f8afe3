"""One interface to every environment: an adapter plays an environment in the way of its library."""

from __future__ import annotations

import copy
import hashlib
from collections.abc import Iterable
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces

import pacman_env
from pacman_env.sb3 import PacManBotVecEnv
from tests.envs.cases import AXES, arguments, name, pairwise
from tests.envs.helpers import ID, QUICK

GAMES = 3


class Adapter:
    """The environment with one agent, and what the others have in common with it."""

    several = False  # agents
    games = 1

    def __init__(self, **arguments: Any) -> None:
        self.env: Any = self.make(**arguments)

    def make(self, **arguments: Any) -> Any:
        return gym.make(ID, **arguments).unwrapped

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

    @property
    def batch(self) -> Any:
        return self.env.batch

    @property
    def config(self) -> Any:
        return self.env.config

    def observed(self, result: Any) -> Iterable[tuple[spaces.Space[Any], Any]]:
        """Yield the observations of a result with their spaces."""
        yield self.env.observation_space, result[0]

    def infos(self, result: Any) -> Iterable[dict[str, Any]]:
        """Yield one info for each game."""
        yield result[-1]

    def ends(self, result: Any) -> Iterable[tuple[Any, bool, bool]]:
        """Yield outcome, termination and truncation of each game after a step."""
        yield result[4]["outcome"], result[2], result[3]

    def masks(self) -> Any:
        """Return the robot's masks (games, actions), None if the interface has none."""
        return np.atleast_2d(self.env.action_masks()) if self.config.action == "goal" else None

    def pictures(self) -> list[Any]:
        return [self.env.render()]

    def asks(self) -> list[Any]:
        """Return calls that need a reset before."""
        return [lambda: self.env.step(self.sample(np.random.default_rng(0))), lambda: self.env.situation]


class Flat(Adapter):
    def make(self, **arguments: Any) -> Any:
        return super().make(flat=True, **arguments)


class Vector(Adapter):
    games = GAMES
    mode = "NextStep"

    def make(self, **arguments: Any) -> Any:
        return gym.make_vec(ID, num_envs=GAMES, autoreset_mode=self.mode, **arguments).unwrapped

    def advance(self, actions: Any) -> list[Any]:
        return [self.step(actions)]

    def bad_actions(self, good: Any) -> list[Any]:
        return bad_arrays(good, self.env.single_action_space)

    def infos(self, result: Any) -> Iterable[dict[str, Any]]:
        own = {key: value for key, value in result[-1].items() if not key.lstrip("_").startswith("final_")}
        return ({key: value[game] for key, value in own.items() if key[0] != "_"} for game in range(GAMES))

    def ends(self, result: Any) -> Iterable[tuple[Any, bool, bool]]:
        infos, over = result[4], result[2] | result[3]
        final = infos.get("final_info", infos)
        outcomes = np.where(over, final["outcome"], infos["outcome"])
        return zip(outcomes, result[2], result[3], strict=True)

    def pictures(self) -> list[Any]:
        return list(self.env.render())


class VectorSameStep(Vector):
    mode = "SameStep"


class VectorDisabled(Vector):
    mode = "Disabled"

    def advance(self, actions: Any) -> list[Any]:
        result = self.step(actions)
        over = result[2] | result[3]
        return [result, self.env.reset(options={"reset_mask": over})] if over.any() else [result]


class FlatVector(Vector):
    def make(self, **arguments: Any) -> Any:
        return super().make(flat=True, **arguments)


class Sb3(Vector):
    def make(self, **arguments: Any) -> Any:
        return PacManBotVecEnv(GAMES, **arguments)

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

    def sample(self, rng: np.random.Generator) -> Any:
        return np.stack([sampled(self.env.action_space, rng) for _ in range(GAMES)])

    def bad_actions(self, good: Any) -> list[Any]:
        return bad_arrays(good, self.env.action_space)

    @property
    def batch(self) -> Any:
        return self.env.env.batch

    @property
    def config(self) -> Any:
        return self.env.env.config

    def observed(self, result: Any) -> Iterable[tuple[spaces.Space[Any], Any]]:
        for game in range(GAMES):
            yield self.env.observation_space, row(result[0], game)

    def infos(self, result: Any) -> Iterable[dict[str, Any]]:
        extra = {"TimeLimit.truncated", "terminal_observation", "episode"}
        return ({key: value for key, value in info.items() if key not in extra} for info in result[-1])

    def ends(self, result: Any) -> Iterable[tuple[Any, bool, bool]]:
        for done, info in zip(result[2], result[3], strict=True):
            cut = info["TimeLimit.truncated"]
            yield info["outcome"], bool(done and not cut), bool(done and cut)

    def masks(self) -> Any:
        return np.stack(self.env.env_method("action_masks")) if self.config.action == "goal" else None

    def pictures(self) -> list[Any]:
        return list(self.env.get_images())

    def asks(self) -> list[Any]:
        return super().asks()[:1]


class FlatSb3(Sb3):
    def make(self, **arguments: Any) -> Any:
        return super().make(flat=True, **arguments)


class Parallel(Adapter):
    several = True

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

    def observed(self, result: Any) -> Iterable[tuple[spaces.Space[Any], Any]]:
        return ((self.env.observation_space(agent), seen) for agent, seen in result[0].items())

    def infos(self, result: Any) -> Iterable[dict[str, Any]]:
        return result[-1 if len(result) == 2 else 4].values()

    def ends(self, result: Any) -> Iterable[tuple[Any, bool, bool]]:
        return ((result[4][agent]["outcome"], result[2][agent], result[3][agent]) for agent in result[0])

    def masks(self) -> Any:
        return None

    def asks(self) -> list[Any]:
        return [*super().asks(), self.env.state]


class FlatParallel(Parallel):
    def make(self, **arguments: Any) -> Any:
        return super().make(flat=True, **arguments)


class Aec(Parallel):
    """A step is a turn of every agent, and its result is what ``last()`` told them."""

    def make(self, **arguments: Any) -> Any:
        return pacman_env.env(**arguments)

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
        return [{**good, first: one} for one in bad_actions(self.env.action_space(first))]

    @property
    def batch(self) -> Any:
        return self.env.unwrapped.batch

    @property
    def config(self) -> Any:
        return self.env.unwrapped.config

    def asks(self) -> list[Any]:
        return []  # PettingZoo's own wrapper refuses


class ParallelVec(Parallel):
    games = GAMES
    mode = "SameStep"

    def make(self, **arguments: Any) -> Any:
        return pacman_env.parallel_vec_env(GAMES, autoreset_mode=self.mode, **arguments)

    def advance(self, actions: Any) -> list[Any]:
        result = self.step(actions)
        over = result[2] | result[3]
        return [result, self.env.reset(mask=over)] if self.mode == "Disabled" and over.any() else [result]

    def sample(self, rng: np.random.Generator) -> Any:
        agents = {agent: self.env.action_space(agent) for agent in self.env.possible_agents}
        return {agent: np.stack([sampled(space, rng) for _ in range(GAMES)]) for agent, space in agents.items()}

    def bad_actions(self, good: Any) -> list[Any]:
        bad = [{**good, a: one} for a in good for one in bad_arrays(good[a], self.env.action_space(a))]
        return [*bad, {}, None, {**good, "nobody": good[self.env.agents[0]]}]

    def observed(self, result: Any) -> Iterable[tuple[spaces.Space[Any], Any]]:
        for agent, seen in result[0].items():
            for game in range(GAMES):
                yield self.env.observation_space(agent), row(seen, game)

    def infos(self, result: Any) -> Iterable[dict[str, Any]]:
        return Vector.infos(self, (result[1] if len(result) == 2 else result[4],))  # type: ignore[arg-type]

    def ends(self, result: Any) -> Iterable[tuple[Any, bool, bool]]:
        return Vector.ends(self, result)  # type: ignore[arg-type]

    def masks(self) -> Any:
        masks = self.env.action_masks()
        return None if isinstance(masks, dict) else masks[:, 0]

    def pictures(self) -> list[Any]:
        return list(self.env.render())


class ParallelVecDisabled(ParallelVec):
    mode = "Disabled"


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


def play(adapter: Adapter, steps: int, seed: int) -> list[Any]:
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


def episodes(case: str) -> Any:
    """Return a fingerprint of the first episodes of a case."""
    adapter = made(case)
    return fingerprint([adapter.reset(seed=11), *play(adapter, 60, seed=1)])


ADAPTERS = (Adapter, Vector, VectorSameStep, VectorDisabled, Sb3, Parallel, Aec, ParallelVec, ParallelVecDisabled)
#: Adapter and arguments by name: any two of the axes' values meet, and flat environments on one map and on many.
CASES: dict[str, tuple[type[Adapter], dict[str, Any]]] = {
    f"{chosen['adapter'].__name__}-{name({**chosen, 'adapter': ''})}": (
        chosen["adapter"],
        arguments(chosen, chosen["adapter"].several),
    )
    for chosen in pairwise({"adapter": ADAPTERS, **AXES})
}
CASES |= {
    f"{adapter.__name__}-{source}": (
        adapter,
        {"map": source, "settings": {**QUICK, "time_limit_s": 6.0, "endless": adapter is FlatVector}},
    )
    for adapter in (Flat, FlatVector, FlatSb3, FlatParallel)
    for source in ("loop", "generated")
}


def made(case: str, **more: Any) -> Adapter:
    adapter, chosen = CASES[case]
    return adapter(**copy.deepcopy(chosen), **more)
