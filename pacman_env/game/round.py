"""Control the game from menu to menu (Algorithm 5).

This is a pure state machine: time (``now``, s) is an argument, the result is a list of actions. Pick-up, death and the
event ``<ghost> killed`` belong to Algorithm 4.
"""

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any, Literal

import msgspec
from msgspec import Meta

from pacman_env.config import ClydeConfig, PowerConfig, ShowConfig
from pacman_env.config.validation import convert, require
from pacman_env.game.execution import round_complete
from pacman_env.game.ghosts import GHOST_NAMES
from pacman_env.game.power import score_ghost, score_pellet

State = Literal["menu", "returning_home", "starting", "running", "dying", "complete"]
Command = Literal["enable", "disable", "reset_round", "return_home"]
_AfterHome = Literal["start", "next_round", "game_over"]


@dataclass(frozen=True)
class Action:
    """A message to publish or service to call, in order; the value of ``ignored`` tells why an input had no effect."""

    #: command, event, state, result, score, round, spawned, collected, ghosts_caught, clyde_speed, remove,
    #: reset_pellets, reset_clyde
    kind: str
    value: str | int | float | None = None


_KEPT = (  # copied to snapshots
    *("state", "score", "round", "result", "base_speed_mps", "after_home", "home_failures"),
    *("ghosts_caught", "streak"),
)
_RESETS = (Action("reset_pellets"), Action("reset_clyde"))


def clyde_speed_mps(base: float, step: float, round: int) -> float:
    """Return Clyde's speed in a round, counted from 1 (Milestone 3, Algorithm 5)."""
    return base + (round - 1) * step


_Count = Annotated[int, Meta(ge=0, lt=10**9)]
_MISSED_S = 3.0  # after a longer pause, reports were missed (they come once a second)


