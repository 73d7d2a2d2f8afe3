"""Episodes of random legal and illegal actions under random configurations: ``python -m tests.system.fuzz``.

Every observation must be free of NaN and in its space, every illegal action a ValueError that changes nothing. The
first fault ends the run with the seed that repeats it. A map that is refused with a MapError is no fault.
"""

from __future__ import annotations

import argparse
import copy
import sys
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from gymnasium import spaces
from gymnasium.error import ResetNeeded

from pacman_env.cli.command import Parser, run_command, whole_number
from pacman_env.envs.pacmanbot import PacManBotEnv
from pacman_env.world.maps.occupancy import MapError, map_name, shipped_maps

FAULT_STATUS = 1
MOST_DECISIONS = 300  # endless games end only by death or time
OUTCOMES = ("caught", "complete", "cleared", "timeout", "running")
_ILLEGAL, _FORBIDDEN, _TOO_FAST, _HELD, _NEAREST = 0.1, 0.1, 0.05, 0.9, 0.6  # shares of decisions

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
    "randomize.sigma_yaw_rad": (0.0, 0.2),
    "randomize.update_distance_m": (0.05, 0.5),
    "randomize.update_angle_rad": (0.05, 0.5),
    "randomize.accept_delay_s": (0.0, 1.0),
    "randomize.abort_rate": (0.0, 0.5),
    "randomize.pickup_radius_m": (0.1, 1.0),
}


class Fault(Exception):
    """The environment broke a promise."""


@dataclass
class Tally:
    """Counts of the episodes on one map."""

    episodes: int = 0
    decisions: int = 0
    refused_actions: int = 0
    ends: Counter[str] = field(default_factory=Counter)
    refusal: str = ""  # why the map is not played

    def line(self, name: str) -> str:
        if self.refusal:
            return f"{name:28} refused: {self.refusal}"
        ends = "".join(f" {self.ends[outcome]:8d}" for outcome in OUTCOMES)
        return f"{name:28} {self.episodes:8d} {self.decisions:9d} {self.refused_actions:7d}{ends}"


def draw_arguments(rng: np.random.Generator) -> dict[str, Any]:
    kinds = [kind for kind in ("features", "scan", "grid") if rng.random() < 0.5]
    behaviours = ("wander", "arcade", "chase")
    ghosts = tuple(str(rng.choice(behaviours)) for _ in range(rng.integers(1, 5)))
    settings = {"time_limit_s": float(rng.choice([5.0, 30.0, 120.0])), "nav2.abort_rate": float(rng.choice([0.0, 0.2]))}
    settings |= _QUICK if rng.random() < 0.5 else {}
    settings |= _RANGES if rng.random() < 0.3 else {}
    action = str(rng.choice(["goal", "velocity"]))
    return {
        "observation": kinds or ["features"],
        "action": action,
        "ghosts": ghosts,
        "preset": str(rng.choice(["robot", "ideal"])),
        "settings": {
            **settings,
            "execution.rules": str(rng.choice(["robust", "as_built"])),
            "endless": bool(rng.random() < 0.3),
            "decisions.when": "event" if action == "goal" and rng.random() < 0.3 else "tick",
        },
    }


def play_episode(source: str, seed: int, tally: Tally) -> None:
    """One episode; all that is random comes from the seed.

    Raises:
        Fault: names what was wrong.
        MapError: the map cannot be played on.
    """
    rng = np.random.default_rng(seed)
    arguments = draw_arguments(rng)
    env = PacManBotEnv(source, **arguments)
    try:
        _episode(env, rng, seed, tally)
    except Exception as error:
        raise Fault(f"{type(error).__name__}: {error}; arguments {arguments}") from error


