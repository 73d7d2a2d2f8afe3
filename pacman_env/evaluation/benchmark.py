"""The speed of the environments: ``pacman-env benchmark``.

Decisions per second of the native vector environment at 64 and 1,024 games and of the unwrapped single environment;
in the same run, in turns with it, bare Chipmunk stepping of the same bodies among the same walls, as decisions that
cost nothing but physics; what a second ``gymnasium.make`` of the same map costs, and what a generated house for each
episode costs; decisions by events (``PacManBotFlat-v0``), with the time that they simulate; 64 houses at once, and 64
games with the planner's features. All of that in one thread. Then 1,024 games with 1, 2, 4 ... threads, and a new
house for each episode of 64 games, whose houses two threads prepare while they are played.
Machines are noisy: the ratio is the median over rounds of figures measured one after the other.
"""

import argparse
import platform
import sys
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np

import pacman_env
from pacman_env.cli.command import Parser, count, finite_number, run_command
from pacman_env.engine.cores import cores
from pacman_env.envs.pacmanbot import PacManBotEnv
from pacman_env.envs.pacmanbot_vector import PacManBotVectorEnv
from pacman_env.files import prepare, write_json
from pacman_env.world.navigation.physics import bare_stepper

HELD = 20  # decisions for which a random action is held: about what a planner does
ROUNDS = 9