class Snapshot(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A saved game; lists contain ids of pellets without duplicates."""

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
    after_home: _AfterHome
    home_failures: _Count
    power: tuple[_Count, ...] = ()
    ghosts_caught: _Count = 0
    streak: _Count = 0


@dataclass
class _Pellets:  # ids of a round's pellets
    collected: set[int] = field(default_factory=set)
    shown: set[int] = field(default_factory=set)  # in any report
    still_shown: set[int] = field(default_factory=set)  # collected, but shown in the latest report
    #: Shown in two successive reports, or in the last one before a pause: only collection can end such a pellet.
    lasting: set[int] = field(default_factory=set)
    left: set[int] | None = None  # in the latest report; None before the first
    power: set[int] = field(default_factory=set)  # power pellets in any report


@dataclass
class RoundController:
    """State, score and round of the game; every input returns the actions that it causes.

    The score counts pellets and caught ghosts over the whole game. A completed round keeps it and increases round
    number and Clyde's speed; death and ``reset`` set all back. Inputs that do not fit the state change nothing and are
    ``ignored``.
    """

    clyde: ClydeConfig = field(default_factory=ClydeConfig)
    show: ShowConfig = field(default_factory=ShowConfig)
    power: PowerConfig = field(default_factory=PowerConfig)

    state: State = field(default="menu", init=False)
    score: int = field(default=0, init=False)
    round: int = field(default=1, init=False)
    result: str = field(default="", init=False)
    base_speed_mps: float = field(init=False)
    pellets: _Pellets = field(default_factory=_Pellets, init=False)
    _reported_s: float = field(default=-math.inf, init=False)  # time of the latest pellet report
    _deadline_s: float | None = field(default=None, init=False)  # next time at which ``tick`` acts
    after_home: _AfterHome = field(default="start", init=False)
    home_failures: int = field(default=0, init=False)
    ghosts_caught: int = field(default=0, init=False)  # in this round
    streak: int = field(default=0, init=False)  # ghosts caught since the last power pellet

    def __post_init__(self) -> None:
        self.base_speed_mps = self.clyde.speed_mps

    @property
    def collected(self) -> int:
        return len(self.pellets.collected)

    @property
    def spawned(self) -> int:
        """Number of this round's pellets, including collected pellets and pellets that await a report; 0 if unknown."""
        pellets = self.pellets
        return 0 if pellets.left is None else len(pellets.left | pellets.collected | pellets.lasting)

    @property
    def clyde_speed(self) -> float:
        return clyde_speed_mps(self.base_speed_mps, self.clyde.speed_step_mps, self.round)

    def announce(self) -> list[Action]:
        """Return all latched values and the command of the present state, for a node that has just started."""
        commands = {"running": "enable", "returning_home": "return_home" if self._deadline_s is None else "disable"}
        return [Action("command", commands.get(self.state, "disable")), *self._latched()]

    def snapshot(self, now: float) -> dict[str, Any]:
        """Return everything that ``restore`` needs as JSON values; times are relative to ``now``, s."""
        return {
            **{name: getattr(self, name) for name in _KEPT},
            **{name: None if ids is None else sorted(ids) for name, ids in vars(self.pellets).items()},
            "due_in_s": None if self._deadline_s is None else max(0.0, self._deadline_s - now),
        }

    def restore(self, values: Mapping[str, Any], now: float) -> list[Action]:
        """Resume from a snapshot and return the actions to announce it; a round that has not begun is reset.

        Raises ValueError for an invalid snapshot.
        """
        saved: Snapshot = convert(values, Snapshot, "snapshot")
        pellets: dict[str, Any] = {}
        for name in vars(_Pellets()):
            ids = getattr(saved, name)
            pellets[name] = None if ids is None else set(ids)
            require(len(pellets[name] or ()) == len(ids or ()), f"snapshot.{name}", ids, "must have each pellet once")
        state, due_s = saved.state, saved.due_in_s
        timed = state == "returning_home" or (due_s is not None) == (state in ("starting", "dying"))
        require(timed, "snapshot.due_in_s", due_s, f"does not fit state {state!r}")
        for name in _KEPT:
            setattr(self, name, getattr(saved, name))
        self.pellets = _Pellets(**pellets)
        self._reported_s = -math.inf  # reports were missed
        self._deadline_s = None if due_s is None else now + due_s
        before_round = state == "starting" or (state == "returning_home" and self.after_home == "start")
        return [*self.announce(), *(_RESETS if before_round else ())]

    def start(self, now: float) -> list[Action]:
        if self.state != "menu":
            return [Action("ignored", f"start: the game is in state {self.state!r}")]
        self.result = ""
        return [*self._reset_round(), *self._go_home("start")]

    def reset(self, now: float) -> list[Action]:
        """Abort the game: back to the menu with score 0 and round 1."""
        self.result = ""
        return self._game_over()

    def pellets_left(self, ids: Iterable[int], now: float, power: Iterable[int] = ()) -> list[Action]:
        """Process the ids in the latest pellet report, and which of them are ``power`` pellets.

        A pellet that only one report shows, which may be stale, early or of another map, is forgotten with the next
        report. A lasting pellet belongs to this round and must be collected, whatever the order of its status and
        report, and even if a report is empty. A pellet that two reports show after its collection must be removed
        again, because the node that shows it has forgotten the removal.
        """
        spawned_before, pellets = self.spawned, self.pellets
        left, missed = set(ids), now - self._reported_s > _MISSED_S
        if pellets.left is not None:
            pellets.lasting |= pellets.left if missed else pellets.left & left
        pellets.left, self._reported_s = left, now
        pellets.shown |= left
        pellets.power |= set(power)
        still = left & pellets.collected
        repeated, pellets.still_shown = still & pellets.still_shown, still
        return _spawned_since(self, spawned_before) + [Action("remove", pellet) for pellet in sorted(repeated)]

    def base_clyde_speed(self, speed_mps: float) -> list[Action]:
        """Set Clyde's speed of round 1; it is announced at once in the menu, otherwise with the next round."""
        if not (math.isfinite(speed_mps) and speed_mps > 0):
            return [Action("ignored", f"base Clyde speed {speed_mps!r}: must be a finite number above 0")]
        self.base_speed_mps = float(speed_mps)
        return [Action("clyde_speed", self.clyde_speed)] if self.state == "menu" else []

    def status(self, word: str, now: float) -> list[Action]:
        """Process a report of the executing side: one of ``statuses``.

        For a pellet it is ``pellet_collected:<id>``, for the n-th ghost caught in this round
        ``ghost_caught:<n>:<name>``.
        """
        name, _, argument = word.strip().lower().partition(":")
        statuses: dict[str, tuple[State, Callable[[], list[Action]]]] = {
            "pellet_collected": ("running", lambda: self._pellet(argument)),
            "ghost_caught": ("running", lambda: self._catch(argument)),
            "death_detected": ("running", lambda: self._die(now)),
            "game_complete": ("running", self._complete),
            "home_reached": ("returning_home", lambda: self._home_reached(now)),
            "home_failed": ("returning_home", lambda: self._home_failed(now)),
        }
        if name not in statuses or bool(argument) != (name in ("pellet_collected", "ghost_caught")):
            return [Action("ignored", f"status {word!r}: not a status")]
        state, act = statuses[name]
        if self.state != state:
            return [Action("ignored", f"status {word!r}: the game is in state {self.state!r}")]
        return act()

    def tick(self, now: float) -> list[Action]:
        """End the start or death show if it is over, or retry the return home."""
        if self._deadline_s is None or now < self._deadline_s or awaits_pellets(self, now):
            return []
        self._deadline_s = None
        if self.state == "starting":
            return [Action("clyde_speed", self.clyde_speed), Action("command", "enable"), self._enter("running")]
        if self.state == "dying":
            return self._go_home("game_over")
        return [Action("command", "return_home")]

    def _enter(self, state: State) -> Action:
        self.state = state
        return Action("state", state)

    def _latched(self) -> list[Action]:
        caught = ("ghosts_caught",) if self.power.pellets > 0 else ()
        latched = ("clyde_speed", "result", "spawned", "collected", *caught, "score", "round", "state")
        return [Action(kind, getattr(self, kind)) for kind in latched]

    def _reset_round(self) -> list[Action]:
        self.state = "menu"
        self.pellets = _Pellets()
        self.ghosts_caught = self.streak = 0
        self._deadline_s = None
        words = [Action("command", "disable"), Action("command", "reset_round"), Action("event", "reset")]
        return [*words, *_RESETS, *self._latched()]

    def _game_over(self) -> list[Action]:
        self.score = 0
        self.round = 1
        return self._reset_round()

    def _go_home(self, then: _AfterHome) -> list[Action]:
        self.after_home = then
        self.home_failures = 0
        return [Action("command", "return_home"), self._enter("returning_home")]

    def _arrive(self) -> list[Action]:
        self.round += self.after_home == "next_round"
        return self._game_over() if self.after_home == "game_over" else self._reset_round()

    def _home_reached(self, now: float) -> list[Action]:
        if self.after_home != "start":
            return self._arrive()
        self._deadline_s = now + self.show.start_s
        return [Action("event", "start theatrical"), self._enter("starting")]

    def _home_failed(self, now: float) -> list[Action]:
        if self._deadline_s is not None:
            return [Action("ignored", "status 'home_failed': the next try is due already")]
        self.home_failures += 1
        if self.home_failures <= self.show.home_retries:
            self._deadline_s = now + self.show.home_retry_s
            return []
        self.result = "home_failed"
        return self._arrive()

    def _pellet(self, argument: str) -> list[Action]:
        if not (argument.isascii() and argument.isdigit() and len(argument) < 10):
            return [Action("ignored", f"status 'pellet_collected:{argument}': not a pellet id")]
        pellet = int(argument)
        if pellet in self.pellets.collected:
            return [Action("ignored", f"pellet {pellet} was counted before")]
        if self.pellets.left is not None and pellet not in self.pellets.shown:
            return [Action("ignored", f"pellet {pellet} is not in this round")]
        spawned_before = self.spawned
        self.pellets.collected.add(pellet)
        is_power = pellet in self.pellets.power
        points, self.streak = score_pellet(self.streak, is_power, self.power.pellet_points)
        self.score += points
        event = "power pellet" if is_power else "pellet"
        counts = [Action("collected", self.collected), Action("score", self.score), Action("event", event)]
        end = self._complete() if round_complete(self.collected, self.spawned) else []
        return [*_spawned_since(self, spawned_before), *counts, *end]

    def _catch(self, argument: str) -> list[Action]:
        number, _, ghost = argument.partition(":")
        if ghost not in GHOST_NAMES or not (number.isascii() and number.isdigit() and len(number) < 10):
            return [Action("ignored", f"status 'ghost_caught:{argument}': not the number and name of a ghost")]
        if int(number) != self.ghosts_caught + 1:
            return [Action("ignored", f"ghost {number}: {self.ghosts_caught} were caught before")]
        self.ghosts_caught += 1
        points, self.streak = score_ghost(self.streak, self.power.ghost_points)
        self.score += points
        counts = [Action("ghosts_caught", self.ghosts_caught), Action("score", self.score)]
        return [*counts, Action("event", f"{ghost} caught")]

    def _complete(self) -> list[Action]:
        self.result = f"Complete - Score: {self.score}"
        command, returning = self._go_home("next_round")
        end = [Action("command", "disable"), Action("event", "win"), Action("result", self.result)]
        return [*end, command, Action("state", "complete"), returning]

    def _die(self, now: float) -> list[Action]:
        self.result = f"Death - Score: {self.score}"
        self._deadline_s = now + self.show.death_s
        return [Action("command", "disable"), Action("result", self.result), self._enter("dying")]


def _spawned_since(game: RoundController, before: int) -> list[Action]:
    return [Action("spawned", game.spawned)] if game.spawned != before else []


def begins_in_s(game: RoundController, now: float) -> float | None:
    """Return the time, s, until the start show is over, or None without a start show."""
    due_s = game._deadline_s
    return None if game.state != "starting" or due_s is None else max(0.0, due_s - now)


def awaits_pellets(game: RoundController, now: float) -> bool:
    """Return True if the start show is over but the round cannot begin, because it has no pellets yet."""
    due_s = game._deadline_s
    return game.state == "starting" and due_s is not None and now >= due_s and game.spawned == 0
