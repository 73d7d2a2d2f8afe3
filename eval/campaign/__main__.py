"""Randomised games of the robot's nodes with everything going wrong: ``pacman-env campaign --games 200``.

The nodes that ``pacman-env ros up --sim`` starts run as processes; a recorder beside them makes the simulated robot's
faults begin and end, interferes from outside, and judges each game (``verdict``). What happens in a game is
drawn from its seed (``schedule``); when exactly the processes hear of it is the machine's business, so a game
that is repeated with ``--only`` need not go the same way. Needs ROS.

A game hangs when nothing has been wrong for two minutes, no fault and no show, and there is no progress: neither
another state, nor a pellet, nor half a metre of motion, unless the planner waits for a Clyde who stands. One that is
not over 600 s after its last fault is broken off with ``game/reset``, which must lead to the menu.
"""

from __future__ import annotations

import argparse
import math
import multiprocessing
import shutil
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from pacman_env.cli.command import Parser, finite_number, run_command, whole_number
from pacman_env.config import make_config
from pacman_env.files import prepare, write_json
from pacman_env.game.pellets import generate_pellets
from pacman_env.ros.simulated_robot.sim_faults import FAULTS
from pacman_env.ros.supervisor.processes import Lost

from .schedule import GAMES_PER_SYSTEM, INTERFERENCES, Schedule, Step, ground_of, part_of_map, schedule
from .system import System, confine, first_domain, require_ros
from .verdict import Evidence, outcome, violations

VIOLATED = 1  # exit status
LIMIT_S = 600.0  # of the robot's time after the last fault: longer games are broken off
STILL_S = 120.0  # of the robot's time without any progress while nothing is wrong: the game hangs
MOTION_M = 0.5  # is progress (Nav2's own measure); a Clyde that moves less in STILL_S stands
HOLD = -1  # pursued, in the goal selector's diagnostics
SETTLE_S = 8.0  # of the robot's time, in the menu after a game: more than what may cross, for late motion to be seen
ANSWER_WALL_S = 20.0
SILENT_WALL_S = 20.0
REST_S = 20.0  # of the robot's time, for the last goal to end in the menu
OUTCOMES = ("complete", "lost", "reset", "home failed", "never")


@dataclass
class Verdict:
    """The result of one game."""

    seed: int
    ground: str
    policy: str
    happened: list[str] = field(default_factory=list)  # kinds of faults and interferences
    outcome: str = "never"
    robot_s: float = 0.0
    wall_s: float = 0.0
    lag_s: float = 0.0  # wall time that a process had to wait for a core at most
    violations: list[str] = field(default_factory=list)

    def line(self) -> str:
        """One row."""
        faults = [kind for kind in self.happened if kind in FAULTS]
        return (
            f"{self.seed:5d} {self.ground:14} {self.policy:11} {self.outcome:11} {self.robot_s:6.0f} {self.wall_s:5.0f}"
            f" {self.lag_s:5.2f} {', '.join(faults) or '-'}; {len(self.happened) - len(faults)} interferences"
        )


def verdict_on(plan: Schedule) -> Verdict:
    """That of a game that is yet to be played."""
    name, within_m = ground_of(plan.seed)
    return Verdict(plan.seed, name if math.isinf(within_m) else f"{name}, {within_m:g} m", plan.policy)


def waits(state: str | None, condition: Mapping[str, Any], plan: Schedule) -> bool:
    """Whether the planner holds on purpose: a Clyde who stands on the last pellet lets nobody collect it."""
    return state == "running" and condition.get("pursued") == HOLD and plan.clyde_speed_mps * STILL_S < MOTION_M


