"""Grade the exercises: ``python docs/exercises/grade.py [--task N] [--file tasks.py] [--draw N]``.

Exit status: 0 if all points were reached, 1 if not, 2 for wrong usage. Rounds are played and compared by the code of
``pacman-env compare``. docs/exercises/README.md has the tasks and how the bars were measured.
"""

import argparse
import contextlib
import importlib.util
import sys
import time
import traceback
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pacman_env import HOLD, OUTCOMES, PELLET, BasePolicy, PacManBotVectorEnv, Situation, make_config, make_policy
from pacman_env.episodes.rollout import episode_seeds, open_games, play_in
from pacman_env.episodes.statistics import paired_difference
from pacman_env.evaluation.rounds.scenarios import open_scenario
from pacman_env.policies.asking import PolicyError, choose, reset, scores

FOLDER = Path(__file__).resolve().parent
CONFIG = make_config()
MAP, ROUNDS, GAMES_AT_ONCE = "house", 200, 64
FIXED_SEEDS = episode_seeds(3, ROUNDS)  # of tasks 2 to 4
SEEDS_TO_DRAW = episode_seeds(6, 1000)  # of task 6
BARS = {2: 50.0, 3: 66.0, 4: 78.0, 5: 45.0}  # completed rounds, %
TRAIN_S, TRAINED_ROUNDS = 45.0, 100
SNAPSHOT_GAMES, SNAPSHOT_DECISIONS, SNAPSHOTS = 32, 10, 30
KEEP_M = 1.0  # how much less safe a place to wait may be
TOTAL = 10  # points of a task
COMPLETE = list(OUTCOMES).index("complete")
KINDS = ("pellet", "refuge", "hold")


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
        """Return how to reach the situation of a game."""
        return f"map {MAP}, seed {self.seeds[game]}, game {game} of {len(self.seeds)}, after {self.decisions} decisions"


class Missed(Exception):
    """Raised if a task cannot be graded further."""


def snapshots() -> Iterator[Snapshot]:
    """Return situations from the same games each time; in every second one all pellets are forbidden at the end."""
    env = PacManBotVectorEnv(
        SNAPSHOT_GAMES, map=MAP, autoreset_mode="Disabled", settings={"observation.numeric_info": True}
    )
    _, info = env.reset(seed=0)
    policy = make_policy("nearest")
    policy.reset(np.ones(SNAPSHOT_GAMES, dtype=np.bool_), env.config)
    for decisions in range(SNAPSHOTS * SNAPSHOT_DECISIONS):
        running = np.flatnonzero(info["outcome"] == 0)
        if decisions % SNAPSHOT_DECISIONS == 0:
            yield Snapshot(env.situation.rows(running).copy(), running, decisions)
        *_, info = env.step(policy.select(env.situation))
    env.close()


def changed(snapshot: Snapshot, *, late: bool = False) -> Snapshot:
    """Forbid the pellets of every second game; with ``late``, let Clyde be nearer to them instead."""
    situation = snapshot.situation.copy()
    pellet = situation.kind[::2] == PELLET
    if late:
        situation.path_clyde[::2] = np.where(pellet, 0.5 * situation.path_robot[::2], situation.path_clyde[::2])
    else:
        situation.mask[::2] &= ~pellet
    return snapshot._replace(situation=situation)


def named(situation: Situation, game: int, candidate: int) -> str:
    """Return a candidate in words."""
    robot_m, clyde_m = situation.path_robot[game, candidate], situation.path_clyde[game, candidate]
    paths = f"robot {robot_m:.2f} m, Clyde {clyde_m:.2f} m"
    return f"candidate {candidate} ({KINDS[situation.kind[game, candidate]]}, {paths})"


def of_student(student: ModuleType, name: str) -> Any:
    """Return a class or function of the student's file."""
    if not callable(thing := getattr(student, name, None)):
        raise Missed(f"expected a class or function {name!r} in the file, found none")
    return thing


def new_policy(student: ModuleType, name: str) -> BasePolicy:
    """Create the student's policy; raises Missed if it is none, or a built-in one."""
    kind = of_student(student, name)
    if not (isinstance(kind, type) and issubclass(kind, BasePolicy)):
        raise Missed(f"expected a subclass of BasePolicy, got {name} = {kind!r}")
    built_in = [base.__name__ for base in kind.__mro__ if base.__module__.startswith("pacman_env.")]
    if built_in != ["BasePolicy"]:
        raise Missed(f"expected rules of your own, but {name} derives from the built-in {built_in[0]}")
    policy: BasePolicy = kind()
    reset(policy, np.ones(SNAPSHOT_GAMES, dtype=np.bool_), CONFIG)
    policy.scores(next(snapshots()).situation)  # says "not written yet" before anything is judged
    return policy


