"""Play random legal and illegal actions under random configurations: ``python -m tests.system.fuzz``.

Every observation must be finite and in its space, every illegal action a ValueError that changes nothing. The first
fault ends the run with the seed that repeats it. A map that is refused with a MapError is no fault.
"""

import argparse
import sys
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from gymnasium import spaces
from gymnasium.error import ResetNeeded

from pacman_env.command_line.command import Parser, run_command, whole_number
from pacman_env.envs.pacmanbot import PacManBotEnv
from pacman_env.world.maps.occupancy import MapError, map_name, shipped_maps

FAULT_STATUS = 1
MOST_DECISIONS = 300  # endless games end only by death or time
COUNTS = ("episodes", "decisions", "illegal", "caught", "complete", "cleared", "timeout", "running")
_ILLEGAL, _HELD, _NEAREST = 0.1, 0.9, 0.6  # shares of decisions

#: Rounds that end soon and in every way.
_QUICK: dict[str, Any] = {
    "execution.pickup_radius_m": 2.0,
    "execution.death_radius_m": 0.05,
    "robot.speed_mps": 0.75,
    "robot.wheel_speed_mps": 2.0,
    "robot.wheel_acceleration_mps2": 3.0,
}
_RANGES: dict[str, Any] = {
    "randomize.speed_mps": (0.1, 0.3),
    "randomize.clyde_speed_mps": (0.0, 0.6),
    "randomize.sigma_xy_m": (0.0, 0.1),
    "randomize.accept_delay_s": (0.0, 1.0),
    "randomize.abort_rate": (0.0, 0.5),
    "randomize.pickup_radius_m": (0.1, 1.0),
}


class Fault(Exception):
    """The environment broke a promise."""


def draw_arguments(rng: np.random.Generator) -> dict[str, Any]:
    kinds = [kind for kind in ("features", "scan", "grid") if rng.random() < 0.5]
    action = str(rng.choice(["goal", "velocity"]))
    settings = {
        "time_limit_s": float(rng.choice([5.0, 30.0, 120.0])),
        "nav2.abort_rate": float(rng.choice([0.0, 0.2])),
        "execution.rules": str(rng.choice(["robust", "as_built"])),
        "endless": bool(rng.random() < 0.3),
        "decisions.when": "event" if action == "goal" and rng.random() < 0.3 else "tick",
    }
    settings |= _QUICK if rng.random() < 0.5 else {}
    settings |= _RANGES if rng.random() < 0.3 else {}
    return {
        "observation": kinds or ["features"],
        "action": action,
        "ghosts": tuple(map(str, rng.choice(["wander", "arcade", "chase"], rng.integers(1, 5)))),
        "preset": str(rng.choice(["robot", "ideal"])),
        "settings": settings,
    }


def play_episode(source: str, seed: int) -> Counter[str]:
    """Play one episode and return its counts; the seed decides everything.

    Raises:
        Fault: names what was wrong.
        MapError: the map cannot be played on.
    """
    rng = np.random.default_rng(seed)
    arguments = draw_arguments(rng)
    env = PacManBotEnv(source, **arguments)
    try:
        return _episode(env, rng, seed)
    except Exception as error:
        raise Fault(f"{type(error).__name__}: {error}; arguments {arguments}") from error
    finally:
        env.close()


def _episode(env: PacManBotEnv, rng: np.random.Generator, seed: int) -> Counter[str]:
    counts, over = Counter({"episodes": 1}), False
    observation, info = env.reset(seed=seed)
    _check(env, observation, 0.0)
    action = _legal(env, rng)
    while not over and counts["decisions"] < MOST_DECISIONS:
        if rng.random() < _ILLEGAL:
            _refused(env, rng)
            counts["illegal"] += 1
        if rng.random() > _HELD:
            action = _legal(env, rng)
        observation, reward, terminated, truncated, info = env.step(action)
        counts["decisions"] += 1
        over = terminated or truncated
        _check(env, observation, reward)
        _require(over == (info["outcome"] != "running"), f"outcome {info['outcome']} and over {over}")
    if over:
        try:
            env.step(_legal(env, rng))
        except ResetNeeded:
            pass
        else:
            raise Fault("the game went on after its end")
    counts[info["outcome"]] += 1
    return counts