def vector_rate(env: PacManBotVectorEnv, rng: np.random.Generator, steps: int) -> float:
    """Decisions per second over ``steps`` steps with random goals, each held for a while."""
    choices = rng.integers(0, env.batch.candidates, size=(steps // HELD + 1, env.num_envs))
    began = time.perf_counter()
    for k in range(steps):
        env.step(choices[k // HELD])
    return steps * env.num_envs / (time.perf_counter() - began)


def single_rate(env: PacManBotEnv, rng: np.random.Generator, steps: int) -> float:
    """Decisions per second of the unwrapped single environment, resets included."""
    choices = rng.integers(0, env.batch.candidates, size=steps // HELD + 1).tolist()
    began = time.perf_counter()
    for k in range(steps):
        _, _, terminated, truncated, _ = env.step(choices[k // HELD])
        if terminated or truncated:
            env.reset()
    return steps / (time.perf_counter() - began)


def bare_rate(env: PacManBotVectorEnv, steps: int) -> float:
    """Decisions per second if a decision were only physics: all robots in one space of Chipmunk's, from Python."""
    robot = env.config.robot
    step = bare_stepper(
        env.batch.assets.grid.walls,
        env.batch.bodies[:, :2],
        radius_m=robot.radius_m,
        mass_kg=robot.mass_kg,
        step_s=env.config.physics_step_s,
        speed_mps=robot.speed_mps,
    )
    began = time.perf_counter()
    step(steps * env.batch.substeps)
    return steps * env.num_envs / (time.perf_counter() - began)


def make_vector(n: int, map_source: str, flat: bool = False, **arguments: Any) -> PacManBotVectorEnv:
    kind = {"vectorization_mode": "vector_entry_point", "map": map_source, **arguments}
    env = gym.make_vec(f"pacman_env/PacManBot{'Flat' if flat else ''}-v0", num_envs=n, **kind).unwrapped
    assert isinstance(env, PacManBotVectorEnv)
    env.reset(seed=0)
    if flat:
        event_rates(env, HELD)
    else:
        vector_rate(env, np.random.default_rng(0), 2 * HELD)
    return env


def event_rates(env: PacManBotVectorEnv, steps: int) -> tuple[float, float]:
    """Decisions and simulated seconds per second, decided by events: the nearest pellet each time."""
    actions, simulated = np.zeros(env.num_envs, dtype=np.int64), 0.0
    began = time.perf_counter()
    for _ in range(steps):
        simulated += float(env.step(actions)[4]["elapsed_s"].sum())
    took = time.perf_counter() - began
    return steps * env.num_envs / took, simulated / took


def milliseconds(action: Callable[[], Any]) -> float:
    began = time.perf_counter()
    action()
    return 1000 * (time.perf_counter() - began)


def make_again_ms(map_source: str, repeats: int) -> float:
    """Milliseconds of a ``gymnasium.make`` of a map that was made before."""
    make = partial(gym.make, "pacman_env/PacManBot-v0", map=map_source)
    make()
    return float(np.median([milliseconds(make) for _ in range(repeats)]))


def new_level_ms(env: PacManBotVectorEnv, episodes: int) -> float:
    """Milliseconds that an episode on a generated house of its own adds to 64 games: draw, prepare, build, start.

    Slots are used before: memory that the system has to find first is not what a level costs.
    """
    seeds = np.random.default_rng(0).integers(2**63, size=64 + episodes, dtype=np.uint64)
    starts = [(np.array([k % 64]), np.array([seed])) for k, seed in enumerate(seeds)]
    return float(np.mean([milliseconds(partial(env.batch.reset, *start)) for start in starts][64:]))


def run(map_source: str, rounds: int, seconds: float) -> dict[str, Any]:
    """All figures; ``seconds`` is roughly what each figure may take."""
    rng = np.random.default_rng(0)
    env = make_vector(64, map_source)
    houses = make_vector(64, "generated")
    level_ms = new_level_ms(houses, max(8, round(50 * seconds)))
    steps = max(HELD, int(seconds / rounds * vector_rate(env, rng, 4 * HELD) / 64))
    full, bare = np.array([(vector_rate(env, rng, steps), bare_rate(env, steps)) for _ in range(rounds)]).T
    ratios = full / bare

    numbers = sorted({1, 2, max(2, cores()), *(2**k for k in range(10) if 2**k <= cores())})
    by_threads = {threads: make_vector(1024, map_source, num_threads=threads) for threads in numbers}
    many_steps = max(4, int(seconds / rounds * np.median(full) / 1024))
    turns = [[vector_rate(many, rng, many_steps) for many in by_threads.values()] for _ in range(rounds)]
    threads = {str(number): float(rate) for number, rate in zip(by_threads, np.median(turns, axis=0), strict=True)}
    for many in by_threads.values():
        many.close()
    del by_threads, many

    def median(measure: Callable[[], Any]) -> Any:
        return np.median([measure() for _ in range(rounds)], axis=0).tolist()

    featured = make_vector(64, map_source, observation="planner")
    same_houses = make_vector(64, "generated", settings={"num_levels": 64})
    more_steps = max(4, steps // 4)
    features = median(lambda: vector_rate(featured, rng, more_steps))
    at_once = median(lambda: vector_rate(same_houses, rng, more_steps) / vector_rate(env, rng, more_steps))
    new_houses = make_vector(64, "generated", num_threads=2)
    house_steps = max(4, steps // 20)
    vector_rate(new_houses, rng, house_steps)
    per_episode = median(lambda: vector_rate(new_houses, rng, house_steps))
    by_events = make_vector(64, map_source, flat=True)
    decisions, simulated = median(lambda: event_rates(by_events, max(4, steps // 8)))

    single = gym.make("pacman_env/PacManBot-v0", map=map_source).unwrapped
    assert isinstance(single, PacManBotEnv)
    single.reset(seed=0)
    single_rate(single, rng, 4 * HELD)
    single_steps = max(HELD, int(seconds / rounds * 8000))
    rate = float(np.median(full))
    return {
        "decisions_per_s": {
            "1": median(lambda: single_rate(single, rng, single_steps)),
            "64": rate,
            "1024": threads["1"],
        },
        "threads": threads,
        "houses_64": at_once * rate,
        "houses_64_ratio": at_once,
        "new_house_per_episode": per_episode,
        "features_64": features,
        "event_decisions_per_s_64": decisions,
        "event_simulated_s_per_s_64": simulated,
        "tick_simulated_s_per_s_64": rate * env.config.execution.tick_s,
        "bare_decisions_per_s_64": float(np.median(bare)),
        "bare_ratio_64": float(np.median(ratios)),
        "bare_ratio_64_range": [float(ratios.min()), float(ratios.max())],
        "make_again_ms": make_again_ms(map_source, rounds),
        "new_level_ms": level_ms,
        "generated_decisions_per_s_64": vector_rate(houses, rng, steps),
        "map": env.batch.assets.occupancy.name,
        "map_hash": env.batch.assets.occupancy.hash,
        "wall_segments": len(env.batch.assets.grid.walls),
        "version": pacman_env.__version__,
        "python": platform.python_version(),
        "processor": platform.processor() or platform.machine(),
    }


def main(argv: Sequence[str] | None = None) -> int:
    return run_command(make_parser(), argv, _report)


def make_parser() -> Parser:
    parser = Parser(prog="pacman-env benchmark", description=__doc__)
    parser.add_argument("--map", default="house", help="name or YAML file")
    parser.add_argument("--rounds", type=count(), default=ROUNDS)
    seconds = finite_number(0, 3600)
    parser.add_argument("--seconds", type=seconds, default=6.0, help="roughly what each figure may take")
    parser.add_argument("--json", type=Path, help="write the figures here")
    return parser


def _report(arguments: argparse.Namespace) -> None:
    if arguments.json:
        prepare(arguments.json)
    figures = run(arguments.map, arguments.rounds, arguments.seconds)
    rates, (low, high) = figures["decisions_per_s"], figures["bare_ratio_64_range"]
    simulated, ticks = figures["event_simulated_s_per_s_64"], figures["tick_simulated_s_per_s_64"]
    print(
        f"map {figures['map']}, {figures['wall_segments']} wall segments, one thread unless a number is given",
        *(f"  N = {n:>4}: {rates[n]:9,.0f} decisions/s" for n in ("1", "64", "1024")),
        f"  bare Chipmunk, 64 bodies: {figures['bare_decisions_per_s_64']:9,.0f} decisions/s",
        f"  ratio to bare at 64: {figures['bare_ratio_64']:.3f} ({low:.3f} to {high:.3f})",
        f"  N = 1,024 against 64: {rates['1024'] / rates['64']:.2f}",
        f"  64 houses: {figures['houses_64']:9,.0f} decisions/s, {figures['houses_64_ratio']:.2f} of one house",
        f"  planner's features, 64: {figures['features_64']:9,.0f} decisions/s",
        *(
            f"  1,024 games, {number:>2} threads: {rate:9,.0f} decisions/s, {rate / rates['1024']:.2f} of one"
            for number, rate in figures["threads"].items()
        ),
        f"  a new house per episode, 64 games, 2 threads: {figures['new_house_per_episode']:9,.0f} decisions/s",
        f"  decided by events, planner's numbers, 64: {figures['event_decisions_per_s_64']:9,.0f} decisions/s,",
        f"    {simulated:,.0f} simulated s/s; at every tick {ticks:,.0f}",
        f"  gymnasium.make of the same map again: {figures['make_again_ms']:.1f} ms",
        f"  generated houses, a new one per episode: {figures['new_level_ms']:.1f} ms each at 64 games,",
        f"    with them {figures['generated_decisions_per_s_64']:,.0f} decisions/s in 64 houses at once",
        sep="\n",
    )
    if arguments.json:
        write_json(arguments.json, figures)


if __name__ == "__main__":
    sys.exit(main())
