"""Whichever of referee, pellet manager and executing side is killed, a completed round counts all of its pellets.

It also counts each caught ghost once, unless the side that caught it is killed while the referee is away.
The three without a middleware: what is sent to one that is not there, or has just begun, is lost.
"""

from collections.abc import Iterable
from typing import Any

from hypothesis import example, given
from hypothesis import strategies as st

from pacman_env.config import make_config
from pacman_env.game.goal_executor import GoalExecutor
from pacman_env.game.goals import ExecutorAction, Goals, home_place
from pacman_env.game.power import is_frightened, score_ghost
from pacman_env.game.round import Action, RoundController

PELLETS = {10: (2.0, 0.0), 11: (4.0, 0.0), 12: (6.0, 0.0)}
POWER = (10, 12)
SETTINGS: dict[str, Any] = {"power.pellets": len(POWER), "power.duration_s": 60.0, "power.return_s": 1.0}
CONFIG = make_config("robot", **SETTINGS)
STEP_S = 0.5
LATCHED = {"state": "", "command": "", "spawned": 0, "collected": 0, "ghosts_caught": 0}
SIDES = ("referee", "manager", "planner")

#: What happens, to what, and for how many steps nothing else does.
events = st.one_of(
    st.tuples(st.just("drive"), st.sampled_from(sorted(PELLETS)), st.integers(0, 8)),
    st.tuples(st.just("ghost"), st.integers(0, 1), st.integers(0, 8)),
    st.tuples(st.sampled_from(["kill", "start"]), st.sampled_from(SIDES), st.integers(0, 8)),
)
#: The referee counts 10 and is killed; 11 is collected then, and 10 is shown again by a new manager.
SHOWN_AGAIN: list[tuple[str, Any, int]] = [
    *(("drive", 10, 0), ("kill", "manager", 0), ("start", "manager", 0), ("kill", "referee", 0), ("drive", 11, 0)),
    *(("kill", "planner", 1), ("start", "referee", 0), ("start", "planner", 10)),
]


#: The referee is killed before a ghost is caught, and back before another power pellet is collected.
LATE_CATCH: list[tuple[str, Any, int]] = [
    *(("drive", 10, 4), ("kill", "referee", 0), ("ghost", 0, 0), ("start", "referee", 0)),
    *(("drive", 12, 0), ("ghost", 1, 0)),
]


