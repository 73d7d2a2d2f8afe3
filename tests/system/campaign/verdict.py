"""The verdict on one recorded game of the robot's nodes: everything in it that violates a promise.

Plain values in, lines about violations out: recording is ``recorder``'s business. Instants are ns of the simulated wall
clock, in the order of publication, so that no two are equal; durations are of the robot's time, which no jump of the
clock touches. Nothing is late in lock-step, so nothing may be.

Nodes that were frozen, killed or off the network answer late. So what may be late is not judged from the beginning of
such an outage of a node that it is about until ``RECOVERY_S`` after its end. What the score, the counters and the
result are at the end is judged as in every other game.
"""

from __future__ import annotations

import bisect
import itertools
import math
import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from pacman_env.config import RobotConfig, ShowConfig
from pacman_env.ros.supervisor.game_nodes import REFEREE, SELECTOR, SIMULATOR
from tests.system.campaign.schedule import EVERY_NODE

DRIVING = frozenset({"running", "returning_home"})
SHOWS = {"starting": ShowConfig.start_s, "dying": ShowConfig.death_s}
#: Where each state leads by itself; a reset leads to the menu from everywhere.
NEXT = {
    "menu": {"returning_home"},
    "returning_home": {"starting", "menu"},
    "starting": {"running"},
    "running": {"complete", "dying"},
    "complete": {"returning_home"},
    "dying": {"returning_home"},
}
#: s of the robot's time: a tick of the referee, one more that a jump of the clock costs, and a step; rounded up.
TICK_S = 0.15 + 1e-6
#: s of the simulated wall clock after an outage: what was lost is sent again (after 3 s, the middleware's heartbeat),
#: services are called again (after 2 s), and reports that were not answered are made again (every 2 s).
RECOVERY_S = 5.0
STILL_S = 120.0  # of the robot's time without any progress while nothing is wrong: the game hangs
AROUND_M = 2.0  # a Clyde that is never farther from its place is in the way there, in these small grounds
HOLD = -1  # pursued, in the goal selector's diagnostics
REPORT_S = 1.0  # of the robot's time: between two reports of the pellets
PELLET_MANAGER, EVENT_MAPPER = "pellet_manager", "game_event_mapper"
MOVERS = (SELECTOR, REFEREE, SIMULATOR)
RESET_S = 0.1  # of the simulated wall clock: a reset is obeyed at once
CANCEL_S = 1.5  # of the robot's time: a cancel that was lost is sent again after 1 s
FASTEST_MPS = RobotConfig.wheel_speed_mps
BRAKING_M = FASTEST_MPS**2 / (2 * RobotConfig.wheel_acceleration_mps2)
STANDING_M = 0.05
OUTCOMES = ("complete", "lost")
_SEEN = {"complete": "complete", "lost": "dying"}  # states
_COLLECTED = re.compile(r"pellet_collected:(\d{1,9})", re.ASCII)
ENDED = frozenset({4, 5, 6})  # action_msgs/GoalStatus


@dataclass(frozen=True)
class Record:
    """One message: when it left its publisher, ns of the simulated wall clock, its topic and its value."""

    at: int
    topic: str
    value: Any


@dataclass(frozen=True)
class Sample:
    """The robot's own time, s, and where its odometry has it, m, at an instant, ns of the simulated wall clock."""

    at: int
    time_s: float
    x: float
    y: float


@dataclass(frozen=True)
class Outage:
    """A node that was frozen, killed or off the network, and from when to when, ns of the simulated wall clock."""

    kind: str
    node: str
    begin: int
    end: int


