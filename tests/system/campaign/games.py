"""Games that are played and judged, one after another by the same nodes; the campaign is made of them."""

from __future__ import annotations

import math
import shutil
from collections.abc import Callable, Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

from pacman_env.config import make_config
from pacman_env.files import write_json
from pacman_env.game.pellets import generate_pellets
from pacman_env.ros.lock_step.deliveries import NodeFailed
from pacman_env.ros.lock_step.transcript import Transcript
from pacman_env.ros.supervisor.game_nodes import SIMULATOR
from tests.system.campaign.outages import Outages
from tests.system.campaign.recorded_game import RecordedGame
from tests.system.campaign.results import Verdict, verdict_on
from tests.system.campaign.schedule import (
    GAMES_PER_SYSTEM,
    KILL,
    LOSS,
    OUTAGES,
    Schedule,
    Step,
    arena_of,
    part_of_map,
    schedule,
)
from tests.system.campaign.verdict import STILL_S, Evidence, outcome, violations, waits
from tests.system.campaign.workers import errors, logged

LIMIT_S = 600.0  # of the robot's time after the last fault: longer games are broken off
MOTION_M = 0.5  # is progress (Nav2's own measure)
SETTLE_S = 8.0  # of the robot's time, in the menu after a game, for late motion to be seen
REST_S = 20.0  # of the robot's time, for the last goal to end in the menu
# Of the simulated wall clock:
AGAIN_S = 2.0  # what has not been answered by then is asked again, as an operator would
ANSWER_S = 5.0
SILENT_S = 1.0  # between two messages of the odometry
BACK_S = 60.0  # for all nodes to be back, and to have found one another


