"""Compare the coarse model of the game with the simulator: ``python -m benchmarks.coarse_model``.

The simulator plays games with random goals, each pursued for a while; the coarse model plays the same goals from the
same situations. The comparison covers the time until a goal is reached (if it was not changed), and, ``--seconds``
after a choice, the places of robot and ghosts, the least distance between them, and whether the robot is caught.
"""

import argparse
import sys
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.harness import Option, benchmark, count
from pacman_env.config import Config, make_config, parse_settings
from pacman_env.engine.jit import kernel
from pacman_env.game.ends import CAUGHT, RUNNING
from pacman_env.game.ghosts import find_behaviour
from pacman_env.levels.assets import map_assets
from pacman_env.observations.coarse_start import draw_futures, start
from pacman_env.observations.situation import Situation
from pacman_env.observations.situation_writer import situation_of
from pacman_env.policies.registry import make_policy
from pacman_env.sim.batch import GameBatch
from pacman_env.sim.coarse_model import Behaviours, Lags, choose, step

_PLAYED_S = 4.0  # time before the first comparison and between comparisons
_FIELDS = (
    *(("switched", np.bool_), ("caught", np.bool_), ("expected_caught", np.bool_)),
    *(("reached_s", np.float64), ("expected_s", np.float64)),  # NaN: not reached
    *(("closest_m", np.float64), ("expected_m", np.float64), ("robot_off_m", np.float64), ("ghost_off_m", np.float64)),
)
TRIAL = np.dtype(list(_FIELDS))


@kernel
def _play(robot, ghosts, goal, steps, model):  # type: ignore[no-untyped-def]
    """Play with a goal; return the time until it is reached, s, NaN if it is not."""
    reached, begin_s = np.nan, robot[0].time_s
    choose(robot[0], goal, model)
    for _ in range(steps):
        step(robot[0], ghosts, model)
        if robot[0].reached and not reached >= 0.0:
            reached = robot[0].time_s - begin_s
        if robot[0].dead:
            break
    return reached


class Trials:
    """Games of the simulator, with the coarse model's prediction for each."""

    def __init__(self, source: str, config: Config, games: int, seconds: float, seed: int) -> None:
        self.config, self.seconds, self.games = config, seconds, games
        self.batch = GameBatch(map_assets(source, config), config, games)
        self.behaviours = Behaviours([find_behaviour(name) for name in config.clyde.ghosts], config)
        self.ticks = round(seconds / config.execution.tick_s)
        self.rng = np.random.default_rng(seed)
        self._reset(np.ones(games, np.bool_))

    def _reset(self, which: NDArray[np.bool_]) -> None:
        if which.any():
            self.batch.reset(np.flatnonzero(which), self.rng.integers(2**63, size=which.sum(), dtype=np.uint64))

    def trials(self) -> NDArray[Any]:
        """Return N records TRIAL from the current state of the games; games that end start again."""
        self._drive(round(_PLAYED_S / self.config.execution.tick_s))
        situation = situation_of(self.batch)
        chosen = self._draw(situation)
        result = np.zeros(self.games, TRIAL)
        result["switched"] = situation.current >= 0
        places = [self._expect(situation, i, int(chosen[i]), result[i : i + 1]) for i in range(self.games)]
        self._watch(chosen, np.array(places), result)
        self._reset(self.batch.games["end"] != RUNNING)
        return result

    def _draw(self, situation: Situation) -> NDArray[np.int64]:
        draws = self.rng.random(situation.mask.shape)
        return np.where(situation.mask & (situation.goal >= 0), draws, -1.0).argmax(axis=1)

    def _drive(self, ticks: int) -> None:
        policy = make_policy("nearest")
        policy.reset(np.ones(self.games, np.bool_), self.config)
        for _ in range(ticks):
            self.batch.step(policy.select(situation_of(self.batch)))
            self._reset(self.batch.games["end"] != RUNNING)

    def _expect(self, situation: Situation, i: int, candidate: int, trial: NDArray[Any]) -> list[float]:
        """Write the model's prediction for one game; return the final places of the robot and the nearest ghost."""
        begin = start(situation, i, self.config, self.behaviours, Lags(death_margin_m=0.0))
        draw_futures(begin.ghosts, int(situation.seed[i]), int(situation.tick[i]), 0)
        steps = np.int64(round(self.seconds / float(begin.model.rules["step_s"][0])))
        trial["expected_s"] = _play(begin.robot, begin.ghosts, begin.goals[candidate], steps, begin.model)
        trial["expected_caught"] = begin.robot["dead"][0]
        trial["expected_m"] = begin.robot["closest_m"][0]
        return [begin.robot["x"][0], begin.robot["y"][0], begin.ghosts["x"][0], begin.ghosts["y"][0]]

    def _watch(self, chosen: NDArray[np.int64], places: NDArray[np.float64], trial: NDArray[Any]) -> None:
        games = self.batch.games
        trial["reached_s"], trial["closest_m"] = np.nan, np.inf
        for tick in range(1, self.ticks + 1):
            running = games["end"] == RUNNING
            self.batch.step(chosen)
            situation = situation_of(self.batch)
            offset = situation.ghosts[:, :, :2] - situation.robot[:, None, :2]
            apart = np.hypot(offset[..., 0], offset[..., 1]).min(axis=1)
            trial["closest_m"] = np.where(running, np.minimum(trial["closest_m"], apart), trial["closest_m"])
            arrived = running & (games["end"] != CAUGHT) & np.isnan(trial["reached_s"]) & (games["pursued"] != chosen)
            trial["reached_s"][arrived] = tick * self.config.execution.tick_s
        trial["caught"] = games["end"] == CAUGHT
        trial["robot_off_m"] = np.hypot(*(situation.robot[:, :2] - places[:, :2]).T)
        trial["ghost_off_m"] = np.hypot(*(situation.ghosts[:, 0, :2] - places[:, 2:]).T)
        over = (games["end"] != RUNNING) | trial["expected_caught"]
        trial["robot_off_m"][over] = trial["ghost_off_m"][over] = np.nan


