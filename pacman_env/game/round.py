"""Algorithm 5: the game from menu to menu, and the two rules of a round that the simulator shares.

A pure state machine: time comes in as an argument, everything to publish goes out as a list of actions.
Detecting pick-up and death is Algorithm 4's business, and so is the event ``clyde killed``: who sees the
death names the ghost, then reports ``death_detected``. Lights and sounds of events are decided elsewhere. So is where
a snapshot of a game is kept while nobody plays it.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any, Literal

import msgspec
from msgspec import Meta

from pacman_env.config import ClydeConfig, ShowConfig
from pacman_env.config.validation import convert, require
from pacman_env.game.execution import round_complete

State = Literal["menu", "returning_home", "starting", "running", "dying", "complete"]
ActionKind = Literal[
    "command",
    "event",
    "state",
    "result",
    "score",
    "round",
    "spawned",
    "collected",
    "clyde_speed",
    "remove",
    "reset_pellets",
    "reset_clyde",
    "ignored",
]


@dataclass(frozen=True)
class Action:
    """One thing to publish or to call, in order; ``ignored`` says why an input had no effect."""

    kind: ActionKind
    value: str | int | float | None = None


def clyde_speed_mps(base: float, step: float, round: int) -> float:
    """Clyde's speed in a round, the first being 1 (Milestone 3, Algorithm 5)."""
    return base + (round - 1) * step


_Count = Annotated[int, Meta(ge=0, lt=10**9)]
_MISSED_S = 3.0  # reports come once a second: after a longer pause some were missed


