"""Simulate N independent games; game i is bit-identical to the same game alone with the same seed."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..config import MAX_SPEED_MPS, Config, ConfigError
from ..engine.arrays import Table
from ..engine.pipeline import Stage
from ..engine.threads import Threads
from ..game.ends import COMPLETE
from ..game.round import clyde_speed_mps
from ..levels.assets import MapAssets
from ..levels.level_source import FixedMap, LevelSource
from ..world.navigation.physics import Contacts
from ..world.navigation.planner import detour_memory
from . import kernels, parameters, ticks
from .game_levels import GameLevels
from .ghost_state import spawn_ghost
from .parameters import GAME, KEPT_FROM_ROUND_TO_ROUND, batch_parameters, draw_episodes, next_seeds, reward_record
from .state import GameState

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
        self.levels = self._levels.levels
        resolution = self.source.first.grid.resolution
        self._parameters = batch_parameters(config, resolution, self.pellet_slots, self.refuge_slots)
        self._rewards = reward_record(config.reward, config.decisions.discount_per_s**config.execution.tick_s)
        self._controls = np.zeros(1, dtype=ticks.CONTROL)
        #: A view (1,) of each field: writes through the record are slow, which a step of a single game shows.
        self._control = {name: self._controls[name] for name in ticks.CONTROL.names or ()}
        self._tables: list[Table] = []  # a table for each thread, and what it refers to by address
        self._kept: list[tuple[Table, Contacts]] = []
        self._ticks = self.arrays["last_decision"]["ticks"]
        self._ghosts.bind(self.levels, self.hold)
        shared = {"obstacles": self.obstacles, "parameters": self._parameters, "levels": self.levels.addresses}
        self.rule_arrays = kernels.RuleArrays(**self.rules, **shared)

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
        made_from = self.source, self.config, self.n, self.threads.number
        return {"made_from": made_from, "games": self.read_games(np.arange(self.n))}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__init__(*state["made_from"])  # type: ignore[misc]
        self.write_games(np.arange(self.n), state["games"])

    def copy_games(self, source: NDArray[np.int64], target: NDArray[np.int64], batch: GameBatch | None = None) -> None:
        """Copy the games ``source`` (M,) of ``batch`` (None: this one) to the different games ``target`` (M,).

        A copy continues like its source, bit for bit. A source may occur several times, and in ``target``, too. The
        other batch has the same level source, configuration and slots.
        """
        self.write_games(target, (batch or self).read_games(source))

    def read_games(self, index: NDArray[np.int64]) -> dict[str, NDArray[Any]]:
        """Return everything that decides how the games ``index`` (M,) continue: copies of arrays (M, ...) by name."""
        levels = np.where(self._levels.slots < 0, -1, self.level_numbers())  # -1 before the first round
        return {"level_numbers": levels[index], **{name: array[index] for name, array in self.state().items()}}

    def write_games(self, index: NDArray[np.int64], rows: Mapping[str, NDArray[Any]]) -> None:
        """Let the games ``index`` (M,) continue from ``rows``, a result of :meth:`read_games`."""
        self._levels.change(index, rows["level_numbers"])
        for name, array in self.state().items():
            array[index] = rows[name]
        self.games["level"][index] = np.maximum(self._levels.slots[index], 0)  # this batch has its own slots

    def compile_behaviours(self, indices: Collection[int]) -> None:
        """Compile behaviours by index in ``BEHAVIOUR_NAMES``, so that ``behaviour`` of a ghost may select them."""
        self._ghosts.compile_behaviours(indices)

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
        self._levels.change(index, self.source.levels_of(seeds) if levels is None else levels)
        self._start(index, seeds, fresh)

    def _start(self, index: NDArray[np.int64], seeds: NDArray[np.uint64], fresh: NDArray[Any]) -> None:
        """Start rounds in the games ``index`` (M,) from the records ``fresh`` (M,)."""
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
        fresh["fright_time"] = [parameters.fright_steps(self.config, number) for number in fresh["round"].tolist()]
        self._start(index, next_seeds(completed["seed"]), fresh)

    def step(
        self, actions: NDArray[Any], ghost_choices: NDArray[Any] | None = None, played: NDArray[np.bool_] | None = None
    ) -> None:
        """Play one tick with its physics steps; games that have ended stand still.

        The results are in ``reward``, ``terminated`` and ``truncated`` (N,).

        Args:
            actions: (N,) int64 candidates (a forbidden one makes the robot hold), or with velocity actions (N, 2)
                float64, v in m/s and omega in rad/s.
            ghost_choices: (N, G) for ghosts that a policy controls: int64 candidates to go to (the last one: wander),
                or records of type ``ghost_state.GHOST_CHOICE``. None: all wander.
            played: (N,) mask of the games to step; None: all. The other games keep the results of their last tick.

        Raises ValueError, without any change, for an invalid action or choice.
        """
        self._set_actions(actions)
        self._ghosts.send(ghost_choices)
        self.completed_s.fill(0.0)
        self.begin_decisions(1, played)
        self._play()
        self._follow_completed_rounds()

    def step_by_hand(self, velocities: NDArray[np.float64], ghost_choices: NDArray[Any] | None = None) -> None:
        """Play one tick in which the robots are driven by hand: goals are cancelled and Nav2 is idle.

        ``velocities`` (N, 2), v in m/s and omega in rad/s, are clipped to what the base can follow; ``ghost_choices``
        are as in :meth:`step`. Raises ValueError, without any change, for velocities that are not finite and for
        invalid choices.
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
        self.completed_s.fill(0.0)
        self.begin_decisions(ALL_TICKS, played)
        self._ticks[forbidden & (self._ticks > 0)] = 1
        if choose_for_ghosts is not None:
            self._control["ticks"][0] = 1
        while self._ticks.any():
            if choose_for_ghosts is not None:
                self._ghosts.send(choose_for_ghosts())
            self._play()
            self._control["fresh"][0] = 0
            self._follow_completed_rounds()

    def begin_decisions(self, most: int, played: NDArray[np.bool_] | None = None) -> None:
        """Wake the games in the mask ``played`` (N,) (None: all) for at most ``most`` ticks."""
        self._ticks.fill(most)
        if played is not None:
            self._ticks[~played] = 0
        control = self._control
        control["fresh"][0], control["ticks"][0] = 1, most

    def tick_stage(self) -> Stage:
        """Return the stage that plays the games after :meth:`begin_decisions`.

        If its result is negative, :meth:`raise_error_of_ghost` raises the exception of a ghost's behaviour.
        """
        while len(self._tables) < self.threads.number:
            ghosts = self._ghosts.table(self.games, self._parameters)
            body = {"radius_m": self.config.robot.radius_m, "mass_kg": self.config.robot.mass_kg}
            contacts = Contacts(**body, step_s=self.config.physics_step_s)
            self._kept.append((ghosts, contacts))
            self._tables.append(_tick_table(self, ghosts, contacts))
        return ticks.play, self._tables

    def _play(self) -> None:
        job, tables = self.tick_stage()
        result = self.threads.run(job, tables, self.n)
        if result < 0:
            self.raise_error_of_ghost(result)

    def raise_error_of_ghost(self, result: int) -> None:
        """Raise the exception of the ghost's behaviour that the tick stage reported by a negative ``result``."""
        self._ghosts.raise_error_of(self._kept[0][0].address, -1 - result)

    def _set_actions(self, actions: NDArray[Any]) -> None:
        if self.config.action == "velocity":
            for game in np.flatnonzero(~np.isfinite(actions).all(axis=1))[:1]:
                raise ValueError(f"action {actions[game].tolist()} of game {game}: must be two finite numbers")
            self.arrays["velocities"][:] = actions
            return
        for game in np.flatnonzero((actions < 0) | (actions > self.hold))[:1]:
            raise ValueError(f"choice {actions[game]} of game {game}: candidates are 0 to {self.hold}")
        self.arrays["choices"][:] = actions

    def place_ghost(self, game: int, number: int, x: float, y: float) -> tuple[float, float]:
        """Move a ghost to its cell nearest to (x, y), m, and return the position of that cell."""
        cells = self.assets_of(game).clyde.position
        cell, _ = self.assets_of(game).clyde.nearest(x, y)
        spawn_ghost(self.ghosts[game, number], cell, self._ghosts.paths[game, number], cells)
        kernels.see_ghosts(self.games[game], self.ghosts[game], self.obstacles[game])
        return float(cells[cell, 0]), float(cells[cell, 1])


def choice_stage(
    batch: GameBatch, actions: NDArray[np.int64], mask: NDArray[np.bool_], listed: NDArray[np.int64]
) -> Stage:
    """Return the stage that converts ``actions`` (N,) to choices of candidates that ``mask`` (N, C) allows.

    ``listed`` (N, K) maps actions to candidates; with K = 0 actions are candidates. After a forbidden choice the next
    decision is due after one tick.
    """
    own = {name: batch.arrays[name] for name in ("last_decision", "choices")}
    return ticks.choose, [Table(ticks.ChoiceArrays, **own, actions=actions, mask=mask, listed=listed)]


def _tick_table(batch: GameBatch, ghosts: Table, contacts: Contacts) -> Table:
    sizes = batch.levels.sizes
    search = detour_memory(sizes.cells, sizes.longest_cm, batch.source.first.grid.resolution)
    return Table(
        ticks.TickArrays,
        rules=batch.rule_arrays,
        search=search,
        ghosts=ghosts.numbers,
        solver=contacts.solver,
        rewards=batch._rewards,
        control=batch._controls,
        **batch.arrays,
    )
