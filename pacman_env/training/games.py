"""The games that a planner, or a Clyde against it, is trained on: generated houses, many games at once."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from itertools import chain
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pacman_env.config import Config, PelletConfig, make_config
from pacman_env.engine.threads import cores
from pacman_env.envs.parallel_vec_env import PACMAN, PacManBotParallelVecEnv
from pacman_env.episodes.rollout import allowed
from pacman_env.game.ghosts import GHOST_NAMES
from pacman_env.policies.base import Policy
from pacman_env.policies.opponents import BehaviourOpponent
from pacman_env.policies.registry import make_policy
from pacman_env.sb3 import Observation, PacManBotVecEnv
from pacman_env.sim.maps.level_source import WIDE
from pacman_env.sim.observation.planner_features import CANDIDATE_FEATURES, planner_features
from pacman_env.training.arguments import Arguments
from pacman_env.training.learnability import LevelCounts
from pacman_env.training.lineups import LEARNED, RULE, SUB_BATCHES, behaviours, make_teacher, speeds, sub_batches

#: Observations, rewards, dones and infos; infos may be empty but where a round ended.
Step = tuple[Observation, NDArray[np.float32], NDArray[np.bool_], list[dict[str, Any]]]
CLYDE = GHOST_NAMES[0]
_CHASE = partial(BehaviourOpponent, "chase")
_WIDE_EVERY = 4  # sub-batches
VALIDATION_LEVEL = 900_000  # training levels from here on are never trained on: runs are chosen on them
#: Ranges of --randomize, around what the real trials had.
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
    """The game that is trained on."""
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


def lineup_speeds(arguments: Arguments, lineup: str, fastest_mps: float | None = None) -> tuple[float, float]:
    """The range of the speeds of a line-up's ghosts, m/s, which ``fastest_mps`` caps."""
    low, high = speeds(lineup) or arguments.hyper.clyde_speed
    return low, high if fastest_mps is None else max(low, min(high, fastest_mps))


def clyde_limit(arguments: Arguments, segment: int) -> float | None:
    """Clyde's highest speed in a segment, m/s, under a curriculum."""
    if not arguments.curriculum:
        return None
    low, high = arguments.hyper.clyde_speed
    share = min(1.0, (segment + 1) / max(arguments.hyper.segments / 2, 1))
    return low + (high - low) * (0.3 + 0.7 * share)


def dropped(arguments: Arguments) -> dict[str, Any]:
    """Columns that the network of an ablation does not see, and columns of the kinds it may not choose."""
    without = arguments.without
    names = (_PATHS if "paths" in without else ()) + (_PREDICTION if "prediction" in without else ())
    kinds = [kind for kind, part in (("is_refuge", "refuges"), ("is_hold", "hold")) if part in without]
    return {
        "dropped_features": tuple(CANDIDATE_FEATURES.index(name) for name in names),
        "dropped_kinds": tuple(CANDIDATE_FEATURES.index(name) for name in kinds),
    }


