"""N independent games simulated at once.

There is no second, scalar implementation: one game is a batch of one. Seeds come in from outside; game i of a batch
is bit-identical to the same game alone with the same seed.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...config import MAX_SPEED_MPS, Config, ConfigError
from ...engine.bucket_queue import queue_arrays
from ...engine.native import Table
from ...engine.threads import Threads
from ...game.execution import COMPLETE, TIMEOUT
from ...game.last_decision import Moment
from ...game.round import clyde_speed_mps
from ...world.navigation.clear_cells import overlap_m
from ...world.navigation.physics import Spaces
from ...world.navigation.planner import PATH_POINTS, detour_memory
from ..maps.assets import MapAssets
from ..maps.level_source import FixedMap, LevelSource
from ..maps.level_stack import LevelStack
from ..maps.levels_ahead import LevelsAhead
from ..observation import situation_kernel
from ..observation.situation import Situation
from . import kernels, records, ticks
from .ghosts import BEHAVIOUR_NAMES, Ghosts, behaviour_choice
from .history import History, RoundSoFar
from .parameters import batch_parameters, draw_episodes, next_seeds, reward_record

_ALL_TICKS = 2**62
_MOST_AHEAD = 64  # levels, of some 4 MB each


class GameBatch:
    """N games under one configuration, on one map or each on a map of its own.

    Candidates are numbered: ``pellet_slots`` pellets, ``refuge_slots`` refuges (those beyond the map's are padding),
    hold.
    """

    def __init__(self, source: LevelSource | MapAssets, config: Config, n: int = 1, num_threads: int = 1) -> None:
        """Build the physics for ``n`` games; call :meth:`reset` before the first step.

        Raises:
            ConfigError: ``config.max_pellets`` is below the number of pellets on the map.
            MapError: the source has no map that can be played on.
        """
        self.source = source = FixedMap(source, config) if isinstance(source, MapAssets) else source
        slots = source.pellet_slots(config) if config.max_pellets is None else config.max_pellets
        first = source.first
        if slots < first.pellets:
            raise ConfigError(f"max_pellets = {slots}: the map has {first.pellets} pellets")
        self.config = config
        self.n = n
        self.threads = Threads(num_threads)
        if self.threads.number > n:  # the others would only wait, and each has scratch memory
            self.threads = Threads(n)
        self._ahead: LevelsAhead | None = None
        self.pellet_slots = slots
        self.refuge_slots = source.refuge_slots(config)
        self.hold = slots + self.refuge_slots
        self.candidates = self.hold + 1
        self.substeps = round(config.execution.tick_s / config.physics_step_s)
        self._ghosts = Ghosts(n, config)
        self.games = np.zeros(n, dtype=records.GAME)
        self.alive = np.zeros((n, slots), dtype=np.bool_)
        self._waits = np.zeros((n, self.candidates), dtype=np.int64)
        self._aborts = np.zeros((n, self.candidates), dtype=np.int64)
        self.paths = np.zeros((n, PATH_POINTS, 2), dtype=np.float32)
        self.levels = LevelStack(first, config, source.slots(n))
        self._held = [-1] * n  # the slot of each game's map
        robot = config.robot
        body = {"radius_m": robot.radius_m, "mass_kg": robot.mass_kg, "step_s": config.physics_step_s}
        self.spaces = Spaces(n, len(self.levels), **body)
        self._parameters = batch_parameters(config, self.levels.resolution, slots, self.refuge_slots)
        self._sends_ghosts = bool(self._ghosts.sent_from_outside.any())
        self._history = History(n, self.ghosts.shape[1], self._sends_ghosts, config)
        self._version = -1
        #: Called after each physics step, if it is set.
        self.after_physics_step: Callable[[], None] | None = None
        self._choices, self._velocities = np.zeros(n, dtype=np.int64), np.zeros((n, 2))
        self._velocity = config.action == "velocity"
        #: Whether features are written together with a situation, for whoever asks for them next.
        self.shows_features = False
        #: (len(SUMMARY), N) int64, written with each situation (``kernels.SUMMARY``).
        self.summary = np.zeros((len(kernels.SUMMARY), n), dtype=np.int64)
        self._request = np.zeros(1, dtype=situation_kernel.REQUEST)
        self._control = np.zeros(1, dtype=ticks.CONTROL)
        self._rewards = reward_record(config.reward, config.decisions.discount_per_s**config.execution.tick_s)
        self._awake = np.zeros(n, dtype=np.uint8)
        self._since = np.zeros(n, dtype=np.int32), np.zeros(n), np.zeros(n, dtype=np.int32)
        self.reward, self._factor, self.elapsed_s = np.zeros(n), np.zeros(n), np.zeros(n)
        self.terminated, self.truncated = np.zeros(n, dtype=np.bool_), np.zeros(n, dtype=np.bool_)
        self.completed_s = np.zeros(n)  # how long the round was that was followed by another in the last step
        self._longest = 1 + max(int(self._parameters[0][name]) for name in ("longest", "threat_longest"))
        self._no_choices, self._no_velocities = np.zeros((n, 0), dtype=np.int16), np.zeros((n, 0, 2))
        self._bind()

    @property
    def ghosts(self) -> NDArray[Any]:
        """(N, G) records of type ``GHOST``."""
        return self._ghosts.state

    @property
    def obstacles(self) -> NDArray[np.float64]:
        """(N, G, 3) where the ghosts are seen, m."""
        return self._ghosts.obstacles

    @property
    def assets(self) -> MapAssets:
        """The map; where there are many, one of them."""
        return self.source.first

    def assets_of(self, game: int) -> MapAssets:
        """The map that a game is played on."""
        slot = self._held[game]
        return self.source.first if slot < 0 else self.levels.assets(slot)

    def level_numbers(self) -> NDArray[np.int64]:
        """(N,) the number of the level that each game is played on."""
        return self.levels.numbers[self.games["level"]]

    def __getstate__(self) -> dict[str, Any]:
        """How each game's round began and what has been decided in it since."""
        levels = self.level_numbers()
        started = [i for i in range(self.n) if self._held[i] >= 0]
        rounds = [self._history.so_far(i, self.games[i], int(levels[i])) for i in started]
        made_from = self.source, self.config, self.n, self.threads.number
        return {"made_from": made_from, "rounds": rounds, "shows_features": self.shows_features}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Play every round again, so that the copy is the same down to the solver's memory of contacts."""
        self.__init__(*state["made_from"])  # type: ignore[misc]
        self.shows_features = state["shows_features"]
        rounds: list[RoundSoFar] = state["rounds"]
        longest = max((len(r.decisions) for r in rounds), default=0)
        self.games["end"][[r.game for r in rounds]] = TIMEOUT  # they stand still until they begin
        actions = np.zeros((self.n, 2)) if self._velocity else np.full(self.n, self.hold, dtype=np.int64)
        choices = np.full(self.ghosts.shape, self.hold, dtype=np.int64)
        for tick in range(longest + 1):
            # All arrive at their present together.
            begin = [r for r in rounds if longest - len(r.decisions) == tick]
            if begin:
                index = np.array([r.game for r in begin])
                if len(self.levels) > 1:
                    self._change_maps(index, np.array([r.level for r in begin]))
                seeds = np.array([r.seed for r in begin], dtype=np.uint64)
                self._start(index, seeds, np.array([r.began for r in begin], dtype=records.GAME))
            if tick == longest:
                break
            for r in rounds:
                k = tick - (longest - len(r.decisions))
                if k >= 0:
                    actions[r.game] = r.decisions[k]
                    if self._sends_ghosts:
                        choices[r.game] = r.ghost_choices[k]
            self._take_actions(actions)
            self._take_ghost_choices(choices)
            self._awake.fill(ticks.ONE_TICK)
            self._advance()
        if rounds:
            self.situation()  # which tells of the games

    def _bind(self) -> None:
        """Take over the stacked arrays, after they have been made anew, and make the scratch memory for them."""
        if self._version == self.levels.version:
            return
        self._version = self.levels.version
        a = self.levels.arrays
        self._ghosts.bind(self.levels, self.hold)
        self._starts = tuple(a[k] for k in ("home", "spawn_cells", "spawn_count", "ghost_xy"))
        self._look_table: Table | None = None
        self._tables: list[Table] = []
        self._ghost_tables: list[Table] = []

    def _table(self) -> None:
        """What :func:`ticks.play` works on, with scratch memory of its own: one for each thread."""
        a, history = self.levels.arrays, self._history
        ghosts = self._ghosts.table(self.games, history.ghost_choices, self._parameters)
        node, queue = detour_memory(a["cell_xy"].shape[1], self.levels.longest_way_cm, self.levels.resolution)
        remembered = {"decisions": history.decisions, "driven": self._no_velocities}
        if self._velocity:
            remembered = {"decisions": self._no_choices, "driven": history.decisions}
        table = Table(
            ticks.TickArrays,
            games=self.games,
            alive=self.alive,
            waits=self._waits,
            aborts=self._aborts,
            paths=self.paths,
            obstacles=self.obstacles,
            parameters=self._parameters,
            control=self._control,
            rewards=self._rewards,
            ghosts=ghosts.numbers,
            choices=self._choices,
            velocities=self._velocities,
            awake=self._awake,
            since_tick=self._since[0],
            since_distance=self._since[1],
            since_round=self._since[2],
            reward=self.reward,
            factor=self._factor,
            elapsed_s=self.elapsed_s,
            terminated=self.terminated,
            truncated=self.truncated,
            search_nodes=node,
            **queue_arrays(queue),
            **self.spaces.named,
            **remembered,
            **self.levels.arrays_for(ticks.TickArrays),
        )
        self._tables.append(table)
        self._ghost_tables.append(ghosts)

    def expect(self, seeds: NDArray[np.uint64]) -> None:
        """Episodes with these seeds come next: other threads prepare their levels while games are played."""
        levels = dict.fromkeys(self.source.levels_of(seeds).tolist())
        self._ask([level for level in levels if not self.levels.has(level)])

    def _ask(self, levels: list[int]) -> None:
        """Have levels prepared by other threads, if there are any."""
        if self._ahead is None and len(self.levels) > 1 and self.threads.number > 1:
            self._ahead = LevelsAhead(self.source, self.threads.number, min(self.n, _MOST_AHEAD))
        if self._ahead is not None:
            self._ahead.ask(levels)

    def reset(
        self, index: NDArray[np.int64], seeds: NDArray[np.uint64], levels: NDArray[np.int64] | None = None
    ) -> None:
        """Start a new episode with its own seed in each of the games ``index`` (M,).

        The seed decides everything that is drawn: the map where there are many and ``levels`` (M,) does not name it,
        the episode's parameters, the ghosts.

        Raises:
            MapError: a map cannot be played on; nothing has been changed then.
        """
        index = np.asarray(index, dtype=np.int64)
        seeds = np.asarray(seeds, dtype=np.uint64)
        fresh = draw_episodes(seeds, self.config)
        if len(self.levels) > 1:
            self._change_maps(index, self.source.levels_of(seeds) if levels is None else levels)
        self._start(index, seeds, fresh)

    def _change_maps(self, index: NDArray[np.int64], levels: NDArray[np.int64]) -> None:
        # All are prepared before the first is given up.
        missing = [level for level in dict.fromkeys(levels.tolist()) if not self.levels.has(level)]
        if len(missing) > 1:
            self._ask(missing)
        prepare = self.source.prepare if self._ahead is None else self._ahead.take
        prepared = {level: prepare(level) for level in missing}
        self.spaces.leave(index)
        for i in index.tolist():
            if self._held[i] >= 0:
                self.levels.give_back(self._held[i])
        for i, level in zip(index.tolist(), levels.tolist(), strict=True):
            known = self.levels.has(level)
            self._held[i] = self.levels.take(level, lambda number: prepared.get(number) or self.source.prepare(number))
            if not known:
                self.spaces.forget(self._held[i])
        self._bind()

    def _start(self, index: NDArray[np.int64], seeds: NDArray[np.uint64], fresh: NDArray[Any]) -> None:
        """Begin a round; ``fresh`` holds what goes on from the round before, or the episode's parameters."""
        self._history.began[index] = fresh
        for k, i in enumerate(index.tolist()):
            if self._held[i] < 0:
                self._held[i] = 0
            assets = self.levels.assets(self._held[i])
            fresh[k]["level"] = self._held[i]
            fresh[k]["pellets"], fresh[k]["refuges"] = assets.pellets, assets.refuges
        self.spaces.leave(index)
        kernels.reset_games(
            self.games,
            index,
            seeds,
            fresh,
            self.alive,
            self._waits,
            self._aborts,
            self.ghosts,
            self._ghosts.paths,
            self.obstacles,
            self._ghosts.wander_first,
            self._starts,
            self._parameters,
        )

    def _follow_completed_rounds(self) -> None:
        """In an endless game a completed round is followed by another with faster ghosts."""
        if not self.config.endless:
            return
        index = np.flatnonzero(self.games["end"] == COMPLETE)
        if len(index) == 0:
            return
        self.terminated[index] = False
        before, tick_s = self.games[index], self.config.execution.tick_s
        self.completed_s[index] = (before["tick"] - 1) * tick_s + tick_s
        fresh = np.zeros(len(index), dtype=records.GAME)
        for name in records.KEPT_FROM_ROUND_TO_ROUND:
            fresh[name] = before[name]
        fresh["round"] += 1
        fresh["tick_rounds"] = 1
        faster = self.config.clyde.speed_step_mps
        speeds = [clyde_speed_mps(g["base_clyde_speed"], faster, g["round"]) for g in fresh]
        fresh["clyde_speed"] = np.minimum(speeds, MAX_SPEED_MPS)
        self._start(index, next_seeds(before["seed"]), fresh)

    def step(
        self,
        actions: NDArray[Any],
        ghost_choices: NDArray[np.int64] | None = None,
        who: NDArray[np.bool_] | None = None,
    ) -> None:
        """One tick and the physics steps until the next; games that have ended stand still.

        ``reward``, ``terminated`` and ``truncated`` (N,) tell what came of it.

        Args:
            actions: (N,) int64 candidates, one that the mask forbids makes the robot hold; with velocity actions
                (N, 2) float64, v in m/s and omega in rad/s.
            ghost_choices: (N, G) int64, for ghosts told by a policy: the candidate whose place to go to, or the last
                one to wander on; None: all wander on.
            who: (N,) only these games are played; None: all. What the others' last tick brought stays as it is.

        Raises:
            ValueError: an action or a choice is none; nothing has been changed then.
        """
        self._take_actions(actions)
        self._take_ghost_choices(ghost_choices)
        if self.config.endless:
            self.completed_s.fill(0.0)
        self._awake.fill(ticks.ONE_TICK)
        if who is not None:
            self._awake[~who] = ticks.ASLEEP
        self._advance()
        self._follow_completed_rounds()

    def step_by_hand(self, velocities: NDArray[np.float64], ghost_choices: NDArray[np.int64] | None = None) -> None:
        """A tick in which somebody drives the robots: goals are given up, Nav2 has no part in it.

        A copy or a pickle of the batch does not know of it: that plays *hold* in its place.

        Args:
            velocities: (N, 2) v in m/s and omega in rad/s, cut to what the base can follow.
            ghost_choices: see :meth:`step`.

        Raises:
            ValueError: velocities that are not finite, or bad choices; nothing has been changed then.
        """
        if self._velocity:
            raise ValueError("step_by_hand: the actions of these games are velocities anyway")
        if not np.isfinite(velocities).all():
            raise ValueError(f"velocities {velocities.tolist()}: must be finite numbers")
        self._velocities[:] = velocities
        self._control["by_hand"] = 1
        try:
            self.step(np.full(self.n, self.hold, dtype=np.int64), ghost_choices)
        finally:
            self._control["by_hand"] = 0

    def step_until_due(
        self,
        actions: NDArray[Any],
        forbidden: NDArray[np.bool_],
        choose_for_ghosts: Callable[[], NDArray[np.int64] | None] | None = None,
        who: NDArray[np.bool_] | None = None,
    ) -> None:
        """Ticks in each game until the next decision is due in it; a game that waits for the others stands still.

        After a choice that is ``forbidden`` (N,), the next is due after a tick. ``reward`` is the sum of the ticks',
        discounted by the time since the decision, which is ``elapsed_s`` in the end. ``choose_for_ghosts`` is asked
        before each tick. Only the games ``who`` (N,) are played; None: all.

        Raises:
            ValueError: as in :meth:`step`.
        """
        self._take_actions(actions)
        self._take_ghost_choices(None)
        self._awake[:] = np.where(forbidden, ticks.ONE_TICK, ticks.UNTIL_DUE)
        if who is not None:
            self._awake[~who] = ticks.ASLEEP
        self.completed_s.fill(0.0)
        by_ticks = choose_for_ghosts is not None or self.after_physics_step is not None
        fresh = True
        while True:
            if choose_for_ghosts is not None:
                self._take_ghost_choices(choose_for_ghosts())
            self._advance(watch=True, most=1 if by_ticks else _ALL_TICKS, fresh=fresh)
            self._follow_completed_rounds()
            fresh = False
            if not self._awake.any():
                break

    def moment(self, game: int) -> Moment:
        """What :class:`~pacman_env.game.last_decision.LastDecision` has to know of one game now."""
        g, time_s = self.games[game], float(self.games["tick"][game]) * self.config.execution.tick_s
        return Moment(time_s, int(g["pursued"]), (int(g["round"]), int(g["collected"])), float(g["distance"]))

    def _advance(self, *, watch: bool = False, most: int = 1, fresh: bool = True) -> None:
        """Ticks, but for what follows a completed round."""
        if self._history.make_room(self.games, 1 if most == 1 else self._longest):
            self._tables.clear()
            self._ghost_tables.clear()
        control = self._control
        control["fresh"], control["watch"], control["ticks"] = fresh, watch, most
        if self.after_physics_step is not None:
            for step in range(1, self.substeps + 1):
                control["until"] = step
                self._play(resume=step > 1)
                self.after_physics_step()
        control["until"] = self.substeps + 1
        self._play(resume=self.after_physics_step is not None)

    def _play(self, resume: bool) -> None:
        """Let all games go on; those that come near a wall are given spaces."""
        self._control["resume"] = resume
        while len(self._tables) < self.threads.number:
            self._table()
        while waiting := self.threads.run(ticks.play, self._tables, self.n):
            if waiting < 0:
                self.games["stage"] = ticks.BEGIN
                self._ghosts.raise_again(self._ghost_tables[0].address, -1 - waiting)
            self._give_spaces()
            self._control["resume"] = 1

    def _give_spaces(self) -> None:
        """One for each game that waits for one."""
        for i in np.flatnonzero(self.games["stage"] == ticks.MOVE).tolist():
            self.spaces.provide(self._held[i], self.assets_of(i).grid.walls)

    def _take_actions(self, actions: NDArray[Any]) -> None:
        """Raises ValueError for one that is none."""
        if self._velocity:
            bad = np.flatnonzero(~np.isfinite(actions).all(axis=1))
            if len(bad):
                raise ValueError(f"action {actions[bad[0]].tolist()} of game {bad[0]}: must be two finite numbers")
            self._velocities[:] = actions
            return
        bad = kernels.take(actions, self.hold, self._choices)
        if bad >= 0:
            raise ValueError(f"choice {actions[bad]} of game {bad}: candidates are 0 to {self.hold}")

    def _take_ghost_choices(self, choices: NDArray[np.int64] | None) -> None:
        """Raises ValueError for one that is none."""
        if not self._sends_ghosts:
            return
        if choices is None:
            self._ghosts.choices[:] = self.hold
            return
        self._check_ghost_choices(choices)
        self._ghosts.choices[:] = choices
        self._ghosts.compile_choices()

    @property
    def bodies(self) -> NDArray[np.float64]:
        """(N, 4) where the robots' bodies are, m, and their velocities, m/s, after the last physics step."""
        return np.stack([self.games[name] for name in ("body_x", "body_y", "body_vx", "body_vy")], axis=1)

    def deepest_contact(self) -> float:
        """Depth of the deepest overlap of a robot with a wall now, m (0: none)."""
        radius, places = self.config.robot.radius_m, self.bodies[:, :2]
        near = np.flatnonzero(self.games["touch"] > 0).tolist()  # elsewhere no wall is within reach
        depths = (overlap_m(self.assets_of(i).grid.walls, places[i : i + 1], radius)[0] for i in near)
        return max([0.0, *map(float, depths)])

    def _check_ghost_choices(self, choices: NDArray[np.int64]) -> None:
        if choices.shape != self.ghosts.shape:
            raise ValueError(f"ghost choices of shape {choices.shape}: must be {self.ghosts.shape}")
        most = behaviour_choice(self.hold, len(BEHAVIOUR_NAMES) - 1)
        bad = np.flatnonzero(((choices < 0) | (choices > most)).any(axis=1))
        if len(bad) > 0:
            raise ValueError(
                f"ghost choices {choices[bad[0]].tolist()} of game {bad[0]}: candidates are 0 to {self.hold}"
            )

    def place_ghost(self, game: int, number: int, x: float, y: float) -> tuple[float, float]:
        """Let a ghost go on from the cell of his nearest to (x, y), m; returns where that is."""
        cells = self.assets_of(game).clyde.position
        cell = int(((cells - (x, y)) ** 2).sum(axis=1).argmin())
        kernels.place_ghost(
            self.games[game : game + 1],
            self.ghosts[game, number : number + 1],
            self.ghosts[game],
            self._ghosts.paths[game, number],
            self.obstacles[game],
            cell,
            cells,
        )
        return float(cells[cell, 0]), float(cells[cell, 1])

    def situation(
        self, seat: int = -1, again: Situation | None = None, index: NDArray[np.int64] | None = None
    ) -> Situation:
        """What a policy sees now, the robot's or (``seat`` k) that of ghost k.

        The arrays are new, or those of a situation that this batch has given before and that is written ``again``; of
        that only the games ``index``, if the others are as they were.
        """
        lengths = self.n, self.candidates, self.ghosts.shape[1]
        situation = Situation.empty(*lengths, self.levels, self.threads) if again is None else again
        if self._look_table is None:
            self._look_table = Table(
                situation_kernel.LookArrays,
                games=self.games,
                ghosts=self.ghosts,
                ghost_paths=self._ghosts.paths,
                obstacles=self.obstacles,
                alive=self.alive,
                waits=self._waits,
                parameters=self._parameters,
                request=self._request,
                summary=self.summary,
                **self.levels.arrays_for(situation_kernel.LookArrays),
            )
        situation_kernel.direct(self._request, situation, seat, self.shows_features)
        if index is None:
            self.threads.run(situation_kernel.look, [self._look_table], self.n)
        else:
            for i in index.tolist():
                situation_kernel.look(self._look_table.address, i, i + 1)
        return situation