@dataclass
class Evidence:
    """Everything that was seen of one game, from its menu to the next.

    ``records`` by topic: ``game_state``, ``game_command``, ``game_result``, ``game_status``, ``game/score``,
    ``game/round``, ``game/pellets_spawned``, ``game/pellets_collected``, ``clyde/speed``; ``turn`` (rad/s), ``sent``
    (where a goal is), ``goals`` (status by id).
    """

    own_pellets: frozenset[int]
    base_speed_mps: float
    speed_step_mps: float = 0.05
    started: int = 0  # when game/start was called, ns
    records: list[Record] = field(default_factory=list)
    track: list[Sample] = field(default_factory=list)
    resets: list[int] = field(default_factory=list)  # when game/reset was called, ns
    forged_reports: list[int] = field(default_factory=list)  # when a false report of the pellets was sent, ns
    troubles: list[tuple[float, float]] = field(default_factory=list)  # robot's time in which faults were active
    outages: list[Outage] = field(default_factory=list)

    def of(self, topic: str) -> list[Record]:
        return sorted((r for r in self.records if r.topic == topic), key=lambda r: r.at)

    def last(self, topic: str, before: float = math.inf) -> Any:
        """The last value of a topic until an instant; None: none."""
        return next((r.value for r in reversed(self.of(topic)) if r.at <= before), None)

    @property
    def score(self) -> int:
        """The score at the beginning of the game."""
        return int(self.last("game/score", self.started) or 0)

    @property
    def round(self) -> int:
        """The number of the round at the beginning of the game."""
        return int(self.last("game/round", self.started) or 1)

    def time_s(self, at: int) -> float:
        """The robot's time at an instant; of the last sample before it."""
        index = bisect.bisect_right(self.track, at, key=lambda s: s.at) - 1
        return self.track[max(index, 0)].time_s if self.track else 0.0

    def states(self) -> list[tuple[int, str]]:
        """The beginning of each state, without repetitions; only words that are states."""
        states: list[tuple[int, str]] = []
        for record in self.of("game_state"):
            if record.value in NEXT and (not states or states[-1][1] != record.value):
                states.append((record.at, record.value))
        return states

    def intervals(self, of: Collection[str]) -> list[tuple[int, int]]:
        """The instants in which the game was in one of these states; those that follow one another are one."""
        found: list[tuple[int, int]] = []
        states = self.states()
        end = max((s.at for s in self.track), default=0)
        for (begin, state), (until, _) in zip(states, [*states[1:], (max(end, states[-1][0]), "")], strict=True):
            if state in of:
                if found and found[-1][1] == begin:
                    found[-1] = found[-1][0], until
                else:
                    found.append((begin, until))
        return found

    def away(self, *nodes: str) -> list[tuple[int, int]]:
        """The instants in which one of these was away or not yet found again; what overlaps is one."""
        found: list[tuple[int, int]] = []
        for begin, end in sorted((o.begin, o.end) for o in self.outages if o.node in (*nodes, EVERY_NODE)):
            end += round(RECOVERY_S * 1e9)
            if found and begin <= found[-1][1]:
                found[-1] = found[-1][0], max(end, found[-1][1])
            else:
                found.append((begin, end))
        return found

    def away_s(self, begin: int, end: int, *nodes: str) -> float:
        """How much of the robot's time between two instants that was."""
        cut = [(max(begin, since), min(end, until)) for since, until in self.away(*nodes)]
        return sum(self.time_s(until) - self.time_s(since) for since, until in cut if since < until)


def outcome(evidence: Evidence) -> str:
    """The end of the game: ``complete``, ``lost``, ``reset``, ``home failed`` before it began, or ``never`` begun."""
    states = evidence.states()
    names = [state for _, state in states]
    ends = [k for k in range(1, len(states)) if names[k] == "menu"]
    if not ends:
        return "never"
    at, before = states[ends[-1]][0], names[ends[-1] - 1]
    if _was_reset(evidence, at) or before != "returning_home":
        return "reset"
    return next((how for how in OUTCOMES if _SEEN[how] in names), "home failed")


def _was_reset(e: Evidence, at: int) -> bool:
    away = e.away(REFEREE, SIMULATOR)
    return any(called <= at <= _answered(away, called, round(RESET_S * 1e9)) for called in e.resets)


def _answered(away: Sequence[tuple[int, int]], asked: int, within: int) -> int:
    """The last instant for an answer that takes so long, ns, from a node that may be away meanwhile."""
    latest = asked + within
    for since, until in away:
        if since <= latest and asked <= until:
            latest = max(latest, until + within)
    return latest


def _overlaps(spans: Sequence[tuple[int, int]], begin: int, end: int) -> bool:
    return any(since <= end and begin <= until for since, until in spans)


def waits(state: str | None, condition: Mapping[str, Any], clyde_moved_m: float) -> bool:
    """Whether the planner holds on purpose: a Clyde that stays at the last pellets keeps the robot from them.

    Args:
        state: of the game.
        condition: the goal selector's.
        clyde_moved_m: the farthest that Clyde has been from its place when the last progress was made.
    """
    return state == "running" and condition.get("pursued") == HOLD and clyde_moved_m < AROUND_M


def violations(evidence: Evidence) -> list[str]:
    """Everything that was wrong, one line each."""
    if not evidence.states():
        return ["the game's state was never received"]
    checks = (_transitions, _shows, _goals, _motion, _turns, _spawned, _scores, _results)
    return [line for check in checks for line in check(evidence)]