class Played:
    """One game, from the menu to the menu."""

    def __init__(self, game: RecordedGame, pellets: frozenset[int], plan: Schedule, folder: Path) -> None:
        self._game, self._recorder, self._plan, self._folder = game, game.recorder, plan, folder
        self._waiting = list(plan.steps)
        self._ends: dict[str, tuple[float, float]] = {}  # faults that are active: when each began and ends
        self._quiet_s = 0.0  # since when no fault has been active
        self._unanswered: tuple[Any, float] | None = None  # a reset, and when it was asked for
        self._outages = Outages(game)
        self.evidence = Evidence(pellets, plan.clyde_speed_mps)
        self.verdict = verdict_on(plan)

    def play(self) -> Verdict:
        self._recorder.forget()
        transcript = Transcript(self._game)
        began_s = self._game.wall.now_s
        found = self.verdict.violations
        try:
            found += self._play()
        except (Silent, NodeFailed) as failure:
            found.append(str(failure))
        finally:
            self._outages.end_all()
            transcript.end()
        e = self.evidence
        e.outages = self._outages.over
        e.records, e.track = self._recorder.records, self._recorder.track
        e.troubles += list(self._ends.values())
        found += violations(e)
        if found:
            write_json(self._folder / f"evidence-{self._plan.seed}.json", asdict(e))
        verdict = self.verdict
        verdict.outcome = outcome(e)
        verdict.robot_s = round(self._recorder.time_s - e.time_s(e.started), 3)
        verdict.simulated_s = round(self._game.wall.now_s - began_s, 3)
        verdict.messages, verdict.transcript = transcript.messages, transcript.hexdigest()
        return verdict

    def _play(self) -> list[str]:
        """Play; what was seen to be wrong at once."""
        recorder, plan = self._recorder, self._plan
        found = self._prepare()
        menu_s = recorder.time_s
        self._spin(lambda: recorder.time_s - menu_s >= plan.menu_s and not self._open("menu"))
        self._spin(lambda: self._unanswered is None)
        self.evidence.started = recorder.instant()
        found += self._start()
        if found:
            return found
        self._quiet_s = recorder.time_s
        found += self._until_menu()
        found += self._all_back()
        menu_s = recorder.time_s
        self._spin(lambda: recorder.time_s - menu_s >= SETTLE_S, happen=False)
        self._game.do(lambda: recorder.fault("end"))
        self._wait(lambda: recorder.faults == [], ANSWER_S)
        calm_s = recorder.time_s
        self._spin(lambda: recorder.resting or recorder.time_s - calm_s >= REST_S, happen=False)
        pellets = len(self.evidence.own_pellets)
        self._wait(lambda: recorder.last("game/pellets_spawned") == pellets, ANSWER_S)
        if not recorder.resting:
            found.append(f"a goal is pursued in the menu, {REST_S:g} s after the last fault")
        return found + [f"a late listener does not receive {name}" for name in self._game.missed_by_a_late_listener()]

    def _prepare(self) -> list[str]:
        """Policy and Clyde's speed, in the menu."""
        recorder, found = self._recorder, []
        answer = self._game.do(lambda: recorder.set_policy(self._plan.policy))
        self._wait(answer.done, ANSWER_S)
        if not answer.done():
            return ["the goal selector does not answer in the menu"]
        (result,) = answer.result().results
        if not result.successful:
            found.append(f"policy {self._plan.policy} was refused in the menu: {result.reason}")
        self._game.do(lambda: recorder.set_base_speed(self._plan.clyde_speed_mps))
        return found

    def _start(self) -> list[str]:
        """Ask for the game until it begins: requests and answers may be lost."""
        recorder = self._recorder
        for asked in range(round(BACK_S / AGAIN_S)):
            answer = self._game.do(recorder.start)
            self._wait(partial(self._begun, answer), AGAIN_S)
            if answer.done() and not (answer.result().success or asked):
                return [f"game/start was refused in the menu: {answer.result().message}"]
            if self._begun(answer):
                self._wait(lambda: recorder.left_menu(self.evidence.started), ANSWER_S)
                return []
        return ["game/start was never answered"]

    def _begun(self, answer: Any) -> bool:
        """Whether there is an answer, or it was lost and the game has begun."""
        return bool(answer.done()) or self._recorder.left_menu(self.evidence.started)

    def _all_back(self) -> list[str]:
        """Wait for every node that is away."""
        self._wait(lambda: not self._outages, BACK_S)
        found = [f"{one.node} did not come back after: {one.kind}" for one in self._outages.now]
        if not self._outages.over:
            return found
        self._wait(lambda: False, AGAIN_S)  # what is recorded of a node that has just been started may be from before
        self._wait(lambda: self._recorder.ready() and self._unanswered is None, BACK_S)
        if not self._recorder.ready():
            found.append(f"the nodes do not find one another again: {self._recorder.condition}")
        return found

    def _wait(self, until: Callable[[], Any], for_s: float) -> None:
        """Step until then, or for so long; nothing more happens."""
        end_s = self._game.wall.now_s + for_s
        self._spin(lambda: until() or self._game.wall.now_s >= end_s, happen=False)

    def _until_menu(self) -> list[str]:
        """Until the game is over; a list of what kept it from that."""
        recorder = self._recorder
        mark = self._mark()
        mark_s = waited_s = recorder.time_s  # since when there is no progress, and until when the planner waited
        clyde, moved_m = recorder.clyde(), 0.0  # its place then, and how far from it it has been since

        def over() -> bool:
            nonlocal mark, mark_s, waited_s, clyde, moved_m
            if not self._same(mark, self._mark()) or self._ends or self._outages:
                mark, mark_s, clyde, moved_m = self._mark(), recorder.time_s, recorder.clyde(), 0.0
            moved_m = max(moved_m, math.dist(clyde, recorder.clyde()))
            if waits(recorder.state, recorder.condition, moved_m):
                waited_s = recorder.time_s
            still = recorder.time_s - mark_s >= STILL_S
            late = not (self._ends or self._outages) and recorder.time_s - self._quiet_s >= LIMIT_S
            return recorder.state == "menu" or still or late

        self._spin(over)
        if recorder.state == "menu":
            return []
        found = []
        if recorder.time_s - max(mark_s, waited_s) >= STILL_S:
            found.append(f"hangs in state {recorder.state}: {recorder.condition}")
        self._reset()
        self._wait(lambda: recorder.state == "menu", ANSWER_S)
        if recorder.state != "menu":
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
        """Step until then, and let happen what is due.

        Raises:
            Silent: the simulated robot is.
        """
        silent_s = self._game.wall.now_s
        while not until():
            self._game.step()
            self._tend()
            if self._outages.away(SIMULATOR):
                silent_s = self._game.wall.now_s
            if self._game.wall.now_s - max(silent_s, self._recorder.odometry_s) > SILENT_S:
                raise Silent("the simulated robot is silent")
            if happen:
                self._happen()

    def _tend(self) -> None:
        """The nodes, those that are away, and a reset that was not answered."""
        now_s = self._game.wall.now_s
        self.verdict.violations += self._game.tend()
        self._game.do(self._recorder.accept_pose)
        if self._outages:
            self._outages.tend()
            self._quiet_s = self._recorder.time_s
        if self._unanswered is not None:
            answer, asked_s = self._unanswered
            if answer.done():
                self._unanswered = None
            elif now_s - asked_s > AGAIN_S:
                self._reset()

    def _open(self, state: str) -> bool:
        return any(step.state == state for step in self._waiting)

    def _happen(self) -> None:
        recorder, now = self._recorder, self._recorder.time_s
        for kind, (began, ends) in list(self._ends.items()):
            if now >= ends:
                self._game.do(partial(recorder.fault, f"end {kind}"))
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
            if not self._outages.begin(step):
                return
            lasts = "" if step.kind == KILL else f"{step.lasts_s:.0f} s "
            share = f"{step.percent} % " if step.kind == LOSS else ""
            self.verdict.outages.append((step.kind, step.node, f"{lasts}{share}({step.state})"))
        self.verdict.happened.append(step.kind)
        if step.kind in OUTAGES:
            pass
        elif step.words:
            self._game.do(lambda: recorder.fault(step.words))
            self._ends[step.kind] = recorder.time_s, recorder.time_s + step.lasts_s
        elif step.kind == "reset":
            self._reset()
        elif step.kind == "start":
            self._game.do(recorder.start)
        else:
            if "markers" in step.kind:
                self.evidence.forged_reports.append(recorder.instant())
            self._game.do(lambda: recorder.interfere(step.kind))

    def _reset(self) -> None:
        self.evidence.resets.append(self._recorder.instant())
        self._unanswered = self._game.do(self._recorder.reset), self._game.wall.now_s