class Played:
    """One game, from the menu to the menu."""

    def __init__(self, system: System, pellets: frozenset[int], plan: Schedule) -> None:
        self._system, self._recorder, self._plan = system, system.recorder, plan
        self._waiting = list(plan.steps)
        self._ends: dict[str, tuple[float, float]] = {}  # faults that are active: when each began and ends
        self._quiet_s = 0.0  # since when no fault has been active
        self._answers: list[Any] = []
        self.evidence = Evidence(pellets, plan.clyde_speed_mps)
        self.verdict = verdict_on(plan)

    def play(self) -> Verdict:
        """The verdict."""
        self._recorder.forget()
        self._lateness = self._system.lateness()
        found = self.verdict.violations
        try:
            found += self._game()
        except Silent as silent:
            found.append(str(silent))
        e = self.evidence
        e.records, e.track, e.lags = self._recorder.records, self._recorder.track, self._lateness.lags
        e.troubles += list(self._ends.values())
        found += violations(e) + self._system.troubles()
        if found:
            write_json(self._system.folder / f"evidence-{self._plan.seed}.json", asdict(e))
        self.verdict.outcome = outcome(e)
        self.verdict.robot_s = self._recorder.time_s - e.time_s(e.started)
        self.verdict.wall_s = (time.time_ns() - e.started) * 1e-9
        self.verdict.lag_s = max((lag_s for _, lag_s in e.lags), default=0.0)
        return self.verdict

    def _game(self) -> list[str]:
        """Play; what was seen to be wrong at once."""
        recorder, plan = self._recorder, self._plan
        found = self._prepare()
        menu_s = recorder.time_s
        self._spin(lambda: recorder.time_s - menu_s >= plan.menu_s and not self._open("menu"))
        self._spin(lambda: all(answer.done() for answer in self._answers))
        self.evidence.started = time.time_ns()
        answer = recorder.start()
        self._spin(answer.done)
        if not answer.result().success:
            return [*found, f"game/start was refused in the menu: {answer.result().message}"]
        self._spin(lambda: recorder.state != "menu")
        self._quiet_s = recorder.time_s
        found += self._until_menu()
        menu_s = recorder.time_s
        self._spin(lambda: recorder.time_s - menu_s >= SETTLE_S, happen=False)
        recorder.fault("end")
        self._spin(lambda: recorder.faults == [], happen=False)
        calm_s = recorder.time_s
        self._spin(lambda: recorder.resting or recorder.time_s - calm_s >= REST_S, happen=False)
        if not recorder.resting:
            found.append(f"a goal is pursued in the menu, {REST_S:g} s after the last fault")
        return found + [f"a late listener does not hear {name}" for name in recorder.late_listener(ANSWER_WALL_S)]

    def _prepare(self) -> list[str]:
        """Policy and Clyde's speed, in the menu."""
        recorder, found = self._recorder, []
        answer = recorder.set_policy(self._plan.policy)
        self._spin(answer.done, happen=False)
        (result,) = answer.result().results
        if not result.successful:
            found.append(f"policy {self._plan.policy} was refused in the menu: {result.reason}")
        recorder.set_base_speed(self._plan.clyde_speed_mps)
        return found

    def _until_menu(self) -> list[str]:
        """Until the game is over; a list of what kept it from that."""
        recorder = self._recorder
        mark = self._mark()
        mark_s = recorder.time_s

        def over() -> bool:
            nonlocal mark, mark_s
            if not self._same(mark, self._mark()) or self._ends:
                mark, mark_s = self._mark(), recorder.time_s
            still = recorder.time_s - mark_s >= STILL_S
            late = not self._ends and recorder.time_s - self._quiet_s >= LIMIT_S
            return recorder.state == "menu" or still or late

        self._spin(over)
        if recorder.state == "menu":
            return []
        found = []
        if recorder.time_s - mark_s >= STILL_S and not waits(recorder.state, recorder.condition, self._plan):
            found.append(f"hangs in state {recorder.state}: {recorder.condition}")
        self._reset()
        if not recorder.wait_for(lambda: recorder.state == "menu", ANSWER_WALL_S):
            found.append(f"game/reset did not lead from {recorder.state} to the menu")
        return found

    def _mark(self) -> tuple[Any, ...]:
        """The things that change where there is progress."""
        place = self._recorder.track[-1] if self._recorder.track else None
        pellets = sum(r.topic == "game/pellets_collected" for r in self._recorder.records)
        return self._recorder.state, pellets, (place.x, place.y) if place else (0.0, 0.0)

    @staticmethod
    def _same(one: tuple[Any, ...], other: tuple[Any, ...]) -> bool:
        return one[:2] == other[:2] and math.dist(one[2], other[2]) < MOTION_M

    # What happens meanwhile

    def _spin(self, until: Callable[[], Any], happen: bool = True) -> None:
        """Spin until then, and let happen what is due.

        Raises:
            Silent: that takes far too long.
        """
        recorder = self._recorder
        recorder.heard_wall_s = time.monotonic()
        while not until():
            recorder.spin_once()
            self._lateness.look()
            if time.monotonic() - recorder.heard_wall_s > SILENT_WALL_S:
                raise Silent("the simulated robot is silent")
            if happen:
                self._happen()

    def _open(self, state: str) -> bool:
        return any(step.state == state for step in self._waiting)

    def _happen(self) -> None:
        recorder, now = self._recorder, self._recorder.time_s
        for kind, (began, ends) in list(self._ends.items()):
            if now >= ends:
                recorder.fault(f"end {kind}")
                self.evidence.troubles.append((began, now))
                del self._ends[kind]
                self._quiet_s = now
        since = now - recorder.state_since_s
        due = [step for step in self._waiting if step.state == recorder.state and since >= step.after_s]
        for step in due:
            self._waiting.remove(step)
            self._do(step)

    def _do(self, step: Step) -> None:
        recorder = self._recorder
        self.verdict.happened.append(step.kind)
        if step.words:
            recorder.fault(step.words)
            self._ends[step.kind] = recorder.time_s, recorder.time_s + step.lasts_s
        elif step.kind == "reset":
            self._reset()
        elif step.kind == "start":
            self._answers.append(recorder.start())
        else:
            if "markers" in step.kind:
                self.evidence.forged_reports.append(time.time_ns())
            recorder.interfere(step.kind)

    def _reset(self) -> None:
        self.evidence.resets.append(time.time_ns())
        self._answers.append(self._recorder.reset())


