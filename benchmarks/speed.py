"""Measure the speed of the environments as learners use them; ``benchmarks.versions`` runs it as a script.

It runs on the code of any version, so it imports only what older versions have. Rates are per second of processor time
in one thread, resets included. The time to choose actions counts only for ``ppo``.
"""

import gc
import json
import sys
import time
from collections.abc import Callable, Iterable
from importlib import import_module
from typing import Any

import gymnasium as gym
import numpy as np
import pymunk
from gymnasium.vector import AutoresetMode

from pacman_env.policies.registry import make_policy

BARE = "bare Chipmunk, 64 bodies"
HOUSES = 1000  # training houses, prepared before a row on them
HELD = 20  # ticks for which a random action is repeated, about as long as a planner pursues a goal
Row = tuple[str, str, int, str, dict[str, Any]]  # id, "make", "make_vec" or "sb3", games, policy, arguments
Rates = tuple[float, float]  # decisions and simulated seconds per second of processor time

BOT, FLAT, GENERATED = "PacManBot-v2", "PacManBotFlat-v2", "PacManBotFlatGenerated-v2"
_MADE: tuple[tuple[str, int], ...] = (("make", 1), ("make_vec", 64), ("sb3", 64))
ROWS: tuple[Row, ...] = (
    *((env, *made, "random", {}) for env in (BOT, FLAT, GENERATED) for made in _MADE),
    (BOT, "make_vec", 1024, "random", {}),
    (BOT, "make_vec", 64, "random", {"observation": "planner"}),
    *((env, "make_vec", 64, "ppo", {}) for env in (BOT, FLAT)),
)


def name_of(row: Row) -> str:
    """Return the name that the table shows and ``--only`` searches."""
    env, made, games, policy, arguments = row
    return f"{env}{''.join(f', {value}' for value in arguments.values())}, {made}, N = {games}, {policy}"


def registered(env: str, ids: Iterable[str]) -> str:
    """Return the id of ``ids`` that differs from ``env`` at most by its number: the same, otherwise the highest."""
    name = env.rpartition("-v")[0]
    numbers = {one: int(one.rpartition("-v")[2]) for one in ids if one.rpartition("-v")[0] == f"pacman_env/{name}"}
    if not numbers:
        raise ValueError(f"{env}: the environment is not registered")
    return max(numbers, key=lambda one: (one == f"pacman_env/{env}", numbers[one]))


class Player:
    """Plays the environment of a row; ``game`` is this package's environment without wrappers."""

    def __init__(self, row: Row, map_source: str) -> None:
        env, self.made, games, policy, arguments = row
        self.id = registered(env, gym.registry)
        arguments = arguments if env == GENERATED else {**arguments, "map": map_source}
        if self.made == "make":
            self.env: Any = gym.make(self.id, **arguments)
        else:
            mode: dict[str, Any] = {"autoreset_mode": AutoresetMode.SAME_STEP}  # every step is a decision
            self.env = gym.make_vec(self.id, games, "vector_entry_point", **mode, **arguments)
        self.game: Any = self.env.unwrapped
        self.env.reset(seed=0)
        if self.made == "sb3":
            self.env = import_module("pacman_env.sb3").PacManBotVecEnv(self.game)
            self.env.reset()
        self._rng, self._number, self._held = np.random.default_rng(0), 0, 1 if "Flat" in env else HELD
        self._tick_s, self._actions = self.game.config.execution.tick_s, np.zeros(games, np.int64)
        self._policy = None if policy == "random" else make_policy(policy)
        if self._policy is not None:
            self._policy.reset(np.ones(games, np.bool_), self.game.config)

    def rates(self, seconds: float) -> Rates:
        """Play for about ``seconds`` of processor time and return the rates."""
        spent, decisions, simulated = 0.0, 0, 0.0
        while spent < seconds or decisions == 0:
            if self._policy is None and self._number % self._held == 0:
                masks = np.atleast_2d(self.game.action_masks())
                self._actions = (self._rng.random(masks.shape) * masks).argmax(axis=1)
            began = time.process_time()
            if self._policy is not None:
                self._actions = self.game.action_of(self._policy.select(self.game.situation))
            elapsed_s, over = self._step()
            spent += time.process_time() - began
            if self._policy is not None and over.any():
                self._policy.reset(over, self.game.config)
            self._number += 1
            decisions += len(over)
            simulated += float((elapsed_s * np.ones(len(over))).sum())
        return decisions / spent, simulated / spent

    def _step(self) -> tuple[Any, Any]:
        """Step; return how long the decisions lasted, s, and which episodes ended."""
        if self.made == "sb3":
            _, _, over, rows = self.env.step(self._actions)
            return np.array([row.get("elapsed_s", self._tick_s) for row in rows]), over
        action = int(self._actions[0]) if self.made == "make" else self._actions
        _, _, terminated, truncated, info = self.env.step(action)
        over = np.atleast_1d(np.logical_or(terminated, truncated))
        if self.made == "make" and over[0]:
            self.env.reset()
        return info.get("elapsed_s", self._tick_s), over


