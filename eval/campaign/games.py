"""Games that are played and judged, one after another by the same processes; the campaign is made of them."""

from __future__ import annotations

import math
import os
import shutil
import time
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

from pacman_env.config import make_config
from pacman_env.files import write_json
from pacman_env.game.pellets import generate_pellets
from pacman_env.ros.simulated_robot.sim_faults import FAULTS
from pacman_env.ros.standstill import LEASE
from pacman_env.ros.supervisor.game_nodes import SELECTOR, SIMULATOR
from pacman_env.ros.supervisor.processes import Lost

from . import network
from .outages import Outages
from .schedule import (
    GAMES_PER_SYSTEM,
    INTERFERENCES,
    KILL,
    LEASE_S,
    LOSS,
    OUTAGES,
    Schedule,
    Step,
    ground_of,
    part_of_map,
    schedule,
)
from .system import System, confine, write_middleware_profile
from .verdict import Evidence, outcome, violations

LIMIT_S = 600.0  # of the robot's time after the last fault: longer games are broken off
STILL_S = 120.0  # of the robot's time without any progress while nothing is wrong: the game hangs
MOTION_M = 0.5  # is progress (Nav2's own measure)
AROUND_M = 2.0  # a Clyde that moves less in STILL_S may stay where he is in the way, in these small grounds
HOLD = -1  # pursued, in the goal selector's diagnostics
SETTLE_S = 8.0  # of the robot's time, in the menu after a game: more than what may cross, for late motion to be seen
ANSWER_WALL_S = 20.0
AGAIN_WALL_S = 2.0  # what has not been answered by then is asked again, as an operator would
SILENT_WALL_S = 20.0
BACK_WALL_S = 120.0  # for a node that was killed to be back, on a busy machine
TEND_WALL_S = 0.1
REST_S = 20.0  # of the robot's time, for the last goal to end in the menu
NETWORK = "network"


@dataclass
class Verdict:
    """The result of one game."""

    seed: int
    ground: str
    policy: str
    happened: list[str] = field(default_factory=list)  # kinds of faults, interferences and outages
    outcome: str = "never"
    robot_s: float = 0.0
    wall_s: float = 0.0
    lag_s: float = 0.0  # wall time that a process had to wait for a core at most
    violations: list[str] = field(default_factory=list)
    outages: list[tuple[str, str, str]] = field(default_factory=list)  # kind, node and how long in which state

    def line(self) -> str:
        """One row."""
        faults = [kind for kind in self.happened if kind in FAULTS]
        faults += [" ".join(one) for one in self.outages]
        others = sum(kind in INTERFERENCES for kind in self.happened)
        return (
            f"{self.seed:5d} {self.ground:14} {self.policy:11} {self.outcome:11} {self.robot_s:6.0f} {self.wall_s:5.0f}"
            f" {self.lag_s:5.2f} {', '.join(faults) or '-'}; {others} interferences"
        )


def verdict_on(plan: Schedule) -> Verdict:
    """That of a game that is yet to be played."""
    name, within_m = ground_of(plan.seed)
    return Verdict(plan.seed, name if math.isinf(within_m) else f"{name}, {within_m:g} m", plan.policy)


def waits(state: str | None, condition: Mapping[str, Any], plan: Schedule) -> bool:
    """Whether the planner holds on purpose: a Clyde who stays at the last pellets lets nobody collect them."""
    return state == "running" and condition.get("pursued") == HOLD and plan.clyde_speed_mps * STILL_S < AROUND_M


