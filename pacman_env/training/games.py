"""Games of a training, in parts; the games of a part have one line-up and their own houses.

Houses with both completed and lost rounds may be played again. The score of a house is p (1 - p), the variance of
completion at the share p of completed rounds (Rutherford et al., "No regrets: investigating and improving regret
approximations for curriculum discovery", 2024).

A round at its time limit counts as terminated, not truncated, so that hiding until then does not pay.
"""

from __future__ import annotations

import copy
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..config import Config, make_config
from ..engine.cores import cores
from ..envs.parallel_vec_env import PACMAN, PacManBotParallelVecEnv
from ..episodes.decisions import allowed
from ..game.ghosts import GHOST_NAMES, POLICY, WANDER
from ..levels.house_families import HOUSES, LONG_HOUSES, WIDE_HOUSES
from ..observations.planner_features import CANDIDATE_FEATURES, planner_features
from ..observations.situation_writer import situation_of
from ..policies.base import Policy
from ..policies.opponents import BehaviourOpponent
from ..sb3 import PacManBotVecEnv
from .arguments import Arguments
from .lineups import LEARNED, SUB_BATCHES, read, sub_batches

CLYDE = GHOST_NAMES[0]
_CHASE = BehaviourOpponent("chase")
_HOUSES = (HOUSES, LONG_HOUSES, LONG_HOUSES, WIDE_HOUSES)  # of parts in turn
_FEWEST_ROUNDS = 6  # a level with fewer rounds is not judged
VALIDATION_LEVEL = 900_000  # training levels from here on are kept for validation
#: Ranges of --randomize, around the values of the real trials.
_DOMAIN: dict[str, Any] = {
    "randomize.sigma_xy_m": (0.0, 0.07),
    "randomize.sigma_yaw_rad": (0.0, 0.06),
    "randomize.accept_delay_s": (0.0, 0.4),
    "randomize.abort_rate": (0.0, 0.02),
}
_PATHS = (
    *("path_robot", "nearness_robot", "path_clyde", "nearness_clyde", "time_margin"),
    *("nearest_pellet", "mean_pellet", "pellets_around"),
)
_PREDICTION = ("caught_soon", "caught", "approached", "closest_mean", "closest_least", "standing_clearance")


def game_config(arguments: Arguments) -> Config:
    """Return the configuration of training games: planner features, and the settings that ``arguments`` contain."""
    return make_config(arguments.preset, arguments.execution, **game_settings(arguments))


def game_settings(arguments: Arguments) -> dict[str, Any]:
    hyper = arguments.hyper
    return {
        "randomize.clyde_speed_mps": hyper.clyde_speed,
        "randomize.speed_mps": hyper.robot_speed,
        "observation.kinds": ("planner",),
        "decisions.when": hyper.decide,
        "reward.timeout": hyper.timeout,
        **(_DOMAIN if arguments.randomize else {}),
    }


def lineup_settings(arguments: Arguments, lineup: str, fastest_mps: float | None = None) -> dict[str, Any]:
    """Return the power pellets and the range of the ghosts' speeds of a line-up, capped at ``fastest_mps``."""
    low, high = read(lineup).speeds_mps or arguments.hyper.clyde_speed
    highest = high if fastest_mps is None else max(low, min(high, fastest_mps))
    return {"randomize.clyde_speed_mps": (low, highest), "power.pellets": read(lineup).power_pellets}


def clyde_limit(arguments: Arguments, segment: int) -> float | None:
    """Return Clyde's highest speed in a segment under a curriculum, m/s; None without a curriculum."""
    if not arguments.curriculum:
        return None
    low, high = arguments.hyper.clyde_speed
    share = min(1.0, (segment + 1) / max(arguments.hyper.segments / 2, 1))
    return low + (high - low) * (0.3 + 0.7 * share)


def dropped(arguments: Arguments) -> dict[str, Any]:
    """Return the columns that an ablation hides from the network, and the columns of the kinds that it forbids."""
    without = arguments.without
    names = (_PATHS if "paths" in without else ()) + (_PREDICTION if "prediction" in without else ())
    kinds = [kind for kind, part in (("is_refuge", "refuges"), ("is_hold", "hold")) if part in without]
    return {
        "dropped_features": tuple(CANDIDATE_FEATURES.index(name) for name in names),
        "dropped_kinds": tuple(CANDIDATE_FEATURES.index(name) for name in kinds),
    }