def _inside(at: int, intervals: Sequence[tuple[int, int]]) -> bool:
    """What happens at one simulated moment may be in any order, for nodes answer one another within it."""
    return any(_moment(begin) <= _moment(at) <= _moment(end) for begin, end in intervals)


def _moment(at: int) -> int:
    """The step of simulated time to which an instant belongs; instants are numbered within it."""
    return at // 1_000_000


def _transitions(e: Evidence) -> Iterator[str]:
    for (_, before), (at, after) in itertools.pairwise(e.states()):
        if after not in NEXT[before] and not (after == "menu" and _was_reset(e, at)):
            yield f"the state went from {before} to {after}"


def _shows(e: Evidence) -> Iterator[str]:
    for state, lasts in SHOWS.items():
        for begin, end in e.intervals((state,)):
            lasted = e.time_s(end) - e.time_s(begin) - e.away_s(begin, end, REFEREE, SIMULATOR)
            if lasted > lasts + TICK_S:
                yield f"{state} lasted {lasted:.1f} s, not {lasts:g} s"


def _goals(e: Evidence) -> Iterator[str]:
    driving, away = e.intervals(DRIVING), e.away(*MOVERS)
    for record in e.of("sent"):
        if not _inside(record.at, [*driving, *away]):
            late = min((record.at - end for _, end in driving if end <= record.at), default=0)
            yield f"a goal was sent {late * 1e-9:.2f} s after driving was over: {record.value}"
    sent = len(e.of("sent"))
    accepted: dict[str, int] = {}
    ended: dict[str, int] = {}
    for record in e.of("goals"):
        for key, status in record.value.items():
            accepted.setdefault(key, record.at)
            if status in ENDED:
                ended.setdefault(key, record.at)
        for key in accepted.keys() - record.value.keys():  # the server that knew it has gone
            ended.setdefault(key, record.at)
    if len(accepted) > sent:
        yield f"{len(accepted)} goals were accepted, {sent} were sent"
    last = e.track[-1].at if e.track else 0
    troubles = [*e.troubles, *((e.time_s(since), e.time_s(until)) for since, until in away)]
    for key, begin in accepted.items():
        end = ended.get(key, last)
        for stood, drove in e.intervals(NEXT.keys() - DRIVING):
            since, until = e.time_s(max(begin, stood)), e.time_s(min(end, drove))
            free = until - max([since, *(b for a, b in troubles if b >= since and a <= until)])
            if free > CANCEL_S:
                yield f"a goal was pursued for {until - since:.1f} s while no node may drive"


def _motion(e: Evidence) -> Iterator[str]:
    """The robot stands while no node drives; each goal that is accepted late moves it once more."""
    goals = sorted(_first_seen(e).values())
    away = e.away(*MOVERS)
    for begin, end in _without(e.intervals(NEXT.keys() - DRIVING), away):
        places = [(s.x, s.y) for s in e.track if begin <= s.at <= end]
        if not places:
            continue
        moved = max(math.dist(places[0], place) for place in places)
        starts = [begin, *(at for at in goals if begin <= at < end)]
        stops = len(starts) * (FASTEST_MPS * TICK_S + BRAKING_M)
        if moved > stops + STANDING_M:
            yield f"the robot moved {moved:.2f} m while no node may drive"


def _without(intervals: Sequence[tuple[int, int]], left_out: Sequence[tuple[int, int]]) -> Iterator[tuple[int, int]]:
    """What is left of intervals without others, which are in order and apart."""
    for begin, end in intervals:
        for since, until in left_out:
            if since < end and until > begin:
                if since > begin:
                    yield begin, since
                begin = until
        if begin < end:
            yield begin, end


def _first_seen(e: Evidence) -> dict[str, int]:
    seen: dict[str, int] = {}
    for record in e.of("goals"):
        for key in record.value:
            seen.setdefault(key, record.at)
    return seen


def _turns(e: Evidence) -> Iterator[str]:
    """Spin and shake: where, how fast and for how long the event mapper turned the robot."""
    shows, away = e.intervals(SHOWS), e.away(EVENT_MAPPER, REFEREE, SIMULATOR)
    turn: list[Record] = []
    turns = [record for record in e.of("turn") if math.isfinite(record.value)]  # others are nonsense from outside
    for record in [*turns, Record(e.track[-1].at if e.track else 0, "turn", 0.0)]:
        if record.value != 0.0:
            if abs(record.value) > ShowConfig.spin_radps + 1e-6:
                yield f"a turn at {record.value:.2f} rad/s"
            turn.append(record)
            continue
        if turn:
            begin, end = turn[0].at, turn[-1].at
            lasted = e.time_s(end) - e.time_s(begin)
            longest = SHOWS["dying" if any(r.value < 0 for r in turn) else "starting"]
            what = f"a turn of {lasted:.1f} s"
            if _overlaps(away, begin, end):
                turn = []
                continue
            if lasted > longest + TICK_S:
                yield f"{what}, longer than {longest:g} s"
            if not any(_inside(at, shows) for at in (begin, end)):
                yield f"{what} outside of a show"
            elif not _inside(end, shows):
                yield f"{what} that did not end with its show"
        turn = []


