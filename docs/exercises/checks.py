"""Checks of the six exercises: what a task requires, in which situations and rounds, and how many points it has.

Rounds are played and compared by the code of ``pacman-env compare``. The bars are explained in README.md.
"""

import functools
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from child import MAP, load
from numpy.typing import NDArray
from student import Missed, RemotePolicy, RemotePolicyWithState, Student, one

from pacman_env import HOLD, OUTCOMES, PELLET, BasePolicy, PacManBotVectorEnv, Situation, make_config, make_policy
from pacman_env.episodes.rollout import episode_seeds, open_games, play_in
from pacman_env.episodes.statistics import paired_difference
from pacman_env.evaluation.rounds.scenarios import open_scenario
from pacman_env.policies.policy_calls import choose, scores

EVALUATE = Path(__file__).resolve().parents[1] / "examples" / "clients" / "evaluate.py"
CONFIG = make_config()
ROUNDS, GAMES_AT_ONCE = 200, 64
FIXED_SEEDS = episode_seeds(3, ROUNDS)  # of tasks 2 to 4
SEEDS_TO_DRAW = episode_seeds(6, 1000)  # of task 6
BARS = {2: 45.0, 3: 63.0, 4: 78.0, 5: 70.0}  # completed rounds, %; README.md has the measured references
TRAIN_S, TRAINED_ROUNDS = 45.0, 100
SNAPSHOT_GAMES, SNAPSHOT_DECISIONS, SNAPSHOTS = 32, 10, 30
KEEP_M = 1.0  # how much less safe a place to wait may be
TOTAL = 10  # points of each task
COMPLETE = list(OUTCOMES).index("complete")
KINDS = ("pellet", "refuge", "hold")
Chosen = tuple[NDArray[np.int64], NDArray[np.bool_]]  # candidates (N,), right candidates (N, C)


class Item(NamedTuple):
    """A part of a task, reached if ``complaint`` is empty."""

    points: int
    what: str
    complaint: str


class Snapshot(NamedTuple):
    """Situations of the games that were running after some decisions of the built-in policy ``nearest``."""

    situation: Situation
    seeds: NDArray[np.int64]  # (N,), of ``env.reset``
    decisions: int

    def where(self, game: int) -> str:
        """Return which situation a game is in."""
        return f"map {MAP}, seed {self.seeds[game]}, after {self.decisions} decisions, game {game} of {len(self.seeds)}"


def snapshots() -> Iterator[Snapshot]:
    """Return situations from the same games each time."""
    settings = {"observation.numeric_info": True}
    env = PacManBotVectorEnv(SNAPSHOT_GAMES, map=MAP, autoreset_mode="Disabled", settings=settings)
    _, info = env.reset(seed=0)
    policy = make_policy("nearest")
    policy.reset(np.ones(SNAPSHOT_GAMES, dtype=np.bool_), env.config)
    for decisions in range(SNAPSHOTS * SNAPSHOT_DECISIONS):
        if decisions % SNAPSHOT_DECISIONS == 0:
            running = np.flatnonzero(info["outcome"] == 0)
            yield Snapshot(env.situation.rows(running).copy(), running, decisions)
        *_, info = env.step(policy.select(env.situation))
    env.close()


def some_without_pellets() -> Iterator[Snapshot]:
    """Return the snapshots, each also with the pellets of every second game forbidden."""
    for snapshot in snapshots():
        yield snapshot
        situation = snapshot.situation.copy()
        situation.mask[::2] &= situation.kind[::2] != PELLET
        yield snapshot._replace(situation=situation)


def some_late() -> Iterator[Snapshot]:
    """Return the snapshots with Clyde nearer to all pellets in every second game."""
    for snapshot in snapshots():
        s = snapshot.situation.copy()
        s.path_clyde[::2] = np.where(s.kind[::2] == PELLET, 0.5 * s.path_robot[::2], s.path_clyde[::2])
        yield snapshot._replace(situation=s)


def new_policy(student: Student, name: str) -> BasePolicy:
    """Create the student's policy; raises Missed if it is none, or a built-in one."""
    facts, _ = student.ask("bases", name)
    own = [base for base in facts["bases"] if base[0].startswith("pacman_env.")]
    if own != [[BasePolicy.__module__, BasePolicy.__qualname__]]:
        raise Missed(f"expected a class of your own, derived from BasePolicy alone, got {facts['text']}")
    stateless = student.ask("create", name)[0]["stateless"]
    games = np.ones(SNAPSHOT_GAMES, dtype=np.bool_)
    student.ask("reset", arrays=[games])
    return (RemotePolicy if stateless else RemotePolicyWithState)(student)