def _legal(env: PacManBotEnv, rng: np.random.Generator) -> Any:
    """Draw an action of the space; some goals are forbidden by the mask, most are the nearest pellet."""
    if isinstance(env.action_space, spaces.Box):
        return rng.uniform(env.action_space.low, env.action_space.high)
    if rng.random() < _NEAREST:
        pellets = slice(env.batch.pellet_slots)
        paths = np.where(env.action_masks()[pellets], env.situation.path_robot[0, pellets], np.inf)
        return int(paths.argmin())
    return int(rng.integers(env.action_space.n))


def _refused(env: PacManBotEnv, rng: np.random.Generator) -> None:
    """Send an invalid action, which must be refused."""
    illegal: list[Any] = [None, "go", np.array(["a", "b"]), np.zeros((1, 2)), np.zeros(3), [], np.nan]
    if isinstance(env.action_space, spaces.Box):
        illegal += [0.1, (0.1, np.nan), (np.inf, 0.0), (0.1, -np.inf), (True, False), (0.1, 0.1j), np.zeros((2, 1))]
    else:
        n = int(env.action_space.n)
        illegal += [-1, n, n + int(rng.integers(2**40)), -(2**63), 2**63, 0.5, np.float64(1), [0], np.array([0])]
    action = illegal[int(rng.integers(len(illegal)))]
    before = _state(env)
    try:
        env.step(action)
    except ValueError:
        _require(_state(env) == before, f"the refused action {action!r} changed the game")
        return
    raise Fault(f"action {action!r} was accepted")


def _state(env: PacManBotEnv) -> list[bytes]:
    batch = env.batch
    arrays = (batch.games, batch.ghosts, batch.alive, batch.obstacles, *env.situation.arrays())
    return [array.tobytes() for array in arrays]


def _check(env: PacManBotEnv, observation: dict[str, Any], reward: float) -> None:
    for key, array in observation.items():
        _require(bool(np.isfinite(array).all()), f"observation[{key!r}] holds what is not finite")
    _require(observation in env.observation_space, "the observation is not in its space")
    _require(type(reward) is float and np.isfinite(reward), f"reward {reward!r}")


def _require(condition: bool, message: str) -> None:
    if not condition:
        raise Fault(message)


def main(argv: Sequence[str] | None = None) -> int:
    """Play and return the exit status, which is 1 after a fault."""
    parser = Parser(prog="python -m tests.system.fuzz", description=__doc__)
    add = parser.add_argument
    add("--maps", nargs="+", default=[*shipped_maps(), "generated"], help="names, YAML files or folders")
    add("--episodes", type=whole_number(1), default=200, help="in all, shared among the maps")
    add("--seed", type=whole_number(0), default=0, help="of the first episode; the next has the next seed")
    return run_command(parser, argv, _report)


def _report(arguments: argparse.Namespace) -> int:
    maps, seed, total = arguments.maps, arguments.seed, Counter[str]()
    print(f"{'map':28}" + "".join(f" {name:>9}" for name in COUNTS))
    for source, share in zip(maps, np.array_split(np.arange(arguments.episodes), len(maps)), strict=True):
        counts = Counter[str]()
        for _ in share:
            try:
                counts += play_episode(source, seed)
            except MapError as error:
                print(f"{map_name(Path(source)):28} refused: {error}")
                break
            except Fault as fault:
                repeat = f"python -m tests.system.fuzz --maps {source} --episodes 1 --seed {seed}"
                print(f"{source}, seed {seed}: {fault}\nrepeat: {repeat}")
                return FAULT_STATUS
            seed += 1
        else:
            print(_row(map_name(Path(source)), counts))
        total += counts
    print(_row("all", total))
    return 0


def _row(name: str, counts: Counter[str]) -> str:
    return f"{name:28}" + "".join(f" {counts[one]:9d}" for one in COUNTS)


if __name__ == "__main__":
    sys.exit(main())