class Sides:
    """A game in a round that runs, with its three sides; one that was started receives nothing before the next step."""

    def __init__(self) -> None:
        self.now, self.pose = 0.0, (0.0, 0.0)
        self.points: list[int] = []  # of each caught ghost
        self.referee: RoundController | None = RoundController(power=CONFIG.power)
        self.kept: dict[str, Any] = {}
        self.latched: dict[str, Any] = {}
        self.manager: set[int] | None = set(PELLETS)
        self.planner: GoalExecutor | None = None
        self.absent: set[str] = set()
        self.begin("planner")
        self.absent.clear()
        self.on_referee(self.referee.start(self.now))
        self.on_referee(self.referee.status("home_reached", self.now))
        for _ in range(20):
            self.step()
        assert self.referee.state == "running"

    def begin(self, side: str) -> None:
        if getattr(self, side) is not None:
            return
        self.absent.add(side)
        if side == "manager":
            self.manager = set(PELLETS)
        elif side == "planner":
            self.planner = GoalExecutor(CONFIG, Goals(PELLETS, {}, [], POWER), home_place(0.0, 0.0, 0.0))
            self.planner.activate(self.now)
            self.planner.nav2(True, self.now)
            for kind, value in self.latched.items():
                self.to_planner(kind, value)
        else:
            self.referee = RoundController(power=CONFIG.power)
            self.on_referee(self.referee.restore(self.kept, self.now))

    def kill(self, side: str) -> None:
        setattr(self, side, None)
        if side == "planner":
            del self.points[self.kept["ghosts_caught"] :]  # nobody knows of them
        if side == "referee":
            self.latched = {}

    def is_there(self, side: str) -> bool:
        return getattr(self, side) is not None and side not in self.absent

    def on_referee(self, actions: Iterable[Action]) -> None:
        actions = list(actions)
        assert self.referee is not None
        if any(action.kind != "ignored" for action in actions):
            self.kept = self.referee.snapshot(self.now)
        for kind, value in ((action.kind, action.value) for action in actions):
            if kind in LATCHED:
                self.latched[kind] = value
                self.to_planner(kind, value)
            elif kind == "remove" and self.is_there("manager"):
                self.remove(value)
            elif kind == "reset_pellets" and self.manager is not None:
                self.manager = set(PELLETS)

    def remove(self, pellet: Any) -> None:
        assert self.manager is not None
        self.manager.discard(pellet)

    def to_planner(self, kind: str, value: Any) -> None:
        if self.planner is None:
            return
        if kind == "spawned":
            self.planner.statuses.spawned = value
        elif kind == "collected":
            self.planner.statuses.counted(value)
        elif kind == "ghosts_caught":
            self.planner.statuses.catches_counted(value)
        else:
            act = self.planner.state if kind == "state" else self.planner.command
            self.on_planner(act(value, self.now))

    def on_planner(self, actions: Iterable[ExecutorAction]) -> None:
        for action in list(actions):
            if action.kind == "status":
                self.report(str(action.value))
            elif action.kind == "remove" and self.is_there("manager"):
                self.remove(action.value)

    def report(self, word: str) -> None:
        if self.referee is not None and self.is_there("referee"):
            self.on_referee(self.referee.status(word, self.now))

    def step(self, what: str = "", value: Any = None) -> None:
        self.now += STEP_S
        if what == "kill":
            self.kill(value)
        elif what == "drive":
            self.pose = PELLETS[value]
        frightened = what == "ghost" and self.planner and is_frightened(self.planner.round.ghosts[value], self.now)
        ghosts = [self.pose if frightened and k == value else (99.0, 99.0) for k in range(2)]
        starting = value if what == "start" and getattr(self, value) is None else None
        if starting:
            self.begin(starting)
        if self.now % 1 == 0 and self.is_there("manager"):
            left = sorted(self.manager or ())
            if self.referee is not None and self.is_there("referee"):
                self.on_referee(self.referee.pellets_left(left, self.now, POWER))
            if self.planner is not None and self.is_there("planner"):
                self.on_planner(self.planner.pellets(left, 0, self.now))
        if self.referee is not None:
            self.on_referee(self.referee.tick(self.now))
        if self.planner is not None:
            caught = self.planner.round.record.caught
            actions = self.planner.check(self.pose, ghosts, self.now)
            if self.planner.round.record.caught > caught:
                self.points.append(score_ghost(self.planner.round.record.streak - 1, CONFIG.power.ghost_points)[0])
            self.on_planner(actions)
            if self.now % 2 == 0:
                for word in self.planner.statuses.open():
                    self.report(word)
        self.absent = {starting} if starting else set()

    def play_on(self) -> str:
        """With all sides there, to the end of the round: its result."""
        for side in SIDES:
            self.step("start", side)
        for _ in range(10):
            for pellet in PELLETS:
                for _ in range(4):
                    self.step("drive", pellet)
                    assert self.referee is not None
                    if self.referee.result:
                        return self.referee.result
        return f"no end: {self.referee}"


@example(SHOWN_AGAIN)
@example(LATE_CATCH)
@given(st.lists(events, max_size=16))
def test_round_completes_whichever_side_was_killed(played: list[tuple[str, Any, int]]) -> None:
    sides = Sides()
    for what, value, pause in played:
        if sides.kept["result"]:
            break  # the round is over, and the next things would happen on the way home
        sides.step(what, value)
        for _ in range(pause):
            sides.step()
    result = sides.play_on()
    score = len(PELLETS) + len(POWER) * (CONFIG.power.pellet_points - 1) + sum(sides.points)
    assert result == f"Complete - Score: {score}"