class Ending(NamedTuple):
    """Result of a round."""

    outcome: str
    reward: float = 0.0  # sum over the round, not scaled
    length: int = 0  # decisions
    lineup: str = ""
    level: int | None = None  # None: the level may not be played again


class Step(NamedTuple):
    rewards: NDArray[np.float32]
    dones: NDArray[np.bool_]
    endings: list[Ending]  # endings of the games that are done, in their order


class PlannerGames:
    """Games of robots against one line-up, in houses that may be played again if ``may_repeat``."""

    def __init__(
        self, env: PacManBotVecEnv, scale: float = 1.0, lineup: str = WANDER, may_repeat: bool = False
    ) -> None:
        self.env, self.num_envs, self.lineup, self.may_repeat = env, env.num_envs, lineup, may_repeat
        self._scale = np.float32(scale)  # factor of rewards

    def reset(self, seed: int) -> None:
        self.env.seed(seed)
        self.observation = self.env.reset()

    def step(self, actions: NDArray[np.int64]) -> Step:
        self.observation, rewards, dones, infos = self.env.step(actions)
        endings = []
        for i in np.flatnonzero(dones).tolist():
            info, episode = infos[i], infos[i]["episode"]
            level = int(info["level"]) if self.may_repeat and "level" in info else None
            endings.append(Ending(info["outcome"], episode["r"], episode["l"], self.lineup, level))
        return Step(rewards * self._scale, dones, endings)


class GhostGames:
    """Games in which Clyde learns; it observes planner features from its own point of view.

    The policy ``robot`` moves the robots and keeps no state.
    """

    def __init__(self, env: PacManBotParallelVecEnv, robot: Policy, scale: float = 1.0) -> None:
        if tuple(env.possible_agents) != (PACMAN, CLYDE):
            raise ValueError(f"agents of the games: {env.possible_agents}, must be {PACMAN} and {CLYDE}")
        self.env, self.num_envs, self.scale = env, env.num_envs, np.float32(scale)
        self._robot = copy.deepcopy(robot)  # other threads play with the original
        self._robot.reset(np.ones(self.num_envs, dtype=np.bool_), env.config)

    def reset(self, seed: int) -> None:
        self.env.reset(seed)
        self._observe()

    def step(self, actions: NDArray[np.int64]) -> Step:
        situation = self.env.situation
        goals = allowed(situation, self._robot.select(situation), self.env.batch.hold)
        _, rewards, terminated, truncated, infos = self.env.step({PACMAN: goals, CLYDE: actions})
        self._observe()
        dones = terminated | truncated
        ended = np.flatnonzero(dones).tolist()
        if ended:
            self._robot.reset(dones, self.env.config)
        endings = [Ending(infos["final_info"]["outcome"][i]) for i in ended]
        return Step(rewards[:, 1].astype(np.float32) * self.scale, dones, endings)

    def _observe(self) -> None:
        situation = situation_of(self.env.batch, 0)
        candidates, whole = planner_features(situation, self.env.config.robot.speed_mps)
        self.observation = {"planner_candidates": candidates, "planner_globals": whole, "action_mask": situation.mask}


Games = PlannerGames | GhostGames  # both are played alike: ``observation``, ``reset(seed)`` and ``step(actions)``


def start(parts: Sequence[Games], seed: int, pool: ThreadPoolExecutor) -> None:
    """Start new rounds in all games, whose seeds follow from ``seed``."""
    first = np.cumsum([0, *(part.num_envs for part in parts[:-1])])
    list(pool.map(lambda part, k: part.reset(seed + k), parts, first.tolist()))