def _episode(env: PacManBotEnv, rng: np.random.Generator, seed: int, tally: Tally) -> None:
    observation, info = env.reset(seed=seed)
    _check(env, observation, 0.0)
    action, over, decisions = _legal(env, rng), False, 0
    while not over and decisions < MOST_DECISIONS:
        if rng.random() < _ILLEGAL:
            _refused(env, rng)
            tally.refused_actions += 1
        if rng.random() > _HELD:
            action = _legal(env, rng)
        twin = None
        if isinstance(env.action_space, spaces.Box) and rng.random() < _TOO_FAST:
            robot = env.config.robot
            action = rng.normal(size=2) * 10.0 * (robot.wheel_speed_mps, robot.omega_radps)
            twin = copy.deepcopy(env)
        observation, reward, terminated, truncated, info = env.step(action)
        if twin is not None:
            limit = np.array([robot.wheel_speed_mps, robot.omega_radps])
            _require(_same(twin.step(np.clip(action, limit * (0, -1), limit))[0], observation), f"{action} is not cut")
        decisions += 1
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
    env.close()
    tally.episodes += 1
    tally.decisions += decisions
    tally.ends[info["outcome"]] += 1


def _legal(env: PacManBotEnv, rng: np.random.Generator) -> Any:
    """An action of the space; goals mostly among the allowed ones, but forbidden candidates too."""
    if isinstance(env.action_space, spaces.Box):
        return rng.uniform(env.action_space.low, env.action_space.high)
    if rng.random() < _FORBIDDEN:
        return int(rng.integers(env.action_space.n))
    mask = env.action_masks()
    if rng.random() < _NEAREST:
        pellets = slice(env.batch.pellet_slots)
        return int(np.where(mask[pellets], env.situation.path_robot[0, pellets], np.inf).argmin())
    return int(rng.choice(np.flatnonzero(mask)))


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
    assert isinstance(env.observation_space, spaces.Dict)
    for key, array in observation.items():
        _require(bool(np.isfinite(array).all()), f"observation[{key!r}] holds what is not finite")
        _require(env.observation_space[key].contains(array), f"observation[{key!r}] is not in its space")
    _require(observation in env.observation_space, "the observation is not in its space")
    _require(type(reward) is float and np.isfinite(reward), f"reward {reward!r}")


def _same(one: dict[str, Any], other: dict[str, Any]) -> bool:
    return one.keys() == other.keys() and all(np.array_equal(one[key], other[key]) for key in one)


def _require(condition: bool, message: str) -> None:
    if not condition:
        raise Fault(message)


def main(argv: Sequence[str] | None = None) -> int:
    """Play; returns the exit status: 1 after a fault."""
    parser = Parser(prog="python -m tests.system.fuzz", description=__doc__)
    parser.add_argument(
        "--maps", nargs="+", default=[*shipped_maps(), "generated"], help="names, YAML files or folders"
    )
    parser.add_argument("--episodes", type=whole_number(1), default=200, help="in all, shared among the maps")
    parser.add_argument(
        "--seed", type=whole_number(0), default=0, help="of the first episode; the next has the next seed"
    )
    return run_command(parser, argv, _report)


def _report(arguments: argparse.Namespace) -> int:
    maps, seed, total = arguments.maps, arguments.seed, Tally()
    print(f"{'map':28} {'episodes':>8} {'decisions':>9} {'illegal':>7}" + "".join(f" {name:>8}" for name in OUTCOMES))
    for share in zip(maps, np.array_split(np.arange(arguments.episodes), len(maps)), strict=True):
        source, tally = share[0], Tally()
        for _ in share[1]:
            try:
                play_episode(source, seed, tally)
            except MapError as error:
                tally.refusal = str(error)
                if tally.episodes == 0:
                    break
                print(f"{source}, seed {seed}: a map that was played before is refused: {error}")
                return FAULT_STATUS
            except Fault as fault:
                repeat = f"python -m tests.system.fuzz --maps {source} --episodes 1 --seed {seed}"
                print(f"{source}, seed {seed}: {fault}\nrepeat: {repeat}")
                return FAULT_STATUS
            seed += 1
        print(tally.line(map_name(Path(source))))
        total.episodes += tally.episodes
        total.decisions += tally.decisions
        total.refused_actions += tally.refused_actions
        total.ends += tally.ends
    print(total.line("all"))
    return 0


if __name__ == "__main__":
    sys.exit(main())