def choices(points: int, rule: str, judge: Callable[[Situation], Chosen], seen: Iterator[Snapshot]) -> Item:
    """Return an item that needs each choice (N,) of ``judge`` to be among its right candidates (N, C)."""
    for snapshot in seen:
        s, (chosen, right) = snapshot.situation, judge(snapshot.situation)
        for game in np.flatnonzero(~right[np.arange(len(s)), chosen])[:1]:
            c, expected = chosen[game], np.flatnonzero(right[game]).tolist()
            paths = f"robot {s.path_robot[game, c]:.2f} m, Clyde {s.path_clyde[game, c]:.2f} m"
            text = f"expected a candidate of {expected}, got {c} ({KINDS[s.kind[game, c]]}, {paths})"
            return Item(points, rule, f"{snapshot.where(game)}: {text}")
    return Item(points, rule, "")


def played(policy: BasePolicy | str, seeds: NDArray[np.uint64]) -> NDArray[Any]:
    """Return the records of rounds, which depend on policy and seeds only."""
    batch, ghosts = open_games(open_scenario(MAP, CONFIG), CONFIG, GAMES_AT_ONCE)
    return play_in(batch, policy, seeds, ghosts=ghosts, timed=False)[0]


def completion(points: int, bar: float, complete: NDArray[np.bool_], seeds: Sequence[int]) -> Item:
    """Return an item that needs a share of completed rounds, in %."""
    got, lost = 100.0 * complete.mean(), [seeds[k] for k in np.flatnonzero(~complete)[:3]]
    complaint = f"expected at least {bar:.1f} %, got {got:.1f} %; rounds not completed: seeds {lost}, ..."
    what = f"completes at least {bar:.0f} % of {len(seeds)} rounds: {got:.1f} %"
    return Item(points, what, "" if got >= bar else complaint)


def fixed_rounds(points: int, policy: BasePolicy, bar: float) -> Item:
    """Play the fixed seeds and return the item of the completed rounds."""
    return completion(points, bar, played(policy, FIXED_SEEDS)["end"] == COMPLETE, FIXED_SEEDS.tolist())


def gap(s: Situation) -> NDArray[np.float64]:
    """Return the straight distance (N, 1) between robot and Clyde, m."""
    return np.linalg.norm(s.clyde - s.robot[:, :2], axis=1)[:, None]


def task_1(student: Student) -> Iterator[Item]:
    """Read a situation."""
    complaints = ["", ""]
    for snapshot in some_without_pellets():
        s = snapshot.situation
        facts, arrays = student.ask_about("call", s, "nearest_pellet")
        after, got = arrays[: len(s.arrays())], arrays[len(s.arrays()) :]
        if [part.shape for part in got] != [(len(s),)] * 2:
            raise Missed(f"expected two arrays of shape ({len(s)},), got {facts['text']}")
        if not all(map(functools.partial(np.array_equal, equal_nan=True), s.arrays(), after)):
            raise Missed("expected an unchanged situation, but nearest_pellet has written into its arrays")
        ways = np.where(s.mask & (s.kind == PELLET), s.path_robot, np.inf)
        distance, nearest = ways.min(axis=1), ways.argmin(axis=1)
        nearer = np.isfinite(distance) & (s.path_clyde[np.arange(len(s)), nearest] < distance)
        for part, right in enumerate((distance, nearer)):
            for game in np.flatnonzero(~np.isclose(got[part], right))[:1]:
                text = f"{snapshot.where(game)}: expected {right[game]}, got {got[part][game]}"
                text += " (0.0 m is the candidate hold, not a pellet)" if part == 0 and got[0][game] == 0.0 else ""
                complaints[part] = complaints[part] or text
    yield Item(5, "distance of the nearest allowed pellet", complaints[0])
    yield Item(5, "whether Clyde is nearer to it", complaints[1])


def task_2(student: Student) -> Iterator[Item]:
    """Nearest."""
    policy = new_policy(student, "Nearest")

    def judge(s: Situation) -> Chosen:
        ways = np.where(s.mask & (s.kind == PELLET), s.path_robot, np.inf)
        nearest = ways.min(axis=1)[:, None]
        return scores(policy, s).argmax(axis=1), np.where(np.isfinite(nearest), ways <= nearest, s.kind == HOLD)

    rule = "gives the highest score to the nearest allowed pellet, or to hold if there is none"
    yield choices(6, rule, judge, some_without_pellets())
    yield fixed_rounds(4, policy, BARS[2])


