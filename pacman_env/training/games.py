"""The games that a planner, or a Clyde against it, is trained on: generated houses, many games at once."""

from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from itertools import chain
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pacman_env.config import Config, PelletConfig, make_config
from pacman_env.engine.threads import cores
from pacman_env.envs.arguments import Ghosts
from pacman_env.envs.pettingzoo_env import PACMAN, PacManBotParallelEnv
from pacman_env.episodes.rollout import allowed
from pacman_env.game.ghosts import GHOST_NAMES
from pacman_env.policies.base import Policy
from pacman_env.policies.registry import make_policy
from pacman_env.sb3 import Observation, PacManBotVecEnv
from pacman_env.sim.maps.level_source import WIDE
from pacman_env.sim.observation.planner_features import CANDIDATE_FEATURES, planner_features
from pacman_env.training.arguments import Arguments
from pacman_env.training.lineups import RULE, SUB_BATCHES, behaviours, make_teacher, sub_batches

#: Observations, rewards, dones and infos; infos may be empty but where a round ended.
Step = tuple[Observation, NDArray[np.float32], NDArray[np.bool_], list[dict[str, Any]]]
CLYDE = GHOST_NAMES[0]
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


def game_config(arguments: Arguments, fastest_mps: float | None = None) -> Config:
    """The game that is trained on; ``fastest_mps`` caps Clyde's speed."""
    return make_config(arguments.preset, arguments.execution, **game_settings(arguments, fastest_mps))


def game_settings(arguments: Arguments, fastest_mps: float | None = None) -> dict[str, Any]:
    hyper = arguments.hyper
    low, high = hyper.clyde_speed
    high = high if fastest_mps is None else max(low, min(high, fastest_mps))
    return {
        "randomize.clyde_speed_mps": (low, high),
        "randomize.speed_mps": hyper.robot_speed,
        "observation.kinds": ("planner",),
        "decisions.when": hyper.decide,
        "reward.timeout": hyper.timeout,
        **(_DOMAIN if arguments.randomize else {}),
    }


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
    ) -> None:
        """``teachers``: what makes each sub-batch's own, for :meth:`choices`; without them it is ``lookahead``."""
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
        self._makers = list(teachers) or [partial(make_policy, RULE) for _ in batches]
        self._teachers: dict[str | None, list[Policy]] = {}

    def reset(self, seed: int) -> Observation:
        self._teachers = {}
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


