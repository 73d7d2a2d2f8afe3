"""N independent games simulated at once.

There is no second, scalar implementation: one game is a batch of one. Seeds come in from outside; game i of a batch
is bit-identical to the same game alone with the same seed.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...config import MAX_SPEED_MPS, Config, ConfigError
from ...game.execution import COMPLETE, RUNNING, TIMEOUT
from ...game.last_decision import Moment
from ...game.round import clyde_speed_mps
from ...world.navigation.physics import PhysicsWorld
from ...world.navigation.planner import PATH_POINTS, detour_memory
from ..maps.assets import MapAssets
from ..maps.level_source import FixedMap, LevelSource
from ..maps.level_stack import LevelStack
from ..observation.situation import Situation
from ..observation.situation_kernel import fill_situation
from . import kernels, records
from .ghosts import BEHAVIOUR_NAMES, Ghosts, behaviour_choice
from .history import History, RoundSoFar
from .parameters import batch_parameters, draw_episodes, next_seeds

_ASLEEP = -1  # in place of RUNNING


class DecisionPoint(NamedTuple):
    """Of N games."""

    tick: NDArray[np.int32]
    distance: NDArray[np.float64]  # m, to the nearest ghost
    round: NDArray[np.int32]


class GameBatch:
    """N games under one configuration, on one map or each on a map of its own.

    Candidates are numbered: ``pellet_slots`` pellets, ``refuge_slots`` refuges (those beyond the map's are padding),
    hold.
    """

    def __init__(self, source: LevelSource | MapAssets, config: Config, n: int = 1) -> None:
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
        self.physics = PhysicsWorld(
            first.grid.walls,
            n,
            radius_m=config.robot.radius_m,
            mass_kg=config.robot.mass_kg,
            step_s=config.physics_step_s,
            shared=len(self.levels) == 1 and config.decisions.when == "tick",
        )
        self._parameters = batch_parameters(config, self.levels.resolution, slots, self.refuge_slots)
        self._sends_ghosts = bool(self._ghosts.sent_from_outside.any())
        self._wander_on = np.full(self.ghosts.shape, self.hold, dtype=np.int64)
        self._history = History(n, self.ghosts.shape[1], self._sends_ghosts, config)
        clyde_steps = int(self._parameters[0]["clyde_steps"])
        period = math.gcd(self.substeps, clyde_steps)
        # Games of a batch differ in phase; ghosts can be due at any multiple of this.
        self._ghosts_due = [k % period == 0 for k in range(self.substeps)]
        check_steps = round(config.execution.check_period_s / config.physics_step_s)
        self._check_due = [k > 0 and k % check_steps == 0 for k in range(self.substeps)]
        self._version = -1
        self._awake: NDArray[np.bool_] | None = None  # None: all
        self._by_hand = False
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
        return {"made_from": (self.source, self.config, self.n), "rounds": rounds}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Play every round again, so that the copy is the same down to the solver's memory of contacts."""
        self.__init__(*state["made_from"])  # type: ignore[misc]
        rounds: list[RoundSoFar] = state["rounds"]
        longest = max((len(r.decisions) for r in rounds), default=0)
        self.games["end"][[r.game for r in rounds]] = TIMEOUT  # they stand still until they begin
        velocity = self.config.action == "velocity"
        actions = np.zeros((self.n, 2)) if velocity else np.full(self.n, self.hold, dtype=np.int64)
        choices = self._wander_on.copy()
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
            self._advance(actions, choices)

    def _bind(self) -> None:
        """Take over the stacked arrays, after they have been made anew, and make the scratch memory for them."""
        if self._version == self.levels.version:
            return
        self._version = self.levels.version
        a = self.levels.arrays
        self._goal_xy = a["goal_xy"]
        self._plan_end = a["plan_end"]
        self._affine, self._clearance = a["affine"], a["clearance_cm"]
        self._nav = tuple(a[k] for k in ("affine", "snap", "neighbours", "cell_xy", "length_cm", "next_step"))
        self._ghosts.bind(self.levels)
        self._starts = tuple(a[k] for k in ("home", "spawn_cells", "spawn_count", "ghost_xy"))
        seen = ("goal_xy", "affine", "snap", "length_cm", "ghost_drive", "ghost_place", "ghost_part")
        self._seen = tuple(a[k] for k in seen)
        self._detour_search = detour_memory(a["cell_xy"].shape[1], self.levels.longest_way_cm, self.levels.resolution)

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
        prepared = {
            level: self.source.prepare(level) for level in dict.fromkeys(levels.tolist()) if not self.levels.has(level)
        }
        for i in index.tolist():
            if self._held[i] >= 0:
                self.levels.give_back(self._held[i])
        for i, level in zip(index.tolist(), levels.tolist(), strict=True):
            self._held[i] = self.levels.take(level, lambda number: prepared.get(number) or self.source.prepare(number))
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
            x, y = assets.grid.home[:2].tolist()
            self.physics.place(i, x, y, assets.grid.walls)
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

    def _next_rounds(self) -> None:
        """In an endless game a completed round is followed by another with faster ghosts."""
        index = np.flatnonzero(self.games["end"] == COMPLETE)
        if len(index) == 0:
            return
        before = self.games[index]
        fresh = np.zeros(len(index), dtype=records.GAME)
        for name in records.KEPT_FROM_ROUND_TO_ROUND:
            fresh[name] = before[name]
        fresh["round"] += 1
        fresh["tick_rounds"] = 1
        faster = self.config.clyde.speed_step_mps
        speeds = [clyde_speed_mps(g["base_clyde_speed"], faster, g["round"]) for g in fresh]
        fresh["clyde_speed"] = np.minimum(speeds, MAX_SPEED_MPS)
        self._start(index, next_seeds(before["seed"]), fresh)

    def step(self, actions: NDArray[Any], ghost_choices: NDArray[np.int64] | None = None) -> None:
        """One decision and the physics steps until the next; games that have ended stand still.

        Args:
            actions: (N,) int64 candidates, one that the mask forbids makes the robot hold; with velocity actions
                (N, 2) float64, v in m/s and omega in rad/s.
            ghost_choices: (N, G) int64, for ghosts told by a policy: the candidate whose place to go to, or the last
                one to wander on; None: all wander on.

        Raises:
            ValueError: an action or a choice is none; nothing has been changed then.
        """
        if ghost_choices is None:
            ghost_choices = self._wander_on
        elif self._sends_ghosts:
            self._check_ghost_choices(ghost_choices)
        self._advance(actions, ghost_choices)
        if self.config.endless:
            self._next_rounds()

    def step_by_hand(self, velocities: NDArray[np.float64], ghost_choices: NDArray[np.int64] | None = None) -> None:
        """A step in which somebody drives the robots: goals are given up, Nav2 has no part in it.

        A copy or a pickle of the batch does not know of it: that plays *hold* in its place.

        Args:
            velocities: (N, 2) v in m/s and omega in rad/s, cut to what the base can follow.
            ghost_choices: see :meth:`step`.

        Raises:
            ValueError: velocities that are not finite, or bad choices; nothing has been changed then.
        """
        parameters = self._parameters
        if not np.isfinite(velocities).all():
            raise ValueError(f"velocities {velocities.tolist()}: must be finite numbers")
        unwritten = np.zeros((self.n, 1, 2))  # (N, T, 2) as of a batch whose actions are velocities
        ticks = self.games["tick"].copy()
        self.games["tick"] = 0
        kernels.decide_velocity(self.games, velocities, unwritten, parameters)
        self.games["tick"] = ticks
        self._by_hand = True
        try:
            self.step(np.full(self.n, self.hold, dtype=np.int64), ghost_choices)
        finally:
            self._by_hand = False
            parameters["velocity_actions"] = 0

    def step_awake(
        self, actions: NDArray[Any], ghost_choices: NDArray[np.int64] | None, awake: NDArray[np.bool_]
    ) -> None:
        """A step for the games ``awake`` (N,) alone; time stands still in the others.

        Only where ``config.decisions.when`` is ``event``: each game has a space of its own then.
        """
        asleep = ~awake & (self.games["end"] == RUNNING)
        self.games["end"][asleep] = _ASLEEP
        self._awake = awake
        try:
            self.step(actions, ghost_choices)
        finally:
            self._awake = None
            self.games["end"][asleep] = RUNNING

    def decision_point(self) -> DecisionPoint:
        """What :meth:`put_to_sleep` has to know of the moment of a decision."""
        games = self.games
        return DecisionPoint(games["tick"].copy(), games["distance"].copy(), games["round"].copy())

    def moment(self, game: int) -> Moment:
        """What :class:`~pacman_env.game.last_decision.LastDecision` has to know of one game now."""
        g, time_s = self.games[game], float(self.games["tick"][game]) * self.config.execution.tick_s
        return Moment(time_s, int(g["pursued"]), (int(g["round"]), int(g["collected"])), float(g["distance"]))

    def put_to_sleep(self, awake: NDArray[np.bool_], choices: NDArray[np.int64], since: DecisionPoint) -> None:
        """Clear ``awake`` (N,) where the next decision is due (``game/decisions.py``)."""
        kernels.decisions_due(self.games, choices, *since, awake, self._parameters)

    def _advance(self, actions: NDArray[Any], ghost_choices: NDArray[np.int64]) -> None:
        """A step, but for what follows a completed round."""
        parameters, games, goal_xy = self._parameters, self.games, self._goal_xy
        physics, nav, alive, obstacles = self.physics, self._nav, self.alive, self.obstacles
        ghosts = self._ghosts
        waits, aborts = self._waits, self._aborts
        row, state, force = physics.row, physics.state, physics.force
        awake = self._awake
        self._history.make_room(games)
        due = self._decide(actions)
        if self._by_hand:
            parameters["velocity_actions"] = 1
        ghosts.decide(games, ghost_choices, self._history.ghost_choices, parameters)
        for k in range(self.substeps):
            if self._check_due[k]:
                kernels.check(games, row, state, goal_xy, alive, waits, aborts, obstacles, parameters)
            if self._ghosts_due[k]:
                ghosts.move(games, parameters)
            if due & kernels.PLAN_DUE:
                kernels.plan(games, self.paths, obstacles, parameters, self._plan_end, nav, self._detour_search)
            due = kernels.drive(games, k == 0, row, state, force, self.paths, parameters, self._affine, self._clearance)
            if due & kernels.RESULT_DUE:
                kernels.apply_results(games, goal_xy, alive, waits, aborts, obstacles, parameters)
            if awake is None:
                physics.step()
            else:
                physics.step_some(awake)
        kernels.finish(games, row, state, goal_xy, alive, waits, aborts, obstacles, parameters)

    def _decide(self, actions: NDArray[Any]) -> int:
        """Hand the actions over; returns what is due."""
        decisions = self._history.decisions
        if self.config.action == "velocity":
            due = int(kernels.decide_velocity(self.games, actions, decisions, self._parameters))
            if due < 0:
                raise ValueError(f"action {actions[-1 - due].tolist()} of game {-1 - due}: must be two finite numbers")
            return due
        due = int(
            kernels.decide(
                self.games,
                actions,
                decisions,
                self._goal_xy,
                self.alive,
                self._waits,
                self._aborts,
                self.obstacles,
                self._parameters,
            )
        )
        if due < 0:
            bad = -1 - due
            raise ValueError(f"choice {actions[bad]} of game {bad}: candidates are 0 to {self.hold}")
        return due

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

    def situation(self, seat: int = -1) -> Situation:
        """What a policy sees now, the robot's or (``seat`` k) that of ghost k; new arrays at each call."""
        situation = Situation.empty(self.n, self.candidates, self.ghosts.shape[1], self.levels)
        fill_situation(
            self.games,
            self.ghosts,
            self._ghosts.paths,
            self.obstacles,
            self.alive,
            self._waits,
            seat,
            self._parameters,
            self._seen,
            situation.arrays(),
        )
        return situation
