"""Games of a training, in parts; the games of a part have one line-up and their own houses."""

from __future__ import annotations

import copy
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pacman_env.config import Config, PelletConfig, make_config
from pacman_env.engine.cores import cores
from pacman_env.envs.parallel_vec_env import PACMAN, PacManBotParallelVecEnv
from pacman_env.episodes.decisions import allowed
from pacman_env.game.ghosts import GHOST_NAMES, POLICY, WANDER
from pacman_env.levels.house_families import WIDE
from pacman_env.observations.planner_features import CANDIDATE_FEATURES, planner_features
from pacman_env.observations.situation_writer import situation_of
from pacman_env.policies.base import Policy
from pacman_env.policies.metadata import Training
from pacman_env.policies.opponents import BehaviourOpponent
from pacman_env.sb3 import Observation, PacManBotVecEnv
from pacman_env.training.checkpoint import Facts
from pacman_env.training.lineups import (
    LEARNED,
    SUB_BATCHES,
    behaviours,
    make_teacher,
    power_pellets,
    speeds,
    sub_batches,
)
from pacman_env.training.run_arguments import Arguments

CLYDE = GHOST_NAMES[0]
_CHASE = BehaviourOpponent("chase")
_WIDE_EVERY = 4  # every fourth part has wide houses
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


def facts_of(arguments: Arguments, decisions: int, metrics: dict[str, float]) -> Facts:
    """Return the facts of a network after ``decisions`` decisions; ``metrics`` by name."""
    training = Training(
        clyde_speeds_mps=arguments.hyper.clyde_speed,
        robot_speeds_mps=arguments.hyper.robot_speed,
        levels=f"generated:train below {VALIDATION_LEVEL}",
        preset=arguments.preset,
        execution=arguments.execution,
        decisions=decisions,
        seed=arguments.seed,
        ghosts=arguments.hyper.ghosts,
    )
    return Facts(game_config(arguments).robot.speed_mps, training, metrics)


def lineup_settings(arguments: Arguments, lineup: str, fastest_mps: float | None = None) -> dict[str, Any]:
    """Return the power pellets and the range of the ghosts' speeds of a line-up, capped at ``fastest_mps``."""
    low, high = speeds(lineup) or arguments.hyper.clyde_speed
    highest = high if fastest_mps is None else max(low, min(high, fastest_mps))
    return {"randomize.clyde_speed_mps": (low, highest), "power.pellets": power_pellets(lineup)}


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
    level: int | None = None
    reward: float = 0.0  # sum over the round, not scaled
    length: int = 0  # decisions


class Step(NamedTuple):
    observation: Observation
    rewards: NDArray[np.float32]
    dones: NDArray[np.bool_]
    endings: list[Ending]  # endings of the games that are done, in their order


class Games(ABC):
    """Games of a part, which are stepped together.

    A round at its time limit counts as terminated, not truncated, so that hiding until then does not pay.
    """

    env: Any
    num_envs: int
    repeats: str | None = None  # line-up whose levels may be played again; None: they may not

    @abstractmethod
    def reset(self, seed: int) -> Observation:
        """Start new rounds in all games, with the seeds from ``seed`` on."""

    @abstractmethod
    def step(self, actions: NDArray[np.int64]) -> Step: ...


class PlannerGames(Games):
    """Games of robots against one line-up; :meth:`begin_teaching` starts the line-up's teacher for :meth:`choices`."""

    def __init__(
        self,
        env: PacManBotVecEnv,
        scale: float = 1.0,  # factor of rewards
        lineup: str = WANDER,
        teacher_nodes: int = 0,
        may_repeat: bool = False,  # True: the levels may be played again
    ) -> None:
        self.env, self.num_envs, self._scale = env, env.num_envs, np.float32(scale)
        self.lineup, self._teacher_nodes = lineup, teacher_nodes
        self.repeats = lineup if may_repeat else None
        self._teacher: Policy | None = None

    def reset(self, seed: int) -> Observation:
        self._teacher = None
        self.env.seed(seed)
        return self.env.reset()

    def step(self, actions: NDArray[np.int64]) -> Step:
        observation, rewards, dones, infos = self.env.step(actions)
        if self._teacher is not None and dones.any():
            self._teacher.reset(dones, self.env.env.config)
        endings = []
        for i in np.flatnonzero(dones).tolist():
            info = infos[i]
            level = int(info["level"]) if "level" in info else None
            endings.append(Ending(info["outcome"], level, info["episode"]["r"], info["episode"]["l"]))
        return Step(observation, rewards * self._scale, dones, endings)

    def begin_teaching(self) -> None:
        """Create a teacher that knows nothing of the rounds so far."""
        self._teacher = make_teacher(self.lineup, self._teacher_nodes)
        self._teacher.reset(np.ones(self.num_envs, dtype=np.bool_), self.env.env.config)

    def choices(self) -> NDArray[np.int64]:
        """Return the teacher's choices (N,) in the current situations."""
        assert self._teacher is not None, "nobody teaches in these games"
        return self._teacher.select(self.env.env.situation)


