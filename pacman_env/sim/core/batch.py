"""Simulate N independent games; game i is bit-identical to the same game alone with the same seed."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...config import MAX_SPEED_MPS, Config, ConfigError
from ...engine.arrays import Table, zeros
from ...engine.pipeline import Stage
from ...engine.threads import Threads
from ...game.ends import COMPLETE
from ...game.round import clyde_speed_mps
from ...world.navigation.planner import detour_memory
from ..maps.assets import MapAssets
from ..maps.level_source import FixedMap, LevelSource
from ..observation import situation_kernel
from ..observation.situation import Situation
from . import kernels, ticks
from .ghost_state import GHOST_CHOICE, spawn_ghost
from .parameters import (
    GAME,
    KEPT_FROM_ROUND_TO_ROUND,
    batch_parameters,
    draw_episodes,
    fright_steps,
    next_seeds,
    reward_record,
)
from .state import GameLevels, GameState, History, RoundSoFar

ALL_TICKS = 2**62


class GameBatch(GameState):
    """N games under one configuration, on one shared map or on a separate map for each game.

    Arrays have one row per game, (N, ...); indices, seeds and levels of selected games have shape (M,). Candidates are
    ``pellet_slots`` pellets, ``refuge_slots`` refuges and hold, in this order; slots that the map does not use are
    padding.
    """

    def __init__(self, source: LevelSource | MapAssets, config: Config, n: int = 1, num_threads: int = 1) -> None:
        """Create the state and physics of ``n`` games; call :meth:`reset` before the first step.

        Raises ConfigError if the map has more than ``config.max_pellets`` pellets, and MapError if no map is playable.
        """
        self.source = source = FixedMap(source, config) if isinstance(source, MapAssets) else source
        most = source.most(config)
        slots = most.pellets if config.max_pellets is None else config.max_pellets
        if slots < source.first.pellets:
            raise ConfigError(f"max_pellets = {slots}: the map has {source.first.pellets} pellets")
        super().__init__(n, config, slots, most.refuges)
        self.threads = Threads(num_threads)
        if self.threads.number > n:  # more threads would only idle, and each needs scratch memory
            self.threads = Threads(n)
        self._levels = GameLevels(source, config, n, self.threads)
        self.levels, self.spaces = self._levels.levels, self._levels.spaces
        self._history = History(n, self.ghosts.shape[1], bool(self._ghosts.sent_from_outside.any()), config)
        self._parameters = batch_parameters(config, source.first.grid.resolution, self.pellet_slots, self.refuge_slots)
        self._rewards = reward_record(config.reward, config.decisions.discount_per_s**config.execution.tick_s)
        self._controls = np.zeros(1, dtype=ticks.CONTROL)
        #: A view (1,) of each field: writes through the record are slow, which a step of a single game shows.
        self._control = {name: self._controls[name] for name in ticks.CONTROL.names or ()}
        self._tables: list[Table] = []  # a table for each thread
        self._ghost_tables: list[Table] = []
        self._longest = 1 + max(int(self._parameters[0][name]) for name in ("longest", "threat_longest"))
        #: Called after each physics step, if not None.
        self.after_physics_step: Callable[[], None] | None = None
        #: Increases when arrays that stages use are replaced: pipelines with these stages must be rebuilt then.
        self.revision = 0
        self._awake = self.arrays["last_decision"]["awake"]
        self._ghosts.bind(self.levels, self.hold)
        shared = {"obstacles": self.obstacles, "parameters": self._parameters, "levels": self.levels.addresses}
        self._rules = kernels.RuleArrays(**self.rules, **shared)
        self._view: Stage | None = None  # writes the requested situations

    @property
    def assets(self) -> MapAssets:
        """Map of the games; one of the maps if there are many."""
        return self.source.first

    def assets_of(self, game: int) -> MapAssets:
        """Return the map that a game is played on."""
        return self._levels.assets_of(game)

    def level_numbers(self) -> NDArray[np.int64]:
        """Return the level number of each game, (N,)."""
        return self.levels.numbers[self.games["level"]]

    def expect(self, seeds: NDArray[np.uint64]) -> None:
        """Announce the seeds of the next episodes, so that other threads prepare their levels during play."""
        self._levels.expect(seeds)

    def __getstate__(self) -> dict[str, Any]:
        """Return the start of each game's round and all decisions since."""
        levels = self.level_numbers()
        started = [i for i in range(self.n) if self._levels.slots[i] >= 0]
        rounds = [self._history.so_far(i, int(self.games["tick"][i]), int(levels[i])) for i in started]
        made_from = self.source, self.config, self.n, self.threads.number
        return {"made_from": made_from, "rounds": rounds}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Replay every round, so that the copy is identical, the physics solver's contact memory included."""
        self.__init__(*state["made_from"])  # type: ignore[misc]
        self._replay(state["rounds"])
        if state["rounds"]:
            self.situation()  # fills ``summary``

    def _replay(self, rounds: list[RoundSoFar]) -> None:
        """Replay these rounds in their games from the start to the present; the other games stand still.

        Chipmunk's contact memory results from all previous steps and cannot be copied.
        """
        longest = max((len(r.decisions) for r in rounds), default=0)
        still = np.zeros(2) if self.config.action == "velocity" else np.int64(self.hold)
        actions = np.stack([still] * self.n)
        choices = np.zeros(self.ghosts.shape, dtype=GHOST_CHOICE)
        awake = np.full(self.n, ticks.ASLEEP, dtype=self._awake.dtype)
        for tick in range(longest + 1):
            # Shorter rounds start later, so that all end together.
            begin = [r for r in rounds if longest - len(r.decisions) == tick]
            if begin:
                index = np.array([r.game for r in begin])
                awake[index] = ticks.ONE_TICK
                if len(self.levels) > 1:
                    self._levels.change(index, np.array([r.level for r in begin]))
                began = np.array([r.began for r in begin], dtype=GAME)
                self._start(index, np.ascontiguousarray(began["seed"]), began)
            for r in rounds:
                k = tick - (longest - len(r.decisions))
                if 0 <= k < len(r.decisions):
                    actions[r.game] = r.decisions[k]
                    if len(r.ghost_choices):
                        choices[r.game] = r.ghost_choices[k]
            if tick == longest:
                break
            self._set_actions(actions)
            self._ghosts.send(choices)
            self._awake[:] = awake
            self._advance()

    def reset(
        self, index: NDArray[np.int64], seeds: NDArray[np.uint64], levels: NDArray[np.int64] | None = None
    ) -> None:
        """Start a new episode with its own seed in each of the games ``index`` (M,).

        The seed decides the episode's parameters, the ghosts and, unless ``levels`` (M,) is given, the map. Raises
        MapError, without any change, if a map is not playable.
        """
        index = np.asarray(index, dtype=np.int64)
        seeds = np.asarray(seeds, dtype=np.uint64)
        fresh = draw_episodes(seeds, self.config)
        if len(self.levels) > 1:
            self._levels.change(index, self.source.levels_of(seeds) if levels is None else levels)
        self._start(index, seeds, fresh)

    def _start(self, index: NDArray[np.int64], seeds: NDArray[np.uint64], fresh: NDArray[Any]) -> None:
        """Start rounds in the games ``index`` (M,) from the records ``fresh`` (M,)."""
        self._history.begin(index, seeds, fresh)
        self._levels.enter(index, fresh)
        ghosts, levels = self._ghosts, self.levels.addresses
        kernels.reset_robots(self.games, index, seeds, fresh, levels)
        self.alive[index] = np.arange(self.pellet_slots) < self.games["pellets"][index, None]
        self.rules["waits"][index] = self.rules["aborts"][index] = 0
        use_tf = int(self._parameters["use_tf"][0])
        kernels.reset_ghosts(
            self.games, index, ghosts.state, ghosts.paths, ghosts.obstacles, ghosts.wander_first, levels, use_tf
        )

    def _follow_completed_rounds(self) -> None:
        """Start another round with faster ghosts after each completed round of an endless game."""
        if not self.config.endless:
            return
        index = np.flatnonzero(self.games["end"] == COMPLETE)
        if len(index) == 0:
            return
        self.terminated[index] = False
        completed, tick_s = self.games[index], self.config.execution.tick_s
        self.completed_s[index] = (completed["tick"] - 1) * tick_s + tick_s
        fresh = np.zeros(len(index), dtype=GAME)
        for name in KEPT_FROM_ROUND_TO_ROUND:
            fresh[name] = completed[name]
        fresh["round"] += 1
        fresh["tick_rounds"] = 1
        faster = self.config.clyde.speed_step_mps
        speeds = [clyde_speed_mps(g["base_clyde_speed"], faster, g["round"]) for g in fresh]
        fresh["clyde_speed"] = np.minimum(speeds, MAX_SPEED_MPS)
        fresh["fright_time"] = [fright_steps(self.config, number) for number in fresh["round"].tolist()]
        self._start(index, next_seeds(completed["seed"]), fresh)

    def step(
        self,
        actions: NDArray[Any],
        ghost_choices: NDArray[Any] | None = None,
        played: NDArray[np.bool_] | None = None,
    ) -> None:
        """Play one tick with its physics steps; games that have ended stand still.

        The results are in ``reward``, ``terminated`` and ``truncated`` (N,).

        Args:
            actions: (N,) int64 candidates (a forbidden one makes the robot hold), or with velocity actions (N, 2)
                float64, v in m/s and omega in rad/s.
            ghost_choices: (N, G) for ghosts that a policy controls: int64 candidates to go to (the last one: wander),
                or records of type ``ghosts.GHOST_CHOICE``. None: all wander.
            played: (N,) mask of the games to step; None: all. The other games keep the results of their last tick.

        Raises ValueError, without any change, for an invalid action or choice.
        """
        self._set_actions(actions)
        self._ghosts.send(ghost_choices)
        if self.config.endless:
            self.completed_s.fill(0.0)
        self._awake.fill(ticks.ONE_TICK)
        if played is not None:
            self._awake[~played] = ticks.ASLEEP
        self._advance()
        self._follow_completed_rounds()

    def step_by_hand(self, velocities: NDArray[np.float64], ghost_choices: NDArray[Any] | None = None) -> None:
        """Play one tick in which the robots are driven by hand: goals are cancelled and Nav2 is idle.

        ``velocities`` (N, 2), v in m/s and omega in rad/s, are clipped to what the base can follow; ``ghost_choices``
        are as in :meth:`step`. Copies and pickles of the batch replay this tick as *hold*. Raises ValueError,
        without any change, for velocities that are not finite and for invalid choices.
        """
        if self.config.action == "velocity":
            raise ValueError("step_by_hand: the actions of these games are velocities anyway")
        if not np.isfinite(velocities).all():
            raise ValueError(f"velocities {velocities.tolist()}: must be finite numbers")
        self.arrays["velocities"][:] = velocities
        self._control["by_hand"][0] = 1
        try:
            self.step(np.full(self.n, self.hold, dtype=np.int64), ghost_choices)
        finally:
            self._control["by_hand"][0] = 0

    def step_until_due(
        self,
        actions: NDArray[Any],
        forbidden: NDArray[np.bool_],
        choose_for_ghosts: Callable[[], NDArray[Any] | None] | None = None,
        played: NDArray[np.bool_] | None = None,
    ) -> None:
        """Play each game until its next decision is due; games that wait for others stand still.

        After a ``forbidden`` (N,) choice, the next decision is due after one tick. ``reward`` is the discounted sum of
        the rewards of the ticks, ``elapsed_s`` the time since the decision. ``choose_for_ghosts`` is called before each
        tick. Only the games in the mask ``played`` (N,) are stepped (None: all). Raises ValueError like :meth:`step`.
        """
        self._set_actions(actions)
        self._ghosts.send(None)
        self._awake[:] = np.where(forbidden, ticks.ONE_TICK, ticks.UNTIL_DUE)
        if played is not None:
            self._awake[~played] = ticks.ASLEEP
        self.completed_s.fill(0.0)
        by_ticks = choose_for_ghosts is not None or self.after_physics_step is not None
        fresh = True
        while True:
            if choose_for_ghosts is not None:
                self._ghosts.send(choose_for_ghosts())
            self._advance(watch=True, most=1 if by_ticks else ALL_TICKS, fresh=fresh)
            self._follow_completed_rounds()
            fresh = False
            if not self._awake.any():
                break

    def _advance(self, *, watch: bool = False, most: int = 1, fresh: bool = True) -> None:
        """Play ticks with the options of :meth:`prepare_ticks`; each game stops after a completed round."""
        self.prepare_ticks(watch=watch, most=most, fresh=fresh)
        if self.after_physics_step is not None:
            for step in range(1, self.substeps + 1):
                self._control["until"][0] = step
                self._play(resume=step > 1)
                self.after_physics_step()
        self._control["until"][0] = self.substeps + 1
        self._play(resume=self.after_physics_step is not None)

    def _play(self, *, resume: bool) -> None:
        """Advance all games, and create physics spaces for robots that come near a wall."""
        self._control["resume"][0] = resume
        job, tables = self.tick_stage()
        self.resume(self.threads.run(job, tables, self.n))

    def tick_stage(self) -> Stage:
        """Return the stage that plays the games after :meth:`prepare_ticks`; pass its result to :meth:`resume`."""
        while len(self._tables) < self.threads.number:
            self._ghost_tables.append(self._ghosts.table(self.games, self._history.ghost_choices, self._parameters))
            self._tables.append(_tick_table(self, self._ghost_tables[-1]))
        return ticks.play, self._tables

    def resume(self, waiting: int) -> None:
        """Continue until no game waits for a physics space; ``waiting`` is the result of the tick stage.

        Raises the exception of a ghost's behaviour, if any.
        """
        while waiting:
            if waiting < 0:
                self.games["stage"] = ticks.BEGIN
                self._ghosts.raise_error_of(self._ghost_tables[0].address, -1 - waiting)
            for i in np.flatnonzero(self.games["stage"] == ticks.MOVE).tolist():
                self.spaces.provide(self._levels.slots[i], self._levels.walls_of(i))
            self._control["resume"][0] = 1
            waiting = self.threads.run(ticks.play, self._tables, self.n)

    def begin_decisions(self) -> None:
        """Wake all games for one tick, which a choice stage may extend; ghosts that a policy controls wander."""
        self._awake.fill(ticks.ONE_TICK)
        self._ghosts.send(None)

    def prepare_ticks(self, *, watch: bool = False, most: int = 1, fresh: bool = True) -> None:
        """Set the options of the next call of the tick stage, which plays at most ``most`` ticks of each game.

        With ``watch``, a game stops when its next decision is due; with ``fresh``, a new decision begins.
        """
        if self._history.make_room(self.games, 1 if most == 1 else self._longest):
            self._discard_tables()
        control = self._control
        control["fresh"][0], control["watch"][0], control["ticks"][0] = fresh, watch, most
        control["until"][0], control["resume"][0] = self.substeps + 1, 0

    def _discard_tables(self) -> None:
        self._tables, self._ghost_tables = [], []
        self.revision += 1

    def _set_actions(self, actions: NDArray[Any]) -> None:
        if self.config.action == "velocity":
            for game in np.flatnonzero(~np.isfinite(actions).all(axis=1))[:1]:
                raise ValueError(f"action {actions[game].tolist()} of game {game}: must be two finite numbers")
            self.arrays["velocities"][:] = actions
            return
        bad = np.flatnonzero((actions < 0) | (actions > self.hold))
        if len(bad):
            raise ValueError(f"choice {actions[bad[0]]} of game {bad[0]}: candidates are 0 to {self.hold}")
        self.arrays["choices"][:] = actions

    def place_ghost(self, game: int, number: int, x: float, y: float) -> tuple[float, float]:
        """Move a ghost to its cell nearest to (x, y), m, and return the position of that cell."""
        cells = self.assets_of(game).clyde.position
        cell, _ = self.assets_of(game).clyde.nearest(x, y)
        spawn_ghost(self.ghosts[game, number], cell, self._ghosts.paths[game, number], cells)
        kernels.see_ghosts(self.games[game], self.ghosts[game], self.obstacles[game])
        return float(cells[cell, 0]), float(cells[cell, 1])

    def situation(self, player: int = -1) -> Situation:
        """Return the current situation of the robot's policy, or of the policy of ghost ``player``, in new arrays."""
        situation = Situation.empty(self.n, self.candidates, self.ghosts.shape[1], self.levels, self.threads)
        if self._view is None:
            self._view = situation_stage(self, situation, player)
        write, tables = self._view
        situation_kernel.direct(tables[0].arrays["request"], situation, player)
        self.threads.run(write, tables, self.n)
        return situation