class TrainingGames:
    """Games in sub-batches with houses of their own: few houses at a time stay in the processor's cache.

    Sub-batches form two groups, each stepped by a thread in the ``background`` while the network chooses for the other;
    the threads do not change the games. Rewards are multiplied by ``scale``. A time limit is an ending like any other:
    a robot that hides until then loses.
    """

    def __init__(
        self,
        batches: Sequence[PacManBotVecEnv],
        scale: float = 1.0,
        background: bool = False,
        teachers: Sequence[Callable[[], Policy]] = (),
        lineups: Sequence[str | None] = (),
    ) -> None:
        """``teachers``: what makes each sub-batch's own, for :meth:`choices`; without them it is ``lookahead``.

        ``lineups``: of each sub-batch, whose levels may be played again.
        """
        if not batches:
            raise ValueError("no games to play")
        candidates = {games.env.batch.candidates for games in batches}
        if len(candidates) != 1:
            raise ValueError(f"candidates of the sub-batches: {sorted(candidates)}, must be as many in each")
        self.batches, self._scale = list(batches), np.float32(scale)
        self._starts = [0, *np.cumsum([games.num_envs for games in batches]).tolist()]
        self.num_envs = self._starts[-1]
        middle = len(batches) // 2
        self._halves = [half for half in (range(middle), range(middle, len(batches))) if half]
        self.groups = [slice(self._starts[half[0]], self._starts[half[-1] + 1]) for half in self._halves]
        self._sent: list[Callable[[], Step] | None] = [None for _ in self.groups]
        self._pool = ThreadPoolExecutor(len(self.groups), "games") if background else None
        self.counts = LevelCounts(lineups or [None] * len(batches))
        self._makers = list(teachers) or [partial(make_policy, RULE) for _ in batches]
        self._teachers: dict[str | None, list[Policy]] = {}

    def reset(self, seed: int) -> Observation:
        self._teachers = {}
        self.counts.clear()
        for games, start in zip(self.batches, self._starts, strict=False):
            games.seed(seed + start)
        return _joined([games.reset() for games in self.batches])

    def send(self, group: int, actions: NDArray[Any]) -> None:
        """Have the games of a group do their next decision; other groups may be sent before it is received."""
        step = partial(self._step, self._halves[group], np.asarray(actions))
        self._sent[group] = step if self._pool is None else self._pool.submit(step).result

    def receive(self, group: int) -> Step:
        receive, self._sent[group] = self._sent[group], None
        if receive is None:
            raise RuntimeError("no actions were sent to these games")
        return receive()

    def step(self, actions: NDArray[Any]) -> Step:
        for k, rows in enumerate(self.groups):
            self.send(k, np.asarray(actions)[rows])
        return _in_a_row(map(self.receive, range(len(self.groups))))

    def _step(self, half: range, actions: NDArray[Any]) -> Step:
        ends = [self._starts[k + 1] - self._starts[half[0]] for k in half[:-1]]
        results = []
        for k, own in zip(half, np.split(actions, ends), strict=True):
            self.batches[k].step_async(own)
            results.append(self.batches[k].step_wait())
            for teachers in self._teachers.values():
                teachers[k].reset(results[-1][2], self.batches[k].env.config)
            for i in np.flatnonzero(results[-1][2]).tolist():
                info = results[-1][3][i]
                if "level" in info:
                    self.counts.add(k, info["level"], info["outcome"] == "complete")
        observations, rewards, dones, infos = _in_a_row(results)
        return observations, rewards * self._scale, dones, infos

    def choices(self, policy: str | None = None) -> NDArray[np.int64]:
        """(N,) the choices in each game now of a registered policy, or of each sub-batch's own teacher.

        Threads in the background choose for different sub-batches, which have policies of their own.
        """
        if policy not in self._teachers:
            makers = self._makers if policy is None else [partial(make_policy, policy) for _ in self.batches]
            self._teachers[policy] = [make() for make in makers]
            for games, teacher in zip(self.batches, self._teachers[policy], strict=True):
                teacher.reset(np.ones(games.num_envs, dtype=np.bool_), games.env.config)
        teachers = self._teachers[policy]

        def select(k: int) -> NDArray[np.int64]:
            return teachers[k].select(self.batches[k].env.situation)

        numbers = range(len(self.batches))
        # In two threads a search for 64 games against chase or arcade takes 35 ms, in one 56; lookahead's 2 ms stay.
        return np.concatenate(list(map(select, numbers) if self._pool is None else self._pool.map(select, numbers)))

    def close(self) -> None:
        if self._pool is not None:
            self._pool.shutdown()
        for games in self.batches:
            games.close()


def _in_a_row(results: Iterable[Step]) -> Step:
    observations, rewards, dones, infos = zip(*results, strict=True)
    return _joined(observations), np.concatenate(rewards), np.concatenate(dones), list(chain.from_iterable(infos))


def _joined(observations: Sequence[Any]) -> Observation:
    return {key: np.concatenate([observation[key] for observation in observations]) for key in observations[0]}