class Played:
    """One game, from the menu to the menu."""

    def __init__(self, system: System, pellets: frozenset[int], plan: Schedule) -> None:
        self._system, self._recorder, self._plan = system, system.recorder, plan
        self._waiting = list(plan.steps)
        self._ends: dict[str, tuple[float, float]] = {}  # faults that are active: when each began and ends
        self._quiet_s = 0.0  # since when no fault has been active
        self._unanswered: tuple[Any, float] | None = None  # a reset, and when it was asked for
        self._outages = Outages(system.ids, lambda: self._recorder.processes, system.speed)
        self._tended_s = 0.0
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
        finally:
            self._outages.end_all()
        e = self.evidence
        e.outages = self._outages.over
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
        self._spin(lambda: self._unanswered is None)
        self.evidence.started = time.time_ns()
        found += self._start()
        if found:
            return found
        self._quiet_s = recorder.time_s
        found += self._until_menu()
        found += self._all_back()
        menu_s = recorder.time_s
        self._spin(lambda: recorder.time_s - menu_s >= SETTLE_S, happen=False)
        recorder.fault("end")
        self._spin(lambda: recorder.faults == [], happen=False)
        calm_s = recorder.time_s
        self._spin(lambda: recorder.resting or recorder.time_s - calm_s >= REST_S, happen=False)
        pellets = len(self.evidence.own_pellets)
        self._wait(lambda: recorder.spawned == pellets, ANSWER_WALL_S)
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

    def _start(self) -> list[str]:
        """Ask for the game until it begins: requests and answers may be lost."""
        recorder = self._recorder
        for asked in range(round(BACK_WALL_S / AGAIN_WALL_S)):
            answer = recorder.start()
            begun = partial(self._begun, answer)
            self._wait(begun, AGAIN_WALL_S)
            recorder.spin_once()  # all that has come while this process was late
            if answer.done() and not (answer.result().success or asked):
                return [f"game/start was refused in the menu: {answer.result().message}"]
            if begun():
                self._spin(lambda: recorder.left_menu(self.evidence.started))
                return []
        return ["game/start was never answered"]

    def _begun(self, answer: Any) -> bool:
        """Whether there is an answer, or the game has gone on: a recorder that is late may see that afterwards only."""
        return bool(answer.done()) or self._recorder.left_menu(self.evidence.started)

    def _all_back(self) -> list[str]:
        """Wait for everybody who is away."""
        self._wait(lambda: not self._outages, BACK_WALL_S)
        found = [f"{one.node} did not come back after: {one.kind}" for one in self._outages.now]
        if not self._outages.over:
            return found
        for _ in range(2):  # what is heard of a node that has just been found again may be from before
            self._wait(lambda: False, AGAIN_WALL_S)
            self._wait(lambda: self._recorder.ready() and self._unanswered is None, BACK_WALL_S)
        if not self._recorder.ready():
            found.append(f"the nodes do not find one another again: {self._recorder.condition}")
        return found

    def _wait(self, until: Callable[[], Any], wall_s: float) -> None:
        """Spin until then, or for so long; nothing more happens."""
        end_s = time.monotonic() + wall_s
        self._spin(lambda: until() or time.monotonic() > end_s, happen=False)

    def _until_menu(self) -> list[str]:
        """Until the game is over; a list of what kept it from that."""
        recorder = self._recorder
        mark = self._mark()
        mark_s = recorder.time_s

        def over() -> bool:
            nonlocal mark, mark_s
            if not self._same(mark, self._mark()) or self._ends or self._outages:
                mark, mark_s = self._mark(), recorder.time_s
            still = recorder.time_s - mark_s >= STILL_S
            late = not (self._ends or self._outages) and recorder.time_s - self._quiet_s >= LIMIT_S
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
            self._tend()
            if time.monotonic() - recorder.heard_wall_s > SILENT_WALL_S:
                raise Silent("the simulated robot is silent")
            if happen:
                self._happen()

    def _tend(self) -> None:
        """The processes, those who are away, and a reset that nobody has answered."""
        now_s, recorder = time.monotonic(), self._recorder
        if now_s - self._tended_s < TEND_WALL_S:
            return
        self._tended_s = now_s
        if SELECTOR in self._system.tend():
            recorder.halt()
        self._lateness.watch(self._system.ids().values())
        if self._outages:
            self._outages.tend()
            self._quiet_s = recorder.time_s
            if self._outages.away(SIMULATOR):
                recorder.heard_wall_s = now_s
        if self._unanswered is not None:
            answer, asked_s = self._unanswered
            if answer.done():
                self._unanswered = None
            elif now_s - asked_s > AGAIN_WALL_S:
                self._reset()

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
        if step.kind in OUTAGES:
            self._system.killed |= {step.node} if step.kind == KILL else set()
            if not self._outages.begin(step):
                self._system.killed.discard(step.node)
                return
            lasts = "" if step.kind == KILL else f"{step.lasts_s:.0f} s "
            share = f"{step.percent} % " if step.kind == LOSS else ""
            self.verdict.outages.append((step.kind, step.node, f"{lasts}{share}({step.state})"))
        self.verdict.happened.append(step.kind)
        if step.kind in OUTAGES:
            pass
        elif step.words:
            recorder.fault(step.words)
            self._ends[step.kind] = recorder.time_s, recorder.time_s + step.lasts_s
        elif step.kind == "reset":
            self._reset()
        elif step.kind == "start":
            recorder.start()
        else:
            began = time.time_ns()
            recorder.interfere(step.kind)
            if "markers" in step.kind:  # it leaves at some time between these
                self.evidence.forged_reports += [began, time.time_ns()]

    def _reset(self) -> None:
        self.evidence.resets.append(time.time_ns())
        self._unanswered = self._recorder.reset(), time.monotonic()


class Silent(Exception):
    """Nothing is heard any more."""


def play(
    seeds: Sequence[int], speed: float, folder: Path, domain: int | None, without: Collection[str] = ()
) -> list[Verdict]:
    """The games of some seeds, each system anew where its ground changes; in a process of their own, for it changes."""
    verdicts: list[Verdict] = []
    folder.mkdir(parents=True, exist_ok=True)
    confine(folder, domain)
    os.environ[LEASE] = str(LEASE_S / speed)
    os.environ["FASTRTPS_DEFAULT_PROFILES_FILE"] = str(write_middleware_profile(folder / "middleware.xml", speed))
    if NETWORK not in without:
        network.enter_own_network()
        os.environ["FASTDDS_BUILTIN_TRANSPORTS"] = "UDPv4"
    for block in blocks(seeds):
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
                        verdicts.append(Played(system, pellets, planned(block.pop(0), without)).play())
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


def planned(seed: int, without: Collection[str]) -> Schedule:
    """The game of a seed, without some kinds."""
    plan = schedule(seed)
    left_out = {LOSS} if NETWORK in without else set()
    return replace(plan, steps=tuple(step for step in plan.steps if step.kind not in left_out))


def blocks(seeds: Sequence[int]) -> Iterator[list[int]]:
    """Seeds that are played by the same system."""
    for number in sorted({seed // GAMES_PER_SYSTEM for seed in seeds}):
        yield [seed for seed in seeds if seed // GAMES_PER_SYSTEM == number]