def task_3(student: Student) -> Iterator[Item]:
    """Avoid."""
    policy = new_policy(student, "Avoid")

    def judge(s: Situation, waiting: bool) -> Chosen:
        first = s.mask & (s.path_robot / CONFIG.robot.speed_mps < s.path_clyde / s.clyde_speed[:, None])
        opened = first & (s.kind == PELLET)
        far = np.where(first & (s.kind != PELLET), np.where(s.kind == HOLD, gap(s), s.path_clyde), -np.inf)
        right = far >= far.max(axis=1)[:, None] - KEEP_M if waiting else opened
        return choose(policy, s), right | (opened.any(axis=1)[:, None] == waiting)

    yield choices(3, "chooses an open pellet if there is one", lambda s: judge(s, False), snapshots())
    yield choices(2, "waits in the safest place if there is none", lambda s: judge(s, True), some_late())
    yield fixed_rounds(5, policy, BARS[3])


def task_4(student: Student) -> Iterator[Item]:
    """Look ahead."""
    policy = new_policy(student, "LookAhead")

    def judge(s: Situation) -> Chosen:
        longer = np.where(s.mask & (s.kind != HOLD), gap(s) + s.path_clyde - s.path_robot, np.nan)
        behind = (s.kind == PELLET) & (longer < 0.5) & (gap(s) < 2.0)
        others = np.any(longer > 3.0, axis=1, keepdims=True)
        return choose(policy, s), ~(behind & others)

    yield choices(4, "chooses no pellet behind Clyde", judge, snapshots())
    yield fixed_rounds(6, policy, BARS[4])


def task_5(student: Student) -> Iterator[Item]:
    """Train."""
    began_s = student.processor_s
    facts, _ = student.ask("train", "train")
    used_s = student.processor_s - began_s
    if not facts["predicts"]:
        need = "a model with predict(observation, action_masks, deterministic)"
        raise Missed(f"train must return {need}, got {facts['text']}")
    late = "" if used_s <= TRAIN_S else f"expected at most {TRAIN_S:.0f} s, got {used_s:.0f} s"
    yield Item(3, f"trains within {TRAIN_S:.0f} s of processor time", late)

    def act(observation: Any, masks: NDArray[np.bool_]) -> NDArray[np.int64]:
        actions = one(student.ask("predict", arrays=[observation, masks]))
        if actions.shape != (len(masks),) or actions.dtype.kind not in "iu":
            raise Missed(f"expected {len(masks)} integers of predict, got {actions.dtype} of shape {actions.shape}")
        for game, action in enumerate(actions.tolist()):
            if action not in (may := np.flatnonzero(masks[game]).tolist()):
                raise Missed(f"game {game}: expected an action that the mask allows, {may}, got {action}")
        return actions

    complete = load(EVALUATE).completed(act, MAP, TRAINED_ROUNDS, seed=0)
    yield completion(7, BARS[5], complete, range(TRAINED_ROUNDS))


def task_6(student: Student, draw: int = 0) -> Iterator[Item]:
    """Beat the scorer."""
    policy = new_policy(student, "Best")
    seeds = np.random.default_rng(draw).choice(SEEDS_TO_DRAW, ROUNDS, replace=False)
    ours, theirs = (played(one, seeds)["end"] == COMPLETE for one in (policy, "clyde_aware"))
    more, (low, high) = paired_difference(ours, theirs)
    rates = f"{100 * ours.mean():.1f} %, clyde_aware {100 * theirs.mean():.1f} % of {ROUNDS} rounds (draw {draw})"
    interval = f"{100 * more:+.1f} [{100 * low:+.1f}, {100 * high:+.1f}]"
    lost = f"rounds that only clyde_aware completed: seeds {seeds[theirs & ~ours][:3].tolist()}, ..."
    fewer = "" if more > 0 else f"expected more rounds, got a difference of {100 * more:+.1f}; {lost}"
    unclear = "" if low > 0 else f"expected a lower limit above 0, got {100 * low:+.1f}; {lost}"
    yield Item(6, f"completes more rounds than clyde_aware: {rates}", fewer)
    yield Item(4, f"the 95 % interval of the difference is above 0: {interval}", unclear)


TASKS = {1: task_1, 2: task_2, 3: task_3, 4: task_4, 5: task_5, 6: task_6}