class Snapshot(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A game as it is kept; lists are ids of pellets, each once."""

    state: Literal["menu", "returning_home", "starting", "running", "dying"]
    score: _Count
    round: Annotated[int, Meta(ge=1, lt=10**9)]
    result: Annotated[str, Meta(max_length=200)]
    base_speed_mps: Annotated[float, Meta(ge=1e-6, le=1e6)]
    collected: tuple[_Count, ...]
    shown: tuple[_Count, ...]
    still_shown: tuple[_Count, ...]
    lasting: tuple[_Count, ...]
    left: tuple[_Count, ...] | None
    due_in_s: Annotated[float, Meta(ge=0, le=1e6)] | None
    after_home: Literal["start", "next_round", "game_over"]
    home_failures: _Count


@dataclass
class RoundController:
    """The game's state, score and round; every input returns the actions it causes.

    Score counts pellets over the whole game: a completed round keeps it and raises the round and Clyde's
    speed, death and ``reset`` set all back. What does not fit the state changes nothing and is ``ignored``.
    """

    clyde: ClydeConfig = field(default_factory=ClydeConfig)
    start_show_s: float = ShowConfig.start_s
    death_show_s: float = ShowConfig.death_s
    home_retries: int = ShowConfig.home_retries  # more tries after a failed way home before the game gives up
    home_retry_s: float = ShowConfig.home_retry_s  # pause before each of them

    state: State = field(default="menu", init=False)
    score: int = field(default=0, init=False)
    round: int = field(default=1, init=False)
    result: str = field(default="", init=False)
    _base_speed_mps: float = field(init=False)
    _collected: set[int] = field(default_factory=set, init=False)
    _left: frozenset[int] | None = field(default=None, init=False)  # None: no report in this round yet
    _shown: set[int] = field(default_factory=set, init=False)  # in any report of this round
    #: In two reports in a row, or in the last before a pause: such a pellet does not go but by being collected.
    _lasting: set[int] = field(default_factory=set, init=False)
    _reported_s: float = field(default=-math.inf, init=False)  # when the latest report came
    _still_shown: frozenset[int] = field(default=frozenset(), init=False)  # collected, but in the latest report
    _deadline_s: float | None = field(default=None, init=False)  # when ``tick`` acts next
    _after_home: Literal["start", "next_round", "game_over"] = field(default="start", init=False)
    _home_failures: int = field(default=0, init=False)

    def __post_init__(self) -> None:
        self._base_speed_mps = self.clyde.speed_mps

    @property
    def collected(self) -> int:
        """Pellets collected in this round."""
        return len(self._collected)

    @property
    def spawned(self) -> int:
        """Pellets of this round, collected or not; 0 as long as none were reported.

        Those that are gone but not reported as collected are among them: the report was lost, and is repeated.
        """
        return 0 if self._left is None else len(self._left | self._collected | self._lasting)

    @property
    def clyde_speed(self) -> float:
        """Clyde's speed in this round, m/s."""
        return clyde_speed_mps(self._base_speed_mps, self.clyde.speed_step_mps, self.round)

    def announce(self) -> list[Action]:
        """Everything latched as it is now, for a node that has just come up.

        The command is the one that the state stands for: who has carried it out before has nothing to do.
        """
        commands = {"running": "enable", "returning_home": "return_home" if self._deadline_s is None else "disable"}
        return [Action("command", commands.get(self.state, "disable")), *self._latched()]

    def snapshot(self, now: float) -> dict[str, Any]:
        """All that ``restore`` needs, as plain values that JSON knows; instants as the time left until then, s."""
        return {
            "state": self.state,
            "score": self.score,
            "round": self.round,
            "result": self.result,
            "base_speed_mps": self._base_speed_mps,
            "collected": sorted(self._collected),
            "shown": sorted(self._shown),
            "still_shown": sorted(self._still_shown),
            "lasting": sorted(self._lasting),
            "left": None if self._left is None else sorted(self._left),
            "due_in_s": None if self._deadline_s is None else max(0.0, self._deadline_s - now),
            "after_home": self._after_home,
            "home_failures": self._home_failures,
        }

    def restore(self, values: Mapping[str, Any], now: float) -> list[Action]:
        """Go on where a snapshot was taken.

        Returns:
            What tells the others, who may have gone on meanwhile. A round that has not begun is reset once more, for
            nobody knows whether that was done.

        Raises:
            ValueError: not a snapshot; nothing has changed.
        """
        kept: Snapshot = convert(values, Snapshot, "snapshot")
        for name in ("collected", "shown", "still_shown", "lasting", "left"):
            ids = getattr(kept, name) or ()
            require(len(set(ids)) == len(ids), f"snapshot.{name}", ids, "must have each pellet once")
        state, due_s = kept.state, kept.due_in_s
        timed = state == "returning_home" or (due_s is not None) == (state in ("starting", "dying"))
        require(timed, "snapshot.due_in_s", due_s, f"does not fit state {state!r}")
        self.state, self.score, self.round, self.result = state, kept.score, kept.round, kept.result
        self._base_speed_mps = kept.base_speed_mps
        self._collected = set(kept.collected)
        self._shown, self._still_shown = set(kept.shown), frozenset(kept.still_shown)
        self._lasting, self._reported_s = set(kept.lasting), -math.inf  # reports were missed since
        self._left = None if kept.left is None else frozenset(kept.left)
        self._deadline_s = None if due_s is None else now + due_s
        self._after_home, self._home_failures = kept.after_home, kept.home_failures
        before_round = state == "starting" or (state == "returning_home" and self._after_home == "start")
        resets = [Action("reset_pellets"), Action("reset_clyde")] if before_round else []
        return [*self.announce(), *resets]

    def start(self, now: float) -> list[Action]:
        """Drive home and begin the round; only from the menu."""
        if self.state != "menu":
            return [Action("ignored", f"start: the game is in state {self.state!r}")]
        self.result = ""
        return [*self._reset_round(), *self._go_home("start")]

    def reset(self, now: float) -> list[Action]:
        """Break off whatever is going on: back to the menu, score 0, round 1."""
        self.result = ""
        return self._game_over()

    def pellets_left(self, ids: Iterable[int], now: float) -> list[Action]:
        """The ids that the latest pellet report still shows.

        A pellet of one report alone, be it stale, early or of another map, is forgotten with the next. One that lasts
        is of this round, and has to be collected: which of status and report of one pellet comes first does not
        matter, nor that a report shows nothing. A pellet that two reports show after it was collected is to be removed
        once more: who shows them has forgotten it.
        """
        before = self.spawned
        left, missed = frozenset(ids), now - self._reported_s > _MISSED_S
        if self._left is not None:
            self._lasting |= self._left if missed else self._left & left
        self._left, self._reported_s = left, now
        self._shown |= self._left
        still = self._left & self._collected
        again, self._still_shown = still & self._still_shown, still
        spawned = [Action("spawned", self.spawned)] if self.spawned != before else []
        return spawned + [Action("remove", pellet) for pellet in sorted(again)]

    def base_clyde_speed(self, speed_mps: float) -> list[Action]:
        """Set Clyde's speed of round 1; announced at once in the menu, else with the next round."""
        if not (math.isfinite(speed_mps) and speed_mps > 0):
            return [Action("ignored", f"base Clyde speed {speed_mps!r}: must be a finite number above 0")]
        self._base_speed_mps = float(speed_mps)
        return [Action("clyde_speed", self.clyde_speed)] if self.state == "menu" else []

    def status(self, word: str, now: float) -> list[Action]:
        """A report of the executing side.

        Words: pellet_collected:<id>, death_detected, game_complete, home_reached, home_failed.
        """
        name, _, argument = word.strip().lower().partition(":")
        expected: dict[str, State] = {
            "pellet_collected": "running",
            "death_detected": "running",
            "game_complete": "running",
            "home_reached": "returning_home",
            "home_failed": "returning_home",
        }
        if name not in expected or bool(argument) != (name == "pellet_collected"):
            return [Action("ignored", f"status {word!r}: not a status")]
        if self.state != expected[name]:
            return [Action("ignored", f"status {word!r}: the game is in state {self.state!r}")]
        if name == "pellet_collected":
            return self._pellet(argument)
        if name == "death_detected":
            return self._die(now)
        if name == "game_complete":
            return self._complete()
        return self._home_reached(now) if name == "home_reached" else self._home_failed(now)

    def tick(self, now: float) -> list[Action]:
        """What is due: the end of the start show or of the death show, another try to get home."""
        if self._deadline_s is None or now < self._deadline_s:
            return []
        self._deadline_s = None
        if self.state == "starting":
            return [
                Action("clyde_speed", self.clyde_speed),
                Action("command", "enable"),
                self._enter("running"),
            ]
        if self.state == "dying":
            return self._go_home("game_over")
        return [Action("command", "return_home")]

    def _enter(self, state: State) -> Action:
        self.state = state
        return Action("state", state)

    def _latched(self) -> list[Action]:
        return [
            Action("clyde_speed", self.clyde_speed),
            Action("result", self.result),
            Action("spawned", self.spawned),
            Action("collected", self.collected),
            Action("score", self.score),
            Action("round", self.round),
            Action("state", self.state),
        ]

    def _reset_round(self) -> list[Action]:
        self.state = "menu"
        self._collected.clear()
        self._left = None
        self._shown.clear()
        self._lasting.clear()
        self._still_shown = frozenset()
        self._deadline_s = None
        return [
            Action("command", "disable"),
            Action("command", "reset_round"),
            Action("event", "reset"),
            Action("reset_pellets"),
            Action("reset_clyde"),
            *self._latched(),
        ]

    def _game_over(self) -> list[Action]:
        self.score = 0
        self.round = 1
        return self._reset_round()

    def _go_home(self, then: Literal["start", "next_round", "game_over"]) -> list[Action]:
        self._after_home = then
        self._home_failures = 0
        return [Action("command", "return_home"), self._enter("returning_home")]

    def _arrive(self) -> list[Action]:
        """The menu after a round; nothing to settle where no round was played."""
        if self._after_home == "next_round":
            self.round += 1
            return self._reset_round()
        return self._game_over() if self._after_home == "game_over" else self._reset_round()

    def _home_reached(self, now: float) -> list[Action]:
        if self._after_home != "start":
            return self._arrive()
        self._deadline_s = now + self.start_show_s
        return [Action("event", "start theatrical"), self._enter("starting")]

    def _home_failed(self, now: float) -> list[Action]:
        if self._deadline_s is not None:
            return [Action("ignored", "status 'home_failed': the next try is due already")]
        self._home_failures += 1
        if self._home_failures <= self.home_retries:
            self._deadline_s = now + self.home_retry_s
            return []
        self.result = "home_failed"
        return self._arrive()

    def _pellet(self, argument: str) -> list[Action]:
        if not (argument.isascii() and argument.isdigit() and len(argument) < 10):
            return [Action("ignored", f"status 'pellet_collected:{argument}': not a pellet id")]
        pellet = int(argument)
        if pellet in self._collected:
            return [Action("ignored", f"pellet {pellet} was counted before")]
        if self._left is not None and pellet not in self._left | self._shown:
            return [Action("ignored", f"pellet {pellet} is none of this round's")]
        before = self.spawned
        self._collected.add(pellet)
        self.score += 1
        actions = [Action("spawned", self.spawned)] if self.spawned != before else []
        actions += [
            Action("collected", self.collected),
            Action("score", self.score),
            Action("event", "pellet"),
        ]
        if round_complete(self.collected, self.spawned):
            actions += self._complete()
        return actions

    def _complete(self) -> list[Action]:
        self.result = f"Complete - Score: {self.score}"
        command, returning = self._go_home("next_round")
        return [
            Action("command", "disable"),
            Action("event", "win"),
            Action("result", self.result),
            command,
            Action("state", "complete"),
            returning,
        ]

    def _die(self, now: float) -> list[Action]:
        self.result = f"Death - Score: {self.score}"
        self._deadline_s = now + self.death_show_s
        return [Action("command", "disable"), Action("result", self.result), self._enter("dying")]