class Silent(Exception):
    """No message arrives any more."""


def play(seeds: Sequence[int], folder: Path) -> list[Verdict]:
    """The games of some seeds of one block, as they follow those before them in it.

    After a game with violations the rest of the block is played by other nodes, for what follows from them is not
    looked for.
    """
    block = list(range(seeds[0] - seeds[0] % GAMES_PER_SYSTEM, seeds[-1] + 1))
    place = folder / f"{block[0]:05d}"
    place.mkdir(parents=True, exist_ok=True)
    arena = part_of_map(*arena_of(block[0]))
    pellets = frozenset(map(int, generate_pellets(arena, make_config("robot").pellets).ids))
    map_yaml = str(arena.save(place / "arena.yaml"))
    verdicts: list[Verdict] = []
    while block:
        log = place / f"nodes-{block[0]}.log"
        with logged(log):
            verdicts += _played(block, map_yaml, pellets, place)
        verdicts[-1].violations += errors(log.read_text(errors="replace"))
    if not any(verdict.violations for verdict in verdicts):
        shutil.rmtree(place)
    return [verdict for verdict in verdicts if verdict.seed in seeds]


def _played(block: list[int], map_yaml: str, pellets: frozenset[int], place: Path) -> list[Verdict]:
    """The games of the first seeds of a block, which are taken from it: until one has violations."""
    verdicts: list[Verdict] = []
    (place / "game_controller.json").unlink(missing_ok=True)
    try:
        with RecordedGame(map_yaml, block[0], place) as game:
            while block and not (verdicts and verdicts[-1].violations):
                verdicts.append(Played(game, pellets, schedule(block.pop(0)), place).play())
    except NodeFailed as failed:
        if not verdicts:
            verdicts.append(verdict_on(schedule(block.pop(0))))
        verdicts[-1].violations.append(str(failed))
    return verdicts
