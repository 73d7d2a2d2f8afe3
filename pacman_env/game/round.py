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
    """A consequence, to be performed in order; the value of ``ignored`` tells why an input had no effect."""

    #: command, event, state, result, score, round, spawned, collected, ghosts_caught, clyde_speed,
    #: pellets (the remaining pellets have changed), reset_clyde
    kind: str
    value: str | int | float | None = None


_KEPT = (  # copied to snapshots
    *("state", "score", "round", "result", "base_speed_mps", "after_home", "home_failures"),
    *("ghosts_caught", "streak"),
)
_RESETS = (Action("pellets"), Action("reset_clyde"))


def clyde_speed_mps(base: float, step: float, round: int) -> float:
    """Return Clyde's speed in a round, counted from 1 (Milestone 3, Algorithm 5)."""
    return base + (round - 1) * step


_Count = Annotated[int, Meta(ge=0, lt=10**9)]


class Snapshot(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A saved game; ``collected`` and ``left`` contain ids of pellets."""

    state: Literal["menu", "returning_home", "starting", "running", "dying"]
    score: _Count
    round: Annotated[int, Meta(ge=1, lt=10**9)]
    result: Annotated[str, Meta(max_length=200)]
    base_speed_mps: Annotated[float, Meta(ge=1e-6, le=1e6)]
    collected: set[_Count]
    left: set[_Count]
    due_in_s: Annotated[float, Meta(ge=0, le=1e6)] | None
    after_home: _AfterHome
    home_failures: _Count
    ghosts_caught: _Count = 0
    streak: _Count = 0


@dataclass
class RoundController:
    """State, score and round of the game; every input returns the actions that it causes.

    It owns the pellets of the round: ``lay_out`` gives it the map's. The score counts pellets and caught ghosts over
    the whole game. A completed round keeps it and increases round number and Clyde's speed; death and ``reset`` set all
    back. Inputs that do not fit the state change nothing and are ``ignored``.
    """

    clyde: ClydeConfig = field(default_factory=ClydeConfig)
    show: ShowConfig = field(default_factory=ShowConfig)
    power: PowerConfig = field(default_factory=PowerConfig)

    state: State = field(default="menu", init=False)
    score: int = field(default=0, init=False)
    round: int = field(default=1, init=False)
    result: str = field(default="", init=False)
    base_speed_mps: float = field(init=False)
    pellets: frozenset[int] = field(default=frozenset(), init=False)  # ids of all pellets of a round
    power_pellets: frozenset[int] = field(default=frozenset(), init=False)
    left: set[int] = field(default_factory=set, init=False)
    taken: set[int] = field(default_factory=set, init=False)  # collected in this round
    _deadline_s: float | None = field(default=None, init=False)  # next time at which ``tick`` acts
    after_home: _AfterHome = field(default="start", init=False)
    home_failures: int = field(default=0, init=False)
    ghosts_caught: int = field(default=0, init=False)  # in this round
    streak: int = field(default=0, init=False)  # ghosts caught since the last power pellet

    def __post_init__(self) -> None:
        self.base_speed_mps = self.clyde.speed_mps

    @property
    def collected(self) -> int:
        return len(self.taken)

    @property
    def spawned(self) -> int:
        return len(self.pellets)

    @property
    def clyde_speed(self) -> float:
        return clyde_speed_mps(self.base_speed_mps, self.clyde.speed_step_mps, self.round)

    def lay_out(self, pellets: Iterable[int], power: Iterable[int] = ()) -> None:
        """Set the ids of the pellets of this and all later rounds, and which of them are ``power`` pellets."""
        self.pellets, self.power_pellets = frozenset(pellets), frozenset(power)
        self.left, self.taken = set(self.pellets), set()

    def announce(self) -> list[Action]:
        """Return all latched values and the command of the present state, for a process that has just started."""
        commands = {"running": "enable", "returning_home": "return_home" if self._deadline_s is None else "disable"}
        return [Action("command", commands.get(self.state, "disable")), *self._latched()]

    def snapshot(self, now: float) -> dict[str, Any]:
        """Return everything that ``restore`` needs as JSON values; times are relative to ``now``, s."""
        return {
            **{name: getattr(self, name) for name in _KEPT},
            "collected": sorted(self.taken),
            "left": sorted(self.left),
            "due_in_s": None if self._deadline_s is None else max(0.0, self._deadline_s - now),
        }

    def restore(self, values: Mapping[str, Any], now: float) -> list[Action]:
        """Resume from a snapshot and return the actions to announce it; a round that has not begun is reset.

        Raises ValueError for an invalid snapshot, and for pellets that were not laid out.
        """
        saved: Snapshot = convert(values, Snapshot, "snapshot")
        state, due_s = saved.state, saved.due_in_s
        timed = state == "returning_home" or (due_s is not None) == (state in ("starting", "dying"))
        require(timed, "snapshot.due_in_s", due_s, f"does not fit state {state!r}")
        for name in ("collected", "left"):
            ids = getattr(saved, name)
            require(ids <= self.pellets, f"snapshot.{name}", sorted(ids), "must be pellets of this map")
        require(not saved.left & saved.collected, "snapshot.left", sorted(saved.left), "must not be collected")
        for name in _KEPT:
            setattr(self, name, getattr(saved, name))
        self.left, self.taken = saved.left, saved.collected
        self._deadline_s = None if due_s is None else now + due_s
        before_round = state == "starting" or (state == "returning_home" and self.after_home == "start")
        return [*self.announce(), *(_RESETS if before_round else ())]

    def start(self, now: float) -> list[Action]:
        if self.state != "menu":
            return [Action("ignored", f"start: the game is in state {self.state!r}")]
        if not self.pellets:
            return [Action("ignored", "start: the map has no pellets")]
        self.result = ""
        return [*self._reset_round(), *self._go_home("start")]

    def reset(self, now: float) -> list[Action]:
        """Abort the game: back to the menu with score 0 and round 1."""
        self.result, self.after_home = "", "game_over"
        return self._arrive()

    def remove(self, pellet: int) -> list[Action]:
        """Remove a pellet that is collected, or lost: then it never counts."""
        if pellet not in self.pellets:
            return [Action("ignored", f"pellet {pellet} is not one of this map's {len(self.pellets)}")]
        if pellet not in self.left:
            return []
        self.left.discard(pellet)
        return [Action("pellets")]

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
        if self._deadline_s is None or now < self._deadline_s:
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
        self.left, self.taken = set(self.pellets), set()
        self.ghosts_caught = self.streak = 0
        self._deadline_s = None
        words = [Action("command", "disable"), Action("command", "reset_round"), Action("event", "reset")]
        return [*words, *_RESETS, *self._latched()]

    def _go_home(self, then: _AfterHome) -> list[Action]:
        self.after_home = then
        self.home_failures = 0
        return [Action("command", "return_home"), self._enter("returning_home")]

    def _arrive(self) -> list[Action]:
        self.round += self.after_home == "next_round"
        if self.after_home == "game_over":
            self.score, self.round = 0, 1
        return self._reset_round()

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
        if pellet in self.taken:
            return [Action("ignored", f"pellet {pellet} was counted before")]
        if pellet not in self.pellets:
            return [Action("ignored", f"pellet {pellet} is not in this round")]
        self.taken.add(pellet)
        is_power = pellet in self.power_pellets
        points, self.streak = score_pellet(self.streak, is_power, self.power.pellet_points)
        self.score += points
        event = "power pellet" if is_power else "pellet"
        counts = [Action("collected", self.collected), Action("score", self.score), Action("event", event)]
        end = self._complete() if round_complete(self.collected, self.spawned) else []
        return [*self.remove(pellet), *counts, *end]

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


def begins_in_s(game: RoundController, now: float) -> float | None:
    """Return the time, s, until the start show is over, or None without a start show."""
    due_s = game._deadline_s
    return None if game.state != "starting" or due_s is None else max(0.0, due_s - now)