def played(policy: BasePolicy | str, seeds: NDArray[np.uint64]) -> NDArray[Any]:
    """Return the records of rounds, which depend on policy and seeds only."""
    batch, ghosts = open_games(open_scenario(MAP, CONFIG), CONFIG, GAMES_AT_ONCE)
    return play_in(batch, policy, seeds, ghosts=ghosts, timed=False)[0]


def share(complete: NDArray[np.bool_], bar: float, which: Sequence[str]) -> str:
    """Return the complaint about too few completed rounds, or an empty text; ``which`` names the rounds."""
    got = 100.0 * complete.mean()
    lost = [which[k] for k in np.flatnonzero(~complete)[:3]]
    return "" if got >= bar else f"expected at least {bar:.1f} %, got {got:.1f} %; not completed: {'; '.join(lost)}"


def rounds_item(points: int, policy: BasePolicy, bar: float) -> Item:
    """Play the fixed seeds and require a share of completed rounds."""
    records = played(policy, FIXED_SEEDS)
    rows = zip(records["seed"].tolist(), records["end"].tolist(), records["time_s"].tolist(), strict=True)
    which = [f"seed {seed} ({OUTCOMES[end]} after {time_s:.0f} s)" for seed, end, time_s in rows]
    complaint = share(records["end"] == COMPLETE, bar, which)
    return Item(points, f"completes {bar:.0f} % of {ROUNDS} rounds", complaint)


def situations_item(
    points: int, what: str, judge: Callable[[Situation], Iterator[tuple[int, str]]], seen: Iterator[Snapshot]
) -> Item:
    """Return the first complaint of ``judge``, which gives games and complaints for the games of a snapshot."""
    found = (f"{snapshot.where(game)}: {text}" for snapshot in seen for game, text in judge(snapshot.situation))
    return Item(points, what, next(found, ""))


def mistakes(situation: Situation, chosen: NDArray[np.int64], right: NDArray[np.bool_], rule: str) -> Any:
    """Return game and complaint for each choice (N,) that is not among the candidates ``right`` (N, C)."""
    for game in np.flatnonzero(~right[np.arange(len(chosen)), chosen]).tolist():
        expected = ", ".join(map(str, np.flatnonzero(right[game]))) or "none"
        yield game, f"expected {rule} ({expected}), got {named(situation, game, int(chosen[game]))}"


def task_1(student: ModuleType) -> Iterator[Item]:
    """Compare distances and flags with those of plain loops."""
    read = of_student(student, "nearest_pellet")

    def judge(number: int, s: Situation) -> Iterator[tuple[int, str]]:
        given = s.copy()
        got = read(given)
        if not (isinstance(got, tuple) and [np.shape(part) for part in got] == [(len(s),)] * 2):
            raise Missed(f"expected two arrays of shape ({len(s)},), got {got!r}")
        if any(not np.array_equal(ours, theirs) for ours, theirs in zip(s.arrays(), given.arrays(), strict=True)):
            raise Missed("expected an unchanged situation, but nearest_pellet has written into its arrays")
        for game in range(len(s)):
            ways = [
                (way, clyde < way)
                for way, clyde, kind, may in zip(
                    s.path_robot[game], s.path_clyde[game], s.kind[game], s.mask[game], strict=True
                )
                if kind == PELLET and may
            ]
            expected = min(ways, default=(np.inf, False), key=lambda pair: pair[0])[number]
            if not np.isclose(got[number][game], expected):
                yield game, f"expected {expected}, got {got[number][game]}"

    for number, what in enumerate(("distance of the nearest allowed pellet", "whether Clyde is nearer to it")):
        seen = (one for snapshot in snapshots() for one in (snapshot, changed(snapshot)))
        yield situations_item(5, what, lambda s, number=number: judge(number, s), seen)


