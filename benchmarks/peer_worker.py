"""Step random actions in one library's environments and time them; :mod:`.peers` runs it as a script.

It runs with the Python of the library's own venv, without this project, and prints JSON: its tasks, or figures.
"""

import importlib
import itertools
import json
import os
import sys
import time
from collections.abc import Callable, Iterator
from functools import partial
from importlib import metadata
from typing import Any, NamedTuple

import numpy as np

SEED = 0
DRAWN = 256  # actions drawn before the measurement and reused in a cycle
ONE = (1,)
BATCHES = (1, 64)

Step = Callable[[], Any]


class Task(NamedTuple):
    name: str  # name in the library
    simulated_s: float  # simulated seconds per decision; 0: the game has no clock
    description: str  # description of a decision
    sizes: tuple[int, ...]  # numbers of parallel games
    threaded: bool  # True: the number of threads can be set
    make: Callable[[int, int], Step]  # returns a function that steps all games (number of games, threads)


def ours(map_source: str) -> list[Task]:
    """Return this project's environment, with a decision at every tick."""
    import gymnasium as gym

    from pacman_env.config import make_config

    name = "pacman_env/PacManBotFlat-v1"
    kind: dict[str, Any] = {"map": map_source, "settings": {"decisions.when": "tick"}}
    config, space = make_config(), gym.make(name, **kind).observation_space
    tick_s, step_s = config.execution.tick_s, config.physics_step_s

    def make(size: int, threads: int) -> Step:
        if size == 1:
            return alone(gym.make(name, **kind))
        env = gym.make_vec(name, num_envs=size, vectorization_mode="vector_entry_point", **kind)
        env.reset(seed=SEED)
        actions = drawn(env.action_space)
        return lambda: env.step(next(actions))

    (numbers,) = space.shape or ()
    description = (
        f"{round(tick_s / step_s)} Chipmunk steps of a robot among walls, navigation and localization as on the robot, "
        f"Clyde without a body; {numbers} numbers, the planner's features among them"
    )
    return [Task("PacManBotFlat-v1", tick_s, description, BATCHES, False, make)]


def of_envpool(_: str) -> list[Task]:
    """Return EnvPool's C++ environments, stepped synchronously; episodes restart automatically."""
    import envpool

    def make(name: str, size: int, threads: int) -> Step:
        env = envpool.make(name, env_type="gymnasium", num_envs=size, num_threads=threads, seed=SEED)
        env.reset()
        rng = np.random.default_rng(SEED)
        actions = itertools.cycle(rng.integers(env.action_space.n, size=(DRAWN, size), dtype=np.int32))
        return lambda: env.step(next(actions))

    pacman = _ATARI.format("4 x 84 x 84")
    lander = "one Box2D step of a lander, its two legs and the sparks of its engines over ground; 8 numbers"
    return [
        Task("MsPacman-v5", 4 / 60, pacman, BATCHES, True, partial(make, "MsPacman-v5")),
        Task("LunarLander-v3", 1 / 50, lander, BATCHES, True, partial(make, "LunarLander-v3")),
    ]


def of_vmas(_: str) -> list[Task]:
    """Return VMAS's navigation scenario on the CPU; its user restarts ended games."""
    import torch
    from vmas import make_env

    def make(size: int, threads: int) -> Step:
        torch.set_num_threads(threads)
        torch.manual_seed(SEED)
        env = make_env("navigation", num_envs=size, device="cpu", max_steps=100, seed=SEED)
        actions = itertools.cycle([[env.get_random_action(agent) for agent in env.agents] for _ in range(DRAWN)])

        def step() -> None:
            done = env.step(next(actions))[2]
            if done.all():
                env.reset()
            elif done.any():
                for game in done.nonzero().flatten().tolist():
                    env.reset_at(game, return_observations=False)
                env.get_from_scenario(get_observations=True, get_rewards=False, get_infos=False, get_dones=False)

        return step

    discs = "2 substeps of 4 discs that collide, all 4 actions one decision; 18 numbers each, 12 of them a lidar's"
    return [Task("navigation", 0.1, discs, BATCHES, True, make)]


def of_mpe2(_: str) -> list[Task]:
    from mpe2 import simple_tag_v3

    def make(size: int, threads: int) -> Step:
        env = simple_tag_v3.parallel_env()
        env.reset(seed=SEED)
        one_by_one = {agent: drawn(env.action_space(agent)) for agent in env.possible_agents}

        def step() -> None:
            env.step({agent: next(actions) for agent, actions in one_by_one.items()})
            if not env.agents:
                env.reset()

        return step

    discs = "one step of 4 discs among 2 obstacles in Python, the actions of all 4 one decision; 14 or 16 numbers each"
    return [Task("simple_tag_v3", 0.1, discs, ONE, False, make)]