def to_repeat(endings: Iterable[Ending]) -> dict[str, list[int]]:
    """Return the levels to play again by line-up, best first: at most half of the levels that the line-up met."""
    counts: dict[str, dict[int, tuple[int, int]]] = {}  # by line-up and level: completed rounds, all rounds
    for ending in endings:
        if ending.level is not None:
            levels = counts.setdefault(ending.lineup, {})
            won, rounds = levels.get(ending.level, (0, 0))
            levels[ending.level] = won + (ending.outcome == "complete"), rounds + 1
    best: dict[str, list[int]] = {}
    for lineup, levels in counts.items():
        judged = [
            (-won * (rounds - won) / rounds**2, level)
            for level, (won, rounds) in levels.items()
            if rounds >= _FEWEST_ROUNDS and 0 < won < rounds
        ]
        best[lineup] = [level for _, level in sorted(judged)[: len(levels) // 2]]
    return best


def make_parts(
    arguments: Arguments,
    segment: int,
    learned: Policy = _CHASE,
    again: Mapping[str, Sequence[int]] = MappingProxyType({}),
) -> list[PlannerGames]:
    """Return the parts of a segment, with their own houses: half of the parts have long ones, a quarter wide ones.

    Each part has one of the hyperparameters' line-ups; ``learned`` moves the ghosts called ``learned``. ``again``
    contains earlier levels by line-up, which replace half of the segment's own levels in houses of usual size.
    """
    hyper = arguments.hyper
    if hyper.levels > VALIDATION_LEVEL:
        raise ValueError(f"levels = {hyper.levels}: there are {VALIDATION_LEVEL} to train on")
    first = segment % (VALIDATION_LEVEL // hyper.levels) * hyper.levels
    if len(hyper.lineups) > 1:
        lineups = sub_batches(hyper.ghosts, hyper.games, hyper.levels)
        turn = segment // 2  # every line-up gets all kinds of houses, twice in a row so that levels repeat
    else:
        lineups, turn = [hyper.ghosts[0]] * min(SUB_BATCHES, hyper.games, hyper.levels), 0
    count = len(lineups)
    levels, games = (np.linspace(0, total, count + 1).astype(int).tolist() for total in (hyper.levels, hyper.games))
    fastest_mps, spacing_m = clyde_limit(arguments, segment), game_config(arguments).pellets.spacing_m
    settings = game_settings(arguments) | {"execution.rules": arguments.execution, "observation.infos": "ends"}
    made: list[PlannerGames] = []
    left = {lineup: list(chosen) for lineup, chosen in again.items()}
    for k, lineup in enumerate(lineups):
        houses = _HOUSES[(k + turn) % len(_HOUSES)]
        played = list(range(first + levels[k], first + levels[k + 1]))
        if houses == HOUSES:
            own_again = left.get(lineup, [])
            old, left[lineup] = own_again[: len(played) // 2], own_again[len(played) // 2 :]
            played[: len(old)] = old
        own: dict[str, Any] = {"pellets.spacing_m": spacing_m * houses.spacing_m / HOUSES.spacing_m}
        own |= lineup_settings(arguments, lineup, fastest_mps)
        env = PacManBotVecEnv(
            games[k + 1] - games[k],
            map=f"{houses.name}:{','.join(map(str, played))}",
            preset=arguments.preset,
            ghosts=[copy.deepcopy(learned) if name == LEARNED else name for name in read(lineup).behaviours],
            settings=settings | own,
            num_threads=_threads_of_each(arguments, count),
        )
        made.append(PlannerGames(env, hyper.reward_scale, lineup, may_repeat=houses == HOUSES))
    return made


def make_ghost_parts(arguments: Arguments, segment: int, robot: Policy) -> list[GhostGames]:
    """Return the parts of Clyde's games in a segment, zero-sum; all parts share the segment's houses."""
    hyper = arguments.hyper
    # The robot's policy reads the situation, so its agent needs no planner features.
    settings = game_settings(arguments) | {"observation.kinds": ("features",), "zero_sum": True}
    settings |= {"execution.rules": arguments.execution, "num_levels": hyper.levels}
    settings["start_level"] = segment % (VALIDATION_LEVEL // hyper.levels) * hyper.levels
    count = min(SUB_BATCHES, hyper.games)
    environment: dict[str, Any] = {"map": "generated", "preset": arguments.preset, "ghosts": (POLICY,)}
    environment |= {"settings": settings, "num_threads": _threads_of_each(arguments, count)}
    games = np.diff(np.linspace(0, hyper.games, count + 1).astype(int)).tolist()
    return [GhostGames(PacManBotParallelVecEnv(n, **environment), robot, hyper.reward_scale) for n in games]


def _threads_of_each(arguments: Arguments, parts: int) -> int:
    return max((arguments.threads or cores()) // parts, 1)