class Silent(Exception):
    """Nothing is heard any more."""


def play(seeds: Sequence[int], speed: float, folder: Path, domain: int | None) -> list[Verdict]:
    """The games of some seeds, each system anew where its ground changes."""
    verdicts: list[Verdict] = []
    confine(folder, domain)
    for block in _blocks(seeds):
        ground = part_of_map(*ground_of(block[0]))
        pellets = frozenset(map(int, generate_pellets(ground, make_config("robot").pellets).ids))
        while block:
            place = folder / f"{block[0]:05d}"
            place.mkdir(parents=True, exist_ok=True)
            before = len(verdicts)
            system = System(str(ground.save(place / "ground.yaml")), block[0], speed, place)
            try:
                with system:
                    while block and not (verdicts[before:] and verdicts[-1].violations):
                        verdicts.append(Played(system, pellets, schedule(block.pop(0))).play())
                        print(verdicts[-1].line(), flush=True)
            except Lost as lost:
                verdicts.append(verdict_on(schedule(block.pop(0))))
                verdicts[-1].violations.append(str(lost))
            verdicts[-1].violations += system.said
            if verdicts[-1].violations:  # what follows from them is not looked for: another system for the rest
                print(*(f"      VIOLATION {line}" for line in verdicts[-1].violations), sep="\n", flush=True)
            else:
                shutil.rmtree(place)
    return verdicts