def of_jumanji(_: str) -> list[Task]:
    """Return Jumanji's PacMan, compiled by JAX for one core; Jumanji's wrapper restarts episodes."""
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})  # before JAX starts its threads
    import jax
    import jumanji
    from jumanji.wrappers import AutoResetWrapper

    def make(size: int, threads: int) -> Step:
        env = AutoResetWrapper(jumanji.make("PacMan-v1"))
        state, _ = jax.jit(jax.vmap(env.reset))(jax.random.split(jax.random.PRNGKey(SEED), size))
        step_all = jax.jit(jax.vmap(env.step), donate_argnums=0)
        rng = np.random.default_rng(SEED)
        actions = itertools.cycle(rng.integers(5, size=(DRAWN, size), dtype=np.int32))

        def step() -> None:
            nonlocal state
            state, timestep = step_all(state, next(actions))
            timestep.reward.block_until_ready()

        return step

    pacman = "one cell of a 31 x 28 maze that is always the same, 4 ghosts; the maze and lists of places"
    return [Task("PacMan-v1", 0.0, pacman, BATCHES, False, make)]


def of_gymnasium(library: str, _: str) -> list[Task]:
    """Return the single environments of a library."""
    import gymnasium as gym

    def make(env_id: str, size: int, threads: int) -> Step:
        return alone(gym.make(env_id))

    gym.register_envs(importlib.import_module(library.replace("-", "_")))
    entries = [one for name, *one in SINGLE if name == library]
    return [Task(env_id, lasts_s, text, ONE, False, partial(make, env_id)) for env_id, lasts_s, text in entries]


_ATARI = "4 frames of an Atari 2600 that is emulated, drawn: {} values; no physics"
_GRID = "one cell, or a quarter turn, of a grid of 8 x 8 in Python, 4 obstacles that move; 7 x 7 x 3 numbers"
_CARS = "{} steps of {} cars in Python that drive by models of drivers; 5 x 5 numbers"
#: Library, id, simulated seconds and description of single environments of Gymnasium.
SINGLE: tuple[tuple[Any, ...], ...] = (
    ("ale-py", "ALE/MsPacman-v5", 4 / 60, _ATARI.format("210 x 160 x 3")),
    ("minigrid", "MiniGrid-Dynamic-Obstacles-8x8-v0", 0.0, _GRID),
    ("highway-env", "highway-v0", 1.0, _CARS.format(15, 51)),
    ("highway-env", "highway-fast-v0", 1.0, _CARS.format(5, 21)),
)
LIBRARIES: dict[str, Callable[[str], list[Task]]] = {
    "pacman_env": ours,
    "envpool": of_envpool,
    "vmas": of_vmas,
    "mpe2": of_mpe2,
    "jumanji": of_jumanji,
    **{name: partial(of_gymnasium, name) for name, *_ in SINGLE},
}


def drawn(space: Any) -> Iterator[Any]:
    """Return a cycle of random actions of a Gymnasium space, drawn now."""
    space.seed(SEED)
    return itertools.cycle([space.sample() for _ in range(DRAWN)])


def alone(env: Any) -> Step:
    env.reset(seed=SEED)
    actions = drawn(env.action_space)

    def step() -> None:
        _, _, terminated, truncated, _ = env.step(next(actions))
        if terminated or truncated:
            env.reset()

    return step


def turn(step: Step, size: int, seconds: float) -> dict[str, float]:
    """Step for ``seconds``, at least once; return decisions per second and CPU time divided by wall time."""
    steps, cpu, began = 0, time.process_time(), time.perf_counter()
    while True:
        step()
        steps += 1
        took = time.perf_counter() - began
        if took >= seconds:
            return {"decisions_per_s": steps * size / took, "cores": (time.process_time() - cpu) / took}


def reason(error: Exception) -> str:
    if isinstance(error, ModuleNotFoundError):
        return f"{error.name} is not installed"
    return " ".join(f"{type(error).__name__}: {error}".split())


def main(library: str, map_source: str, case: str) -> None:
    """Print the tasks, or measure a case: number of the task, games, threads and seconds."""
    with os.fdopen(os.dup(1), "w") as out:
        os.dup2(2, 1)  # keep the library's output out of the answer
        try:
            tasks = LIBRARIES[library](map_source)
            if wanted := json.loads(case):
                number, size, threads, seconds = wanted
                step = tasks[number].make(size, threads)
                turn(step, size, seconds)  # warm-up
                answer: dict[str, Any] = turn(step, size, seconds)
            else:
                version = getattr(sys.modules.get(library), "__version__", None) or metadata.version(library)
                answer = {"version": version, "tasks": [{**task._asdict(), "make": None} for task in tasks]}
        except Exception as error:
            answer = {"error": reason(error)}
        json.dump(answer, out)


if __name__ == "__main__":
    main(*sys.argv[1:])