def task_2(student: ModuleType) -> Iterator[Item]:
    """Require the nearest allowed pellet in every situation."""
    policy = new_policy(student, "Nearest")

    def judge(s: Situation) -> Iterator[tuple[int, str]]:
        best = scores(policy, s).argmax(axis=1)
        pellet = s.mask & (s.kind == PELLET)
        ways = np.where(pellet, s.path_robot, np.inf)
        right = np.where(pellet.any(axis=1)[:, None], pellet & (ways <= ways.min(axis=1)[:, None]), s.kind == HOLD)
        yield from mistakes(s, best, right, "the highest score for the nearest allowed pellet, else hold")

    seen = (one for snapshot in snapshots() for one in (snapshot, changed(snapshot)))
    yield situations_item(6, "chooses the nearest allowed pellet", judge, seen)
    yield rounds_item(4, policy, BARS[2])


def task_3(student: ModuleType) -> Iterator[Item]:
    """Require open pellets, and the safest place if there is none."""
    policy = new_policy(student, "Avoid")

    def judge(waiting: bool, s: Situation) -> Iterator[tuple[int, str]]:
        chosen = choose(policy, s)
        first = s.mask & (s.path_robot / CONFIG.robot.speed_mps < s.path_clyde / s.clyde_speed[:, None])
        opened = first & (s.kind == PELLET)
        gap = np.linalg.norm(s.clyde - s.robot[:, :2], axis=1)[:, None]
        safe = np.where(first & (s.kind != PELLET), np.where(s.kind == HOLD, gap, s.path_clyde), -np.inf)
        right = safe >= safe.max(axis=1)[:, None] - KEEP_M if waiting else opened
        for game, text in mistakes(s, chosen, right, "the safest place" if waiting else "an open pellet"):
            if opened[game].any() != waiting:
                yield game, text

    yield situations_item(3, "chooses an open pellet if there is one", lambda s: judge(False, s), snapshots())
    late = (changed(snapshot, late=True) for snapshot in snapshots())
    yield situations_item(2, "waits in the safest place if there is none", lambda s: judge(True, s), late)
    yield rounds_item(5, policy, BARS[3])


def task_4(student: ModuleType) -> Iterator[Item]:
    """Require that the way does not lead past Clyde, and more completed rounds than task 3."""
    policy = new_policy(student, "LookAhead")

    def judge(s: Situation) -> Iterator[tuple[int, str]]:
        gap = np.linalg.norm(s.clyde - s.robot[:, :2], axis=1)[:, None]
        longer = np.where(s.mask & (s.kind != HOLD), gap + s.path_clyde - s.path_robot, np.nan)
        right = ~((s.kind == PELLET) & (longer < 0.5) & (gap < 2.0) & (longer > 3.0).any(axis=1)[:, None])
        yield from mistakes(s, choose(policy, s), right, "none of the pellets behind Clyde but one of these")

    yield situations_item(4, "chooses no pellet behind Clyde", judge, snapshots())
    yield rounds_item(6, policy, BARS[4])


def task_5(student: ModuleType) -> Iterator[Item]:
    """Train, and play rounds with allowed actions."""
    began = time.process_time()
    model = of_student(student, "train")()
    used_s = time.process_time() - began
    late = "" if used_s <= TRAIN_S else f"expected at most {TRAIN_S:.0f} s of processor time, got {used_s:.0f} s"
    yield Item(3, f"trains within {TRAIN_S:.0f} s of processor time", late)

    def act(observation: Any, masks: NDArray[np.bool_]) -> NDArray[np.int64]:
        actions = np.asarray(model.predict(observation, action_masks=masks, deterministic=True)[0])
        if actions.shape != (len(masks),) or actions.dtype.kind not in "iu":
            raise Missed(f"expected {len(masks)} integers of predict, got {actions.dtype} of shape {actions.shape}")
        for game, action in enumerate(actions.tolist()):
            if not (0 <= action < masks.shape[1] and masks[game, action]):
                raise Missed(f"expected an action of {np.flatnonzero(masks[game]).tolist()}, got {action}, game {game}")
        return actions

    with loaded(FOLDER.parent / "examples" / "clients" / "evaluate.py") as evaluate:
        complete = evaluate.completed(act, MAP, TRAINED_ROUNDS, seed=0)
    which = [f"seed {seed}" for seed in range(TRAINED_ROUNDS)]
    yield Item(7, f"completes {BARS[5]:.0f} % of {TRAINED_ROUNDS} rounds", share(complete, BARS[5], which))