def _blocks(seeds: Sequence[int]) -> Iterator[list[int]]:
    """Seeds that are played by the same system."""
    for number in sorted({seed // GAMES_PER_SYSTEM for seed in seeds}):
        yield [seed for seed in seeds if seed // GAMES_PER_SYSTEM == number]


def table(verdicts: Sequence[Verdict]) -> list[str]:
    """Games by fault kind, as lines."""
    head = f"{'':27} {'games':>6}" + "".join(f" {name:>11}" for name in OUTCOMES) + f" {'violations':>10}"
    rows = {"all games": list(verdicts), "nothing": [v for v in verdicts if not v.happened]}
    rows |= {kind: [v for v in verdicts if kind in v.happened] for kind in (*FAULTS, *INTERFERENCES)}
    several = [v for v in verdicts if len(set(v.happened) & FAULTS.keys()) > 1]
    rows |= {"several faults": several}
    lines = [head]
    for name, games in rows.items():
        ends = "".join(f" {sum(v.outcome == how for v in games):11d}" for how in OUTCOMES)
        lines.append(f"{name:27} {len(games):6d}{ends} {sum(len(v.violations) for v in games):10d}")
    return lines


def run(arguments: argparse.Namespace) -> int:
    """Play, tell, and write; the exit status.

    Raises:
        ValueError: no ROS, or the figures cannot be written.
    """
    require_ros()
    seeds = arguments.only or list(range(arguments.seed, arguments.seed + arguments.games))
    folder = arguments.logs or Path(tempfile.mkdtemp(prefix="campaign_"))
    began = time.monotonic()
    if arguments.json:
        prepare(arguments.json)
    head = f"{'seed':>5} {'ground':14} {'policy':11} {'outcome':11} {'robot':>6} {'wall':>5} {'lag':>5}"
    print(f"{head} faults, interferences")
    if arguments.jobs == 1:
        verdicts = play(seeds, arguments.speed, folder, arguments.domain)
    else:
        shares = [[s for b in list(_blocks(seeds))[k :: arguments.jobs] for s in b] for k in range(arguments.jobs)]
        first = arguments.domain or first_domain()
        context = multiprocessing.get_context("spawn")
        with ProcessPoolExecutor(arguments.jobs, mp_context=context) as pool:
            futures = [
                pool.submit(play, share, arguments.speed, folder, first + k) for k, share in enumerate(shares) if share
            ]
            verdicts = sorted((v for future in futures for v in future.result()), key=lambda v: v.seed)
    print(*table(verdicts), sep="\n")
    wrong = [v for v in verdicts if v.violations]
    for verdict in wrong:
        print(*(f"seed {verdict.seed}: {line}" for line in verdict.violations), sep="\n")
        print(f"repeat: pacman-env campaign --only {verdict.seed}")
    print(f"{len(verdicts)} games in {time.monotonic() - began:.0f} s, {len(wrong)} with violations")
    if wrong:
        print(f"logs: {folder}")
    elif not arguments.logs:
        shutil.rmtree(folder)
    if arguments.json:
        write_json(arguments.json, {"seeds": seeds, "speed": arguments.speed, "games": [asdict(v) for v in verdicts]})
    return VIOLATED if wrong else 0


def main(argv: Sequence[str] | None = None) -> int:
    """Play; returns the exit status: 1 after violations."""
    parser = Parser(prog="pacman-env campaign", description=__doc__)
    parser.add_argument("--games", type=whole_number(1), default=200, metavar="N")
    parser.add_argument("--seed", type=whole_number(0), default=0, metavar="S", help="of the first game")
    parser.add_argument("--only", type=whole_number(0), nargs="+", metavar="SEED", help="just these")
    parser.add_argument(
        "--speed", type=finite_number(1, 10), default=10.0, metavar="X", help="of the simulated clock, 1 to 10"
    )
    parser.add_argument(
        "--jobs", type=whole_number(1), default=1, metavar="N", help="systems at once, about a core each"
    )
    parser.add_argument("--domain", type=whole_number(0, 101), metavar="ID", help="ROS_DOMAIN_ID, of the first system")
    parser.add_argument("--logs", type=Path, metavar="FOLDER", help="kept there; else only after violations")
    parser.add_argument("--json", type=Path, metavar="OUT", help="write the verdicts")
    return run_command(parser, argv, run, "ros")


if __name__ == "__main__":
    sys.exit(main())