def make_parts(
    arguments: Arguments,
    segment: int,
    learned: Policy = _CHASE,
    again: Mapping[str, Sequence[int]] = MappingProxyType({}),
) -> list[PlannerGames]:
    """Return the parts of a segment, with their own houses; in every fourth part, houses are twice as wide and sparse.

    Each part has one of the hyperparameters' line-ups; ``learned`` moves the ghosts called ``learned``. ``again``
    contains earlier levels by line-up, which replace half of the segment's own levels in houses of usual size.
    """
    hyper = arguments.hyper
    if hyper.levels > VALIDATION_LEVEL:
        raise ValueError(f"levels = {hyper.levels}: there are {VALIDATION_LEVEL} to train on")
    first = segment % (VALIDATION_LEVEL // hyper.levels) * hyper.levels
    if len(hyper.lineups) > 1:
        lineups = sub_batches(hyper.ghosts, hyper.games, hyper.levels)
        turn = segment  # rotate, so that every line-up gets wide houses
    else:
        lineups, turn = [hyper.ghosts[0]] * min(SUB_BATCHES, hyper.games, hyper.levels), 0
    count = len(lineups)
    levels, games = (np.linspace(0, total, count + 1).astype(int).tolist() for total in (hyper.levels, hyper.games))
    fastest_mps = clyde_limit(arguments, segment)
    settings = game_settings(arguments) | {"execution.rules": arguments.execution, "observation.infos": "ends"}
    made: list[PlannerGames] = []
    left = {lineup: list(chosen) for lineup, chosen in again.items()}
    for k, lineup in enumerate(lineups):
        wide = (k + turn) % _WIDE_EVERY == _WIDE_EVERY - 1
        played = list(range(first + levels[k], first + levels[k + 1]))
        if not wide:
            own_again = left.get(lineup, [])
            old, left[lineup] = own_again[: len(played) // 2], own_again[len(played) // 2 :]
            played[: len(old)] = old
        own: dict[str, Any] = {"pellets.spacing_m": WIDE * PelletConfig().spacing_m} if wide else {}
        own |= lineup_settings(arguments, lineup, fastest_mps)
        env = PacManBotVecEnv(
            games[k + 1] - games[k],
            map=f"generated:{'wide:' * wide}{','.join(map(str, played))}",
            preset=arguments.preset,
            ghosts=[copy.deepcopy(learned) if name == LEARNED else name for name in behaviours(lineup)],
            settings=settings | own,
            num_threads=_threads_of_each(arguments, count),
        )
        made.append(PlannerGames(env, hyper.reward_scale, lineup, hyper.teacher_nodes, not wide))
    return made


def _threads_of_each(arguments: Arguments, parts: int) -> int:
    return max((arguments.threads or cores()) // parts, 1)


class GhostGames(Games):
    """Games in which Clyde learns; it observes planner features from its own point of view.

    The policy ``robot`` moves the robots and keeps no state.
    """

    def __init__(self, env: PacManBotParallelVecEnv, robot: Policy, scale: float = 1.0) -> None:
        if tuple(env.possible_agents) != (PACMAN, CLYDE):
            raise ValueError(f"agents of the games: {env.possible_agents}, must be {PACMAN} and {CLYDE}")
        self.env, self.num_envs, self.scale = env, env.num_envs, np.float32(scale)
        self._robot = copy.deepcopy(robot)  # other threads play with the original
        self._robot.reset(np.ones(self.num_envs, dtype=np.bool_), env.config)

    def reset(self, seed: int) -> Observation:
        self.env.reset(seed)
        return self._observation()

    def step(self, actions: NDArray[np.int64]) -> Step:
        situation = self.env.situation
        goals = allowed(situation, self._robot.select(situation), self.env.batch.hold)
        _, rewards, terminated, truncated, infos = self.env.step({PACMAN: goals, CLYDE: actions})
        dones = terminated | truncated
        ended = np.flatnonzero(dones).tolist()
        if ended:
            self._robot.reset(dones, self.env.config)
        endings = [Ending(infos["final_info"]["outcome"][i]) for i in ended]
        return Step(self._observation(), rewards[:, 1].astype(np.float32) * self.scale, dones, endings)

    def _observation(self) -> Observation:
        situation = situation_of(self.env.batch, 0)
        candidates, whole = planner_features(situation, self.env.config.robot.speed_mps)
        return {"planner_candidates": candidates, "planner_globals": whole, "action_mask": situation.mask}


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