def task_6(student: ModuleType, draw: int = 0) -> Iterator[Item]:
    """Compare with the scorer in the same rounds."""
    policy = new_policy(student, "Best")
    seeds = np.random.default_rng(draw).choice(SEEDS_TO_DRAW, ROUNDS, replace=False)
    ours, theirs = (played(one, seeds)["end"] == COMPLETE for one in (policy, "clyde_aware"))
    more, (low, high) = paired_difference(ours, theirs)
    only_theirs = seeds[theirs & ~ours][:3].tolist()
    found = f"got {100 * ours.mean():.1f} % and clyde_aware {100 * theirs.mean():.1f} % of {ROUNDS} rounds (draw {draw})"
    found += f", difference {100 * more:+.1f} [{100 * low:+.1f}, {100 * high:+.1f}]; lost by yours alone: {only_theirs}"
    yield Item(6, "completes more rounds than clyde_aware", "" if more > 0 else f"expected more rounds, {found}")
    yield Item(4, "the 95 % interval is above 0", "" if low > 0 else f"expected a lower limit above 0, {found}")


TASKS: dict[int, tuple[str, Callable[[ModuleType], Iterator[Item]]]] = {
    1: ("read a situation", task_1),
    2: ("nearest", task_2),
    3: ("avoid", task_3),
    4: ("look ahead", task_4),
    5: ("train", task_5),
    6: ("beat the scorer", task_6),
}


@contextlib.contextmanager
def loaded(path: Path) -> Iterator[ModuleType]:
    """Import a file under a name of its own, which is forgotten after the block."""
    name = f"exercise_file_{path.stem}"
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None
    assert spec.loader is not None
    module = sys.modules[name] = importlib.util.module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
        yield module
    finally:
        del sys.modules[name]


def explain(error: BaseException, path: Path) -> str:
    """Return what went wrong in the student's file, with the last line of the file that was reached."""
    if isinstance(error, PolicyError) and error.__cause__ is not None:
        error = error.__cause__
    if isinstance(error, NotImplementedError):
        return "not written yet"
    if isinstance(error, Missed):
        return str(error)
    lines = [(call.lineno, call.line) for call in traceback.extract_tb(error.__traceback__) if call.filename == str(path)]
    if isinstance(error, SyntaxError) and error.filename == str(path):
        lines, error = [(error.lineno, error.text)], SyntaxError(error.msg)
    text = f"{type(error).__name__}: {error}"
    return text + (f"\n{' ' * 10}{path.name}, line {lines[-1][0]}: {(lines[-1][1] or '').strip()}" if lines else "")


def grade(number: int, student: ModuleType, path: Path, draw: int) -> int:
    """Print the items of a task and return its points."""
    title, task = TASKS[number]
    print(f"Task {number}: {title}", flush=True)
    began, reached, seen = time.monotonic(), 0, 0
    try:
        for item in task_6(student, draw) if number == 6 else task(student):
            seen += item.points
            reached += 0 if item.complaint else item.points
            print(f"  {0 if item.complaint else item.points} of {item.points:2}  {item.what}", flush=True)
            if item.complaint:
                print(f"{' ' * 10}{item.complaint}", flush=True)
    except (Exception, SystemExit) as error:  # of the student's code
        print(f"  0 of {TOTAL - seen:2}  {explain(error, path)}", flush=True)
    print(f"  {reached} of {TOTAL} points, {time.monotonic() - began:.0f} s\n", flush=True)
    return reached


def main(argv: Sequence[str] | None = None) -> int:
    """Grade a file and return the exit status."""
    parser = argparse.ArgumentParser(description="Grade the exercises of docs/exercises/README.md.")
    parser.add_argument("--task", type=int, choices=sorted(TASKS), help="one task (all)")
    parser.add_argument("--file", type=Path, default=FOLDER / "tasks.py", help="the student's file (%(default)s)")
    parser.add_argument("--draw", type=int, default=0, metavar="N", help="other seeds for task 6, at least 0 (0)")
    given = parser.parse_args(argv)
    path = given.file.resolve()
    if not path.is_file() or path.suffix != ".py":
        parser.error(f"--file {given.file}: must be an existing .py file")
    if given.draw < 0:
        parser.error(f"--draw {given.draw}: must be at least 0")
    numbers = sorted(TASKS) if given.task is None else [given.task]
    reached = 0
    try:
        with loaded(path) as student:
            reached = sum(grade(number, student, path, given.draw) for number in numbers)
    except (Exception, SystemExit) as error:  # of the student's file while it is imported
        print(f"{path.name} cannot be imported: {explain(error, path)}")
    print(f"Total: {reached} of {TOTAL * len(numbers)} points")
    return 0 if reached == TOTAL * len(numbers) else 1


if __name__ == "__main__":
    sys.exit(main())