def make_games(
    arguments: Arguments,
    segment: int,
    learned: Callable[[], Policy] = _CHASE,
    again: Mapping[str, Sequence[int]] = MappingProxyType({}),
) -> TrainingGames:
    """The games of a segment, in houses of its own; a quarter of the sub-batches is in houses twice as wide and sparse.

    Each sub-batch has one of the hyperparameters' line-ups; ``learned`` makes what moves a ghost of that name in them.
    ``again``: by line-up, earlier levels that take the places of half of the segment's own in houses of usual size.
    """
    hyper = arguments.hyper
    if hyper.levels > VALIDATION_LEVEL:
        raise ValueError(f"levels = {hyper.levels}: there are {VALIDATION_LEVEL} to train on")
    first = segment % (VALIDATION_LEVEL // hyper.levels) * hyper.levels
    threads = arguments.threads or cores()  # of which each of two groups has half: more would wait for one another
    if len(hyper.lineups) > 1:
        lineups = sub_batches(hyper.ghosts, hyper.games, hyper.levels)
        turn = segment  # the wide houses go round, so that every line-up meets them
    else:
        lineups, turn = [hyper.ghosts[0]] * min(SUB_BATCHES, hyper.games, hyper.levels), 0
    count = len(lineups)
    levels, games = (np.linspace(0, total, count + 1).astype(int).tolist() for total in (hyper.levels, hyper.games))
    fastest_mps = clyde_limit(arguments, segment)
    settings = game_settings(arguments) | {"execution.rules": arguments.execution, "observation.infos": "ends"}
    made: list[PacManBotVecEnv] = []
    may_again: list[str | None] = []
    left = {lineup: list(chosen) for lineup, chosen in again.items()}
    for k, lineup in enumerate(lineups):
        wide = (k + turn) % _WIDE_EVERY == _WIDE_EVERY - 1
        played = list(range(first + levels[k], first + levels[k + 1]))
        may_again.append(None if wide else lineup)
        if not wide:
            own_again = left.get(lineup, [])
            old, left[lineup] = own_again[: len(played) // 2], own_again[len(played) // 2 :]
            played[: len(old)] = old
        own: dict[str, Any] = {"pellets.spacing_m": WIDE * PelletConfig().spacing_m} if wide else {}
        own |= {"randomize.clyde_speed_mps": lineup_speeds(arguments, lineup, fastest_mps)}
        made.append(
            PacManBotVecEnv(
                games[k + 1] - games[k],
                map=f"generated:{'wide:' * wide}{','.join(map(str, played))}",
                preset=arguments.preset,
                settings=settings | own,
                ghosts=[learned() if name == LEARNED else name for name in behaviours(lineup)],
                num_threads=max(threads // 2, 1),
            )
        )
    teachers = [partial(make_teacher, lineup, hyper.teacher_nodes) for lineup in lineups]
    return TrainingGames(made, hyper.reward_scale, background=threads != 1, teachers=teachers, lineups=may_again)


class GhostGames:
    """Games in which the agent is Clyde and sees planner features from its side; ``robot`` chooses for the robots."""

    def __init__(self, env: PacManBotParallelVecEnv, robot: Policy, scale: float = 1.0) -> None:
        if tuple(env.possible_agents) != (PACMAN, CLYDE):
            raise ValueError(f"agents of the games: {env.possible_agents}, must be {PACMAN} and {CLYDE}")
        self.env, self._robot, self._scale = env, robot, np.float32(scale)
        self.num_envs, self.groups = env.num_envs, [slice(0, env.num_envs)]
        self._actions: NDArray[Any] = np.zeros(0, dtype=np.int64)

    def reset(self, seed: int) -> Observation:
        self.env.reset(seed)
        self._robot.reset(np.ones(self.num_envs, dtype=np.bool_), self.env.config)
        return self._observation()

    def send(self, group: int, actions: NDArray[Any]) -> None:
        self._actions = actions

    def receive(self, group: int) -> Step:
        situation = self.env.situation
        goals = allowed(situation, self._robot.select(situation), self.env.batch.hold)
        _, rewards, terminated, truncated, infos = self.env.step({PACMAN: goals, CLYDE: self._actions})
        ended: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        dones = terminated | truncated
        if dones.any():
            self._robot.reset(dones, self.env.config)
            for i in np.flatnonzero(dones).tolist():
                ended[i] = {"outcome": infos["final_info"]["outcome"][i]}
        return self._observation(), rewards[:, 1].astype(np.float32) * self._scale, dones, ended

    def _observation(self) -> Observation:
        situation = self.env.batch.situation(0)
        candidates, whole = planner_features(situation, self.env.config.robot.speed_mps)
        return {"planner_candidates": candidates, "planner_globals": whole, "action_mask": situation.mask}

    def close(self) -> None:
        self.env.close()


def make_ghost_games(arguments: Arguments, segment: int, robot: Policy) -> GhostGames:
    """Clyde's games of a segment, zero-sum, in houses of the segment."""
    hyper = arguments.hyper
    # The robot's policy reads the situation: its agent's observation is not needed.
    settings = game_settings(arguments) | {"observation.kinds": ("features",), "zero_sum": True}
    settings |= {"execution.rules": arguments.execution, "num_levels": hyper.levels}
    settings["start_level"] = segment % (VALIDATION_LEVEL // hyper.levels) * hyper.levels
    env = PacManBotParallelVecEnv(
        hyper.games,
        map="generated",
        preset=arguments.preset,
        ghosts=("policy",),
        settings=settings,
        num_threads=arguments.threads or cores(),
    )
    return GhostGames(env, robot, hyper.reward_scale)