def make_games(arguments: Arguments, segment: int, ghosts: Ghosts | None = None) -> TrainingGames:
    """The games of a segment, in houses of its own; a quarter of the sub-batches is in houses twice as wide and sparse.

    Each sub-batch has one of the hyperparameters' line-ups, or ``ghosts`` if they are given.
    """
    hyper = arguments.hyper
    if hyper.levels > VALIDATION_LEVEL:
        raise ValueError(f"levels = {hyper.levels}: there are {VALIDATION_LEVEL} to train on")
    first = segment % (VALIDATION_LEVEL // hyper.levels) * hyper.levels
    threads = arguments.threads or cores()  # of which each of two groups has half: more would wait for one another
    if ghosts is None and len(hyper.lineups) > 1:
        lineups = sub_batches(hyper.ghosts, hyper.games, hyper.levels)
        turn = segment  # the wide houses go round, so that every line-up meets them
    else:
        lineups, turn = [hyper.ghosts[0]] * min(SUB_BATCHES, hyper.games, hyper.levels), 0
    count = len(lineups)
    levels, games = (np.linspace(0, total, count + 1).astype(int).tolist() for total in (hyper.levels, hyper.games))
    settings = game_settings(arguments, clyde_limit(arguments, segment))
    settings |= {"execution.rules": arguments.execution, "observation.infos": "ends"}
    made = []
    for k, lineup in enumerate(lineups):
        wide = (k + turn) % _WIDE_EVERY == _WIDE_EVERY - 1
        own = {"start_level": first + levels[k], "num_levels": levels[k + 1] - levels[k]}
        own |= {"pellets.spacing_m": WIDE * PelletConfig().spacing_m} if wide else {}
        made.append(
            PacManBotVecEnv(
                games[k + 1] - games[k],
                map="generated:wide" if wide else "generated",
                preset=arguments.preset,
                settings=settings | own,
                ghosts=behaviours(lineup) if ghosts is None else ghosts,
                num_threads=max(threads // 2, 1),
            )
        )
    teachers = [partial(make_teacher, lineup, hyper.teacher_nodes) for lineup in lineups]
    return TrainingGames(made, hyper.reward_scale, background=threads != 1, teachers=teachers)


class GhostGames:
    """Games in which the agent is Clyde and sees planner features from its side; ``robot`` makes robots' policies."""

    def __init__(self, games: Sequence[PacManBotParallelEnv], robot: Callable[[], Policy], scale: float = 1.0) -> None:
        shapes = sorted({(tuple(game.possible_agents), game.batch.candidates) for game in games})
        if len(shapes) != 1 or shapes[0][0] != (PACMAN, CLYDE):
            raise ValueError(f"agents and candidates of the games: {shapes}, must be alike and {PACMAN}, {CLYDE}")
        self.games, self._robots, self._scale = list(games), [robot() for _ in games], np.float32(scale)
        self.num_envs, self.groups = len(games), [slice(0, len(games))]
        self._actions: NDArray[Any] = np.zeros(0, dtype=np.int64)

    def reset(self, seed: int) -> Observation:
        return _joined([self._begin(k, seed + k) for k in range(self.num_envs)])

    def send(self, group: int, actions: NDArray[Any]) -> None:
        self._actions = actions

    def receive(self, group: int) -> Step:
        observations, infos = [], []
        rewards, dones = np.zeros(self.num_envs, dtype=np.float32), np.zeros(self.num_envs, dtype=np.bool_)
        for k, (game, robot) in enumerate(zip(self.games, self._robots, strict=True)):
            situation = game.batch.situation()
            goal = allowed(situation, robot.select(situation), game.batch.hold)[0]
            _, reward, terminated, truncated, info = game.step({PACMAN: goal, CLYDE: self._actions[k]})
            rewards[k], dones[k] = reward[CLYDE], terminated[CLYDE] or truncated[CLYDE]
            observations.append(self._begin(k) if dones[k] else self._observation(game))
            infos.append(info[CLYDE])
        return _joined(observations), rewards * self._scale, dones, infos

    def _begin(self, k: int, seed: int | None = None) -> Observation:
        self.games[k].reset(seed)
        self._robots[k].reset(np.ones(1, dtype=np.bool_), self.games[k].config)
        return self._observation(self.games[k])

    @staticmethod
    def _observation(game: PacManBotParallelEnv) -> Observation:
        situation = game.batch.situation(0)
        candidates, whole = planner_features(situation, game.config.robot.speed_mps)
        return {"planner_candidates": candidates, "planner_globals": whole, "action_mask": situation.mask}

    def close(self) -> None:
        for game in self.games:
            game.close()


def make_ghost_games(arguments: Arguments, segment: int, robot: Callable[[], Policy]) -> GhostGames:
    """Clyde's games of a segment, zero-sum, each with its share of the segment's houses."""
    hyper = arguments.hyper
    each = max(hyper.levels // hyper.games, 1)
    first = segment % (VALIDATION_LEVEL // (each * hyper.games)) * each * hyper.games
    # The robot's policy reads the situation: its agent's observation is not needed.
    settings = game_settings(arguments) | {"observation.kinds": ("features",), "zero_sum": True}
    settings |= {"execution.rules": arguments.execution}
    games = [
        PacManBotParallelEnv(
            "generated",
            preset=arguments.preset,
            ghosts=("policy",),
            settings={**settings, "start_level": first + i * each, "num_levels": each},
        )
        for i in range(hyper.games)
    ]
    return GhostGames(games, robot, hyper.reward_scale)
