"""The two sides of one game, fed with the same events: the simulator's kernels, the goal executor with the referee."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pacman_env.config import Config
from pacman_env.engine.arrays import Table, declared, zeros
from pacman_env.game.ends import CAUGHT, CLEARED, COMPLETE, RUNNING
from pacman_env.game.execution import ABORTED, CANCELED, NO_CHOICE, REJECTED, SUCCEEDED
from pacman_env.game.goal_executor import GoalExecutor
from pacman_env.game.goals import ExecutorAction, Goals, Place, home_place
from pacman_env.game.power import choose_power_pellets
from pacman_env.game.round import RoundController
from pacman_env.levels.level import LevelArrays
from pacman_env.sim import kernels
from pacman_env.sim.parameters import batch_parameters, draw_episodes
from pacman_env.world.navigation import navigator

Position = tuple[float, float]
HOME = (-50.0, -50.0)


def level_of_goals(goal_xy: NDArray[np.float64], power: NDArray[np.bool_]) -> Table:
    """Make a level with goals at ``goal_xy`` (G, 2), m, and a mask (G,) of power pellets; other arrays are zeros."""
    lengths = {axis: 1 for array in declared(LevelArrays).values() for axis in array.axes if isinstance(axis, str)}
    lengths["G"] = len(goal_xy)
    return Table(
        LevelArrays, **{**zeros(LevelArrays, LevelArrays._fields, **lengths), "goal_xy": goal_xy, "power": power}
    )


class SimulatorSide:
    """One game of the simulator whose robot is put where the events say, and whose Nav2 answers as they say."""

    def __init__(self, config: Config, pellets: NDArray[np.float64], refuges: NDArray[np.float64]) -> None:
        power = np.zeros(len(pellets) + len(refuges), np.bool_)
        power[: len(pellets)] = choose_power_pellets(pellets, HOME, config.power.pellets)
        self.power = np.flatnonzero(power).tolist()
        self.level = level_of_goals(np.concatenate([pellets, refuges]), power)
        self.pellets, self.hold = len(pellets), len(pellets) + len(refuges)
        self.p = batch_parameters(config, 0.05, len(pellets), len(refuges))
        self.game = draw_episodes(np.array([1], dtype=np.uint64), config)
        self.score = 0
        self.step_s = config.physics_step_s
        self.alive = np.ones((1, len(pellets)), np.bool_)
        self.waits = np.zeros((1, self.hold + 1), np.int64)
        self.aborts = np.zeros((1, self.hold + 1), np.int64)
        self.obstacles = np.array([[[99.0, 99.0, 0.0, 0.0, 0.0]]])
        levels = np.array([self.level.address])
        self.rules = kernels.RuleArrays(self.game, self.alive, self.waits, self.aborts, self.obstacles, self.p, levels)
        self.began = self.game.copy()
        self.reset()

    def reset(self) -> None:
        self.score = int(self.game["score"][0]) if self.game["end"][0] in (COMPLETE, CLEARED) else 0
        self.game[:] = self.began
        for name in ("nav_goal", "nav_next", "pursued"):
            self.game[name] = NO_CHOICE
        self.game["pellets"] = self.game["spawned"] = self.pellets
        self.game["refuges"], self.game["score"] = self.hold - self.pellets, self.score
        self.alive[:], self.waits[:], self.aborts[:] = True, 0, 0
        self.obstacles[0, 0, 3:] = 0.0

    def at(self, step: int, pose: Position, ghost: Position = (99.0, 99.0)) -> None:
        self.game["step"], self.game["x"], self.game["y"] = step, *pose
        self.game["amcl_x"], self.game["amcl_y"] = pose
        self.obstacles[0, 0, :2] = ghost

    def choose(self, candidate: int) -> None:
        if self.game["end"][0] == RUNNING:
            kernels.decide(self.rules, 0, candidate)

    def accept(self) -> None:
        """The waiting goal becomes the one driven to."""
        if self.game["nav_next"][0] >= 0:
            self.game["nav_goal"], self.game["nav_next"] = self.game["nav_next"], -1
            self.game["nav_state"] = navigator.ACTIVE

    def pre_empt(self) -> None:
        """A goal that is cancelled as soon as it is accepted has ended the one driven to."""
        self.game["nav_state"], self.game["nav_goal"] = navigator.IDLE, -1

    def result(self, status: int) -> None:
        """Of the goal driven to, or of one that was not accepted."""
        if status == REJECTED:
            self.game["nav_next"] = -1
        else:
            self.game["nav_state"], self.game["nav_goal"] = navigator.IDLE, -1
        self.game["nav_result"] = status
        kernels.apply_result(self.rules, 0)

    def check(self) -> None:
        if self.game["end"][0] == RUNNING:
            for axis in "xy":
                self.game[f"body_{axis}"] = self.game[axis]
            kernels.observe(self.rules, 0)

    def seen(self) -> dict[str, Any]:
        """What has to be the same on both sides."""
        g, step = self.game[0], int(self.game["step"][0])
        running = int(g["end"]) == RUNNING
        driven = int(g["nav_next"]) if g["nav_next"] >= 0 else int(g["nav_goal"])
        return {
            "end": int(g["end"]),
            "left": np.flatnonzero(self.alive[0]).tolist(),
            "score": int(g["score"]),
            "ghosts caught": int(g["caught"]) if running else 0,
            "harmless": max(float(self.obstacles[0, 0, 3]) - step, 0.0) * self.step_s if running else 0.0,
            "pursued": int(g["pursued"]) if running else NO_CHOICE,
            "goal": driven if running else NO_CHOICE,
            "masked": np.flatnonzero(self.waits[0] > step).tolist() if running else [],
        }


@dataclass
class RobotSide:
    """The goal executor and the referee, joined by their messages, and a Nav2 that answers when it is told to."""

    config: Config
    pellets: NDArray[np.float64]
    refuges: NDArray[np.float64]
    power: Sequence[int] = ()  # numbers of the power pellets
    now: float = 0.0
    sent: dict[int, int] = field(default_factory=dict)  # candidate by the number of the goal
    live: list[int] = field(default_factory=list)  # goals that Nav2 has not ended
    unanswered: list[int] = field(default_factory=list)  # those of them that it has not accepted

    def __post_init__(self) -> None:
        self.begin()
        self.reset()

    def begin(self) -> None:
        """As a process that has just been started."""
        own = {number: (x, y) for number, (x, y) in enumerate(self.pellets.tolist())}
        goals = Goals(own, {}, self.refuges.tolist(), self.power)
        self.home = HOME
        self.executor = GoalExecutor(self.config, goals, home_place(*self.home, 0.0))
        self.referee = RoundController(self.config.clyde, power=self.config.power)
        self.referee.lay_out(own, self.power)
        self.executor.activate(0.0)
        self.executor.nav2(True, 0.0)
        self.end = RUNNING

    def reset(self) -> None:
        """From wherever the game is to the first moment of a round."""
        self._hear(self.referee.reset(self.now)) if self.end == RUNNING and self.referee.state == "running" else None
        for _ in range(6):
            if self.referee.state == "running":
                break
            self.now += self.referee.show.start_s + self.referee.show.death_s
            self._do(self.executor.check(self.home, (), self.now))
            for number in list(self.live):  # among them the way home
                self.finish(number, SUCCEEDED, self.home)
            self._hear(self.referee.tick(self.now))
            self._hear(self.referee.start(self.now)) if self.referee.state == "menu" else None
        assert self.referee.state == "running"
        self.report()
        self.end = RUNNING
        self.sent.clear()
        self.live.clear()
        self.unanswered.clear()

    def report(self) -> None:
        """The pellets that are left, as in each report of a foreign game."""
        self.executor.round.report(self.referee.left, 0)

    def choose(self, candidate: int) -> bool:
        """Whether the choice was acted on."""
        if not self.executor.wants_choice(self.now):
            return False
        place = None
        if candidate < len(self.pellets):
            place = Place(candidate, *self.pellets[candidate].tolist(), candidate)
        elif candidate < len(self.pellets) + len(self.refuges):
            place = Place(candidate, *self.refuges[candidate - len(self.pellets)].tolist(), None)
        self._do(self.executor.choose(place, self.now))
        return True

    def accept(self, number: int) -> None:
        """Nav2 takes a goal up, which ends those before it."""
        known = number in self.unanswered
        if known:
            self.unanswered.remove(number)
        self._do(self.executor.sent.accepted(number, self.now))
        for earlier in [n for n in self.live if known and n < number]:
            self.unanswered = [n for n in self.unanswered if n != earlier]
            self.finish(earlier, ABORTED, self.executor.pose or self.home)

    def reject(self, number: int) -> None:
        for known in (self.unanswered, self.live):
            if number in known:
                known.remove(number)
        self._do(self.executor.rejected(number, self.now))

    def finish(self, number: int, status: int, pose: Position) -> None:
        if number in self.live:
            self.live.remove(number)
        self._do(self.executor.finished(number, status, self.now, at=pose))

    def check(self, pose: Position, ghosts: list[Position]) -> None:
        self._do(self.executor.check(pose, ghosts, self.now))

    def look_at(self, pose: Position) -> None:
        """Move there, far from all ghosts and past no pellet."""
        self._do(self.executor.check(pose, (), self.now)) if pose == (1.0, 1.5) else None
        self.executor.pose = pose

    def let_go(self, number: int) -> bool:
        """Whether nobody wants a goal any more."""
        sent = self.executor.sent.open.get(number)
        return sent is None or sent.unwanted

    def gives_up(self) -> bool:
        """Whether the current goal has been without an answer for too long."""
        current = self.executor.sent.open.get(self.executor.sent.current or 0)
        return self.executor.playing and current is not None and current.unanswered(self.now)

    def driven(self) -> int | None:
        """The goal that Nav2 drives to: the last that it has accepted."""
        accepted = [number for number in self.live if number not in self.unanswered]
        return accepted[-1] if accepted else None

    def _do(self, actions: list[ExecutorAction]) -> None:
        for action in actions:
            if action.kind == "send":
                assert action.place is not None
                self.sent[int(action.value)] = action.place.candidate
                self.live.append(int(action.value))
                self.unanswered.append(int(action.value))
            elif action.kind == "cancel":
                number = int(action.value)
                for known in (self.live, self.unanswered):
                    if number in known:
                        known.remove(number)
                self._do(self.executor.finished(number, CANCELED, self.now))
            elif action.kind == "status":
                self._hear(self.referee.status(str(action.value), self.now))
            elif action.kind == "remove":
                self._hear(self.referee.remove(int(action.value)))

    def _hear(self, actions: list[Any]) -> None:
        for action in actions:
            if action.kind == "state":
                if action.value == "dying":
                    self.end, self.score = CAUGHT, self.referee.score
                elif action.value == "complete":
                    all_counted = self.referee.collected == len(self.pellets)  # else some were lost, as built
                    self.end, self.score = COMPLETE if all_counted else CLEARED, self.referee.score
                self._do(self.executor.state(str(action.value), self.now))
            elif action.kind == "command":
                self._do(self.executor.command(str(action.value), self.now))
            elif action.kind == "pellets":
                self.report()

    def seen(self) -> dict[str, Any]:
        """What has to be the same on both sides."""
        running = self.end == RUNNING
        wanted = [number for number in self.live if not self.let_go(number)]
        return {
            "end": self.end,
            "left": sorted(self.executor.round.left),
            "score": self.referee.score if running else self.score,
            "ghosts caught": self.referee.ghosts_caught if running else 0,
            "harmless": max(float(self.executor.round.ghosts[0, 3]) - self.now, 0.0) if running else 0.0,
            "pursued": self.executor.sent.pursued if running else NO_CHOICE,
            "goal": self.sent[wanted[-1]] if running and wanted else NO_CHOICE,
            "masked": sorted(self.executor.round.masked(self.now)) if running else [],
        }