def _spawned(e: Evidence) -> Iterator[str]:
    """None before the first report, then all, always; more while a false report of 10,000 is the latest one.

    How long a node needs for such a report is not known. That the number is right at the end is asked elsewhere.
    """
    own, late = len(e.own_pellets), e.away(PELLET_MANAGER, REFEREE)  # a report of the round before
    for record in e.of("game/pellets_spawned"):
        forged = any(at <= record.at for at in e.forged_reports)
        right = record.value in (0, own) or (forged and record.value > own) or _near_forged(e, record.at)
        if record.at > e.started and not right and not _inside(record.at, late):
            yield f"{record.value} pellets were reported as spawned, there are {own}"


def _scores(e: Evidence) -> Iterator[str]:
    running = e.intervals(("running",))
    sure, perhaps = set(), set()
    for record in e.of("game_status"):
        pellet = _own_pellet(e, record.value)
        if pellet is not None and _inside(record.at, running):
            perhaps.add(pellet)
            if any(begin <= record.at < end for begin, end in running):
                sure.add(pellet)
    names = [state for _, state in e.states()]
    counted = _last_before_end(e, "game/pellets_collected")
    away = e.away(SELECTOR, REFEREE, SIMULATOR)
    if outcome(e) == "reset" and any(_overlaps(away, *one) for one in running):
        sure.clear()  # broken off before the referee could get all of the reports: there is no score then
    if not len(sure) <= counted <= len(perhaps):
        yield f"{counted} pellets were counted, {len(sure)} to {len(perhaps)} were collected"
    most = max((r.value for r in e.of("game/score") if r.at > e.started), default=e.score)
    if "running" in names and most != max(e.score + counted, e.score):
        yield f"the score went up to {most}, from {e.score} with {counted} pellets"
    known = not any(_near_forged(e, at) for at, state in e.states() if state == "complete")
    if ("complete" in names or outcome(e) == "complete") and known and counted != len(e.own_pellets):
        yield f"the round was complete with {counted} of {len(e.own_pellets)} pellets"


def _own_pellet(e: Evidence, word: str) -> int | None:
    """The pellet that a status reports as collected."""
    found = _COLLECTED.fullmatch(word)
    return int(found[1]) if found and int(found[1]) in e.own_pellets else None


def _near_forged(e: Evidence, at: int) -> bool:
    """Whether a false report of the pellets was all that the referee knew: the next true one comes within 1 s."""
    away = e.away(PELLET_MANAGER, REFEREE, SIMULATOR)
    return any(forged <= at <= _answered(away, forged, round(REPORT_S * 1e9)) for forged in e.forged_reports)


def _last_before_end(e: Evidence, topic: str) -> int:
    """The highest value: counters go up within a game and back at its end."""
    return max((int(r.value) for r in e.of(topic)), default=0)


def _results(e: Evidence) -> Iterator[str]:
    """The latched values when the game is in the menu again."""
    how, counted = outcome(e), _last_before_end(e, "game/pellets_collected")
    if how == "never":
        return
    homes = [r.value for r in e.of("game_status") if r.value in ("home_reached", "home_failed")]
    result = {"complete": f"Complete - Score: {e.score + counted}", "lost": f"Death - Score: {e.score + counted}"}
    kept = how in ("complete", "home failed")
    number = e.round + (how == "complete") if kept else 1
    expected: dict[str, Any] = {
        "game_result": "home_failed" if how != "reset" and homes[-1:] == ["home_failed"] else result.get(how, ""),
        "game/score": e.score + counted if kept else 0,
        "game/round": number,
        "game/pellets_collected": 0,
        "game/pellets_spawned": len(e.own_pellets),
        "clyde/speed": e.base_speed_mps + (number - 1) * e.speed_step_mps,
    }
    for topic, value in expected.items():
        found = e.last(topic)
        if found is None or (abs(found - value) > 1e-3 if isinstance(value, float) else found != value):
            yield f"{topic} is {found!r} at the end, not {value!r}"