def bare(map_source: str) -> Callable[[float], Rates]:
    """Return a function that measures physics alone: 64 robots in one Chipmunk space, stepped from Python.

    The robots start in different directions and bounce off the walls, so that they keep moving.
    """
    game: Any = Player((BOT, "make_vec", 64, "random", {}), map_source).game
    robot, space, step_s = game.config.robot, pymunk.Space(), game.config.physics_step_s
    steps = round(game.config.execution.tick_s / step_s)
    space.collision_slop = 0.001  # m, as in the game
    for x0, y0, x1, y1 in game.batch.assets.grid.walls.tolist():
        space.add(pymunk.Segment(space.static_body, (x0, y0), (x1, y1), 0.0))
    for i, place in enumerate(game.batch.bodies[:, :2].tolist()):
        body = pymunk.Body(robot.mass_kg, float("inf"))
        body.position = place
        body.velocity = pymunk.Vec2d(robot.speed_mps, 0.0).rotated(2.399963 * i)  # golden angle
        shape = pymunk.Circle(body, robot.radius_m)
        shape.filter = pymunk.ShapeFilter(group=1)  # robots do not touch one another
        space.add(body, shape)
    for shape in space.shapes:
        shape.elasticity = 1.0

    def rates(seconds: float) -> Rates:
        began, ticks = time.process_time(), 0
        while ticks == 0 or time.process_time() - began < seconds:
            for _ in range(HELD * steps):
                space.step(step_s)
            ticks += 64 * HELD
        rate = ticks / (time.process_time() - began)
        return rate, rate * game.config.execution.tick_s

    return rates


def measured(only: str, map_source: str, seconds: float) -> dict[str, Any]:
    """Play each row whose name contains ``only`` for ``seconds``; return the rates by name, or why it was skipped."""
    rows = {name_of(row): row for row in ROWS if only in name_of(row)}
    if any(row[0] == GENERATED for row in rows.values()):  # prepare the houses
        env = Player((GENERATED, "make_vec", 64, "random", {}), "").env
        for first in range(0, HOUSES, 64):
            env.reset(options={"level": (first + np.arange(64)) % HOUSES})
    figures: dict[str, Any] = {BARE: {}}
    players = {BARE: bare(map_source)}
    for name, row in rows.items():
        try:
            player = Player(row, map_source)
            players[name], figures[name] = player.rates, {"id": player.id}
        except (ImportError, TypeError, ValueError) as error:  # no library, or a version without the row
            figures[name] = {"skipped": str(error)}
    for rates in players.values():  # compile kernels and fill the caches
        rates(min(seconds, 1.0))
    gc.collect()
    for name, rates in players.items():
        figures[name] |= dict(zip(("decisions_per_s", "simulated_s_per_s"), rates(seconds), strict=True))
    return figures


if __name__ == "__main__":
    print(json.dumps(measured(sys.argv[1], sys.argv[2], float(sys.argv[3]))))