def situation_stage(batch: GameBatch, situation: Situation, player: int = -1) -> Stage:
    """Return the stage that writes the situation of the robot (or of ghost ``player``) and ``batch.summary``."""
    request = np.zeros(1, dtype=situation_kernel.REQUEST)
    situation_kernel.direct(request, situation, player)
    table = Table(
        situation_kernel.ViewArrays,
        rules=batch._rules,
        ghosts=batch.ghosts,
        ghost_paths=batch.ghost_paths,
        request=request,
        summary=batch.summary,
    )
    return situation_kernel.write_situations, [table]


def choice_stage(
    batch: GameBatch, actions: NDArray[np.int64], mask: NDArray[np.bool_], listed: NDArray[np.int64]
) -> Stage:
    """Return the stage that converts ``actions`` (N,) to choices of candidates that ``mask`` (N, C) allows.

    ``listed`` (N, K) maps actions to candidates; with K = 0 actions are candidates. After a forbidden choice the next
    decision is due after one tick.
    """
    own = {name: batch.arrays[name] for name in ("last_decision", "choices")}
    return ticks.choose, [Table(ticks.ChoiceArrays, **own, actions=actions, mask=mask, listed=listed)]


def _tick_table(batch: GameBatch, ghosts: Table) -> Table:
    decisions = zeros(ticks.TickArrays, ("decisions", "driven"), N=batch.n, t=0)
    decisions["driven" if batch.config.action == "velocity" else "decisions"] = batch._history.decisions
    sizes = batch.levels.sizes
    search = detour_memory(sizes.cells, sizes.longest_cm, batch.source.first.grid.resolution)
    return Table(
        ticks.TickArrays,
        rules=batch._rules,
        spaces=ticks.SpaceArrays(*batch.spaces.arrays),
        search=search,
        ghosts=ghosts.numbers,
        rewards=batch._rewards,
        control=batch._controls,
        **decisions,
        **batch.arrays,
    )