def run(arguments: argparse.Namespace) -> dict[str, Any]:
    settings = {"clyde.ghosts": "chase", **dict(text.split("=", 1) for text in arguments.set)}
    config = make_config("robot", **parse_settings(f"{name}={value}" for name, value in settings.items()))
    games = Trials(arguments.map, config, arguments.games, arguments.seconds, arguments.seed)
    rows = np.concatenate([games.trials() for _ in range(arguments.rounds)])
    caught, expected = rows["caught"], rows["expected_caught"]
    feared = rows["expected_m"] <= config.execution.death_radius_m + Lags().death_margin_m
    figures: dict[str, Any] = {"trials": len(rows), "caught": caught.sum(), "expected": expected.sum()}
    figures |= {"agreement": np.mean(caught == expected), "expected_with_margin": feared.sum()}
    figures |= {"missed_with_margin": np.sum(caught & ~feared)}
    late = rows["expected_s"] - rows["reached_s"]
    columns = {
        f"arrival_s, chosen {name}": late[rows["switched"] == way] for name, way in (("at rest", 0), ("on the way", 1))
    }
    columns |= {name: rows[name] for name in ("robot_off_m", "ghost_off_m")}
    for name, values in columns.items():
        if np.isfinite(values).any():
            low, middle, high = np.nanpercentile(values, [5, 50, 95])
            figures[name] = {"mean": np.nanmean(values).item(), "p5": low, "p50": middle, "p95": high}
    print(f"{arguments.map}, ghosts {', '.join(config.clyde.ghosts)}: {len(rows)} trials of {arguments.seconds} s.")
    print(f"Arrivals are expected minus true ones. The margin of a catch is {Lags().death_margin_m} m.")
    for name, value in figures.items():
        shown = ", ".join(f"{key} {one:.2f}" for key, one in value.items()) if isinstance(value, dict) else f"{value:g}"
        print(f"  {name}: {shown}")
    return {name: value.item() if isinstance(value, np.generic) else value for name, value in figures.items()}


SECONDS: Option = ("--seconds", {"type": float, "default": 12.0, "metavar": "S", "help": "(%(default)s)"})
main = benchmark("coarse_model", __doc__, run, "--seed", "--rounds", count("--games", 50), SECONDS, "--set")

if __name__ == "__main__":
    sys.exit(main())
