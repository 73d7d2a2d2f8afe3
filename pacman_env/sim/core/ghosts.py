"""The ghosts of N games: where they are, the paths they are on, where each goes. Rules are in ``game/ghosts.py``."""

import functools
import math
import types
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numba.np.unsafe.ndarray import to_fixed_tuple
from numpy.typing import NDArray

from ...config import Config, ConfigError
from ...engine.arrays import Array, Table, address, arrays_by_address, reals_at
from ...engine.bucket_queue import SearchArrays
from ...engine.jit import kernel
from ...engine.native import address_of_kernel, call_range
from ...game.ghosts import (
    BEHAVIOURS,
    POLICY,
    WANDER,
    Behaviour,
    GhostView,
    at_target,
    choose_target,
    find_behaviour,
    ghost_stream,
    spawn,
    walk,
)
from ...rng import below
from ...world.navigation.grid import cell_of
from ...world.navigation.localization import Pose
from ..maps.assets import MapAssets
from ..maps.ghost_cells import find_path, search_memory
from ..maps.level import Level, level_arrays
from ..maps.level_slots import LevelSlots
from .beliefs import watch as watch_ghosts
from .kernels import believed, see_ghosts
from .parameters import GAME, GHOST, PARAMETERS, batch_parameters

_TABLE = tuple(entry for entry in BEHAVIOURS.values() if entry.target is not None)
BEHAVIOUR_NAMES = tuple(entry.name for entry in _TABLE)
_FROM_OUTSIDE = -1  # in place of the address of a behaviour's kernel


class GhostArrays(NamedTuple):
    """What :func:`decide`, :func:`move` and the kernels of B behaviours, called by their addresses, work on."""

    games: Any = Array(GAME, "N")
    ghosts: Any = Array(GHOST, "N G")
    paths: Any = Array(np.int32, "N G l")  # cells of the path that each is on
    obstacles: Any = Array(np.float64, "N G 3")  # m, where they are seen
    parameters: Any = Array(PARAMETERS, "1")
    choices: Any = Array(np.int64, "N G")  # of those sent from outside
    remembered: Any = Array(np.int32, "N t G")  # the choice at each tick of the round
    behaviours: Any = Array(np.int64, "B 2")  # addresses of the kernel and of its constants
    levels: Any = Array(np.int64, "L")  # addresses
    search: Any = SearchArrays


_arrays = arrays_by_address(GhostArrays)


@kernel
def wander_on(ghost, path, level, search):  # type: ignore[no-untyped-def]
    """Algorithm 2: draw a target and take the shortest path there, at the end of the path."""
    node, queue = search
    here = path[ghost.path_index]
    target = choose_target(ghost, here, level.ghost_part, level.ghost_part_start, level.ghost_part_cells)
    ghost.path_length = find_path(np.int64(here), np.int64(target), level.ghost_graph, node, queue, path)
    ghost.path_index = 0
    ghost.path_offset = 0.0
    if ghost.path_length == 0:  # cannot happen within a part; it stays where it is
        path[0] = here
        ghost.path_length = 1


@kernel
def head_for(ghost, path, target, level, search):  # type: ignore[no-untyped-def]
    """Turn to another cell at once: on to the next cell of its path, from there the shortest one, if there is any."""
    part = level.ghost_part
    node, queue = search
    here = path[ghost.path_index]
    if path[ghost.path_length - 1] == target or part[here] != part[target]:
        return
    kept = 0
    following = here
    if ghost.path_offset > 0.0:
        kept = 1
        following = path[ghost.path_index + 1]
    count = find_path(np.int64(following), np.int64(target), level.ghost_graph, node, queue, path[kept:])
    if count > 0:
        path[0] = here
        ghost.path_index = 0
        ghost.path_length = count + kept


@kernel
def _go(ghost, path, target, level, search):  # type: ignore[no-untyped-def]
    """To a cell, or wander on without one (-1) or a path to it."""
    part = level.ghost_part
    ghost.wanders = target < 0 or part[path[ghost.path_index]] != part[target]
    if not ghost.wanders:
        head_for(ghost, path, target, level, search)


@kernel
def _send(ghost, path, i, chosen, level, a):  # type: ignore[no-untyped-def]
    """Send a ghost of game i to a candidate of the robot's; the last candidate is to wander on."""
    g, p = a.games[i], a.parameters[0]
    goal = chosen if chosen < p.pellet_slots else g.pellets + chosen - p.pellet_slots
    target = -1
    hold = p.pellet_slots + p.refuge_slots
    if chosen < hold and goal < g.pellets + g.refuges and (chosen >= p.pellet_slots or chosen < g.pellets):
        target = level.ghost_place[goal]
    _go(ghost, path, target, level, a.search)
    ghost.place = -1 if ghost.wanders else chosen


@kernel
def decide(table, i):  # type: ignore[no-untyped-def]
    """Where the ghosts of a game that do not just wander go now; False if a behaviour's function raised."""
    a = _arrays(table)
    ghosts, paths, behaviours = a.ghosts, a.paths, a.behaviours
    g, p = a.games[i], a.parameters[0]
    level = level_arrays(a.levels[g.level])
    count = ghosts.shape[1]
    hold = p.pellet_slots + p.refuge_slots
    for k in range(count):
        row = -1
        if behaviours[k, 0] > 0:
            row = k
        elif behaviours[k, 0] < 0:  # it is sent from outside
            chosen = a.choices[i, k]
            a.remembered[i, g.tick, k] = chosen
            if chosen <= hold:
                _send(ghosts[i, k], paths[i, k], i, chosen, level, a)
            else:
                ghosts[i, k].place = -1
                row = count + chosen - hold - 1
                if row >= len(behaviours):
                    cell = row - len(behaviours)  # it wanders on if there is no such cell
                    _go(ghosts[i, k], paths[i, k], cell if cell < len(level.ghost_part) else -1, level, a.search)
                    row = -1
        if row >= 0 and call_range(behaviours[row, 0], table, i, row * count + k) < 0:
            return False
    return True


@kernel
def move(table, i):  # type: ignore[no-untyped-def]
    """The ghosts' update in a game; one that wanders and is at the end of its path draws another."""
    a = _arrays(table)
    ghosts, paths = a.ghosts, a.paths
    g, p = a.games[i], a.parameters[0]
    level = level_arrays(a.levels[g.level])
    count = ghosts.shape[1]
    for k in range(count):
        walk(ghosts[i, k], paths[i, k], level.ghost_xy, p.clyde_period)
    see_ghosts(g, ghosts[i], a.obstacles[i])
    for k in range(count):
        if ghosts[i, k].wanders & at_target(ghosts[i, k]):
            wander_on(ghosts[i, k], paths[i, k], level, a.search)


@kernel
def watch(table, i):  # type: ignore[no-untyped-def]
    """What the ghosts of a game are believed to do, after a tick."""
    a = _arrays(table)
    g, p = a.games[i], a.parameters[0]
    bx, by, _ = believed(g, p.use_tf)
    watch_ghosts(a.ghosts[i], a.paths[i], (bx, by), g.tick, a.levels[g.level], p.arcade_m, p.tick_s)


def _target(view, constants):  # type: ignore[no-untyped-def]
    """A behaviour's function is in its place in a copy of :func:`_follow_behaviour`."""


_CONSTANTS = 0  # likewise the number of its constants


def _follow_behaviour(table, i, which):  # type: ignore[no-untyped-def]
    """Let a ghost of game i decide where it goes; ``which``: the behaviour's row times the ghosts plus its number."""
    a = _arrays(table)
    row, number = divmod(which, a.ghosts.shape[1])
    constants = reals_at(a.behaviours[row, 1], _CONSTANTS)
    g, p = a.games[i], a.parameters[0]
    level, ghost = level_arrays(a.levels[g.level]), a.ghosts[i, number]
    bx, by, heading = believed(g, p.use_tf)
    corner_x, corner_y = level.ghost_xy[level.ghost_corner[number]]
    view = GhostView(number, ghost.x, ghost.y, ghost.vx, ghost.vy, bx, by, heading, corner_x, corner_y)
    x, y = _target(view, to_fixed_tuple(constants, _CONSTANTS))
    target = -1
    if math.isfinite(x) and math.isfinite(y):
        rows, columns = level.ghost_snap.shape
        column, row = cell_of(level.affine, rows, columns, x, y)
        target = level.ghost_snap[row, column]
    _go(ghost, a.paths[i, number], target, level, a.search)
    return 0


@functools.cache
def behaviour_kernel(behaviour: Behaviour) -> Callable[[int, int, int], int]:
    """:func:`_follow_behaviour` with the behaviour's function compiled into it."""
    assert behaviour.target is not None
    own = BEHAVIOURS.get(behaviour.name) == behaviour
    known = {**globals(), "_target": kernel(behaviour.target, own), "_CONSTANTS": len(behaviour.parameters)}
    loop = types.FunctionType(_follow_behaviour.__code__, known, "_follow_behaviour")
    loop.__module__ = __name__
    loop.__qualname__ = f"_follow_{behaviour.name}" if own else "_follow_behaviour_from_outside"
    return kernel(loop, own)


#: For Python.
spawn_ghost = kernel(spawn)


def behaviour_choice(hold: int, number: int) -> int:
    """The choice that lets a ghost sent from outside follow ``BEHAVIOUR_NAMES[number]`` in this tick."""
    return hold + 1 + number


def cell_choice(hold: int, cell: Any) -> Any:
    """Return the choice that sends a ghost sent from outside to a cell of its map (``ClydeCells``)."""
    return behaviour_choice(hold, len(BEHAVIOUR_NAMES)) + cell


class Ghosts:
    def __init__(self, n: int, config: Config) -> None:
        try:
            behaviours = [find_behaviour(name) for name in config.clyde.ghosts]
        except ConfigError as error:
            raise ConfigError(f"clyde.ghosts = {config.clyde.ghosts!r}: {error}") from error
        count = len(behaviours)
        self.state = np.zeros((n, count), dtype=GHOST)
        self.paths = np.zeros((n, count, 0), dtype=np.int32)  # (N, G, L) cells of the path that each is on
        self.obstacles = np.zeros((n, count, 3))  # where they are seen, m
        #: Of those sent from outside: a candidate, the last one to wander on, or beyond it a :func:`behaviour_choice`
        #: or a :func:`cell_choice`.
        self.choices = np.zeros((n, count), dtype=np.int64)
        self.wander_first = np.array([one.name in (WANDER, POLICY) for one in behaviours])
        self.sent_from_outside = np.array([one.name == POLICY for one in behaviours])
        self._any_sent = bool(self.sent_from_outside.any())
        self._config = config
        self._behaviours = np.zeros((count + len(_TABLE), 2), dtype=np.int64)
        self._constants: list[NDArray[np.float64]] = []
        self._used: dict[int, Callable[[int, int, int], int]] = {}  # kernels by their row
        for k, one in enumerate(behaviours):
            if one.name == POLICY:
                self._behaviours[k, 0] = _FROM_OUTSIDE
            elif one.name != WANDER:
                self._use(k, one)

    def _use(self, row: int, behaviour: Behaviour) -> None:
        self._used[row] = behaviour_kernel(behaviour)
        self._constants.append(np.array(behaviour.constants(self._config), dtype=np.float64))
        self._behaviours[row] = address_of_kernel(self._used[row]), address(self._constants[-1])

    def send(self, choices: NDArray[np.int64] | None) -> None:
        """Set the ``choices`` (N, G) for those sent from outside; None: all wander on. ValueError changes nothing."""
        if not self._any_sent:
            return
        if choices is None:
            self.choices.fill(self._hold)
            return
        if choices.shape != self.choices.shape:
            raise ValueError(f"ghost choices of shape {choices.shape}: must be {self.choices.shape}")
        most = cell_choice(self._hold, self._levels.sizes.ghost_cells - 1)
        bad = np.flatnonzero(((choices < 0) | (choices > most)).any(axis=1))
        if len(bad) > 0:
            raise ValueError(
                f"ghost choices {choices[bad[0]].tolist()} of game {bad[0]}: candidates are 0 to {self._hold}"
            )
        self.choices[:] = choices
        self.compile_choices()

    def compile_choices(self) -> None:
        if self.choices.max() <= self._hold:
            return
        for k, behaviour in enumerate(_TABLE):
            row = len(self.wander_first) + k
            if self._behaviours[row, 0] == 0 and (self.choices == behaviour_choice(self._hold, k)).any():
                self._use(row, behaviour)

    def bind(self, levels: LevelSlots, hold: int) -> None:
        """Let the ghosts walk on these levels; ``hold`` is the last candidate."""
        self._levels, self._hold = levels, hold
        # A ghost that turns round between two cells walks on to the second one first.
        self.paths = np.zeros((*self.state.shape, levels.sizes.longest_ghost_way + 1), dtype=np.int32)

    def table(self, games: NDArray[Any], remembered: NDArray[np.int32], parameters: NDArray[Any]) -> Table:
        """What the kernels work on, with scratch memory of its own: one for each thread."""
        return Table(
            GhostArrays,
            games=games,
            ghosts=self.state,
            paths=self.paths,
            obstacles=self.obstacles,
            parameters=parameters,
            choices=self.choices,
            remembered=remembered,
            behaviours=self._behaviours,
            levels=self._levels.addresses,
            search=SearchArrays(*search_memory(self._levels.sizes.ghost_cells, self._levels.sizes.longest_ghost_way)),
        )

    def raise_again(self, table: int, game: int) -> None:
        count = len(self.wander_first)
        for k in range(count):
            chosen = int(self.choices[game, k]) - behaviour_choice(self._hold, 0)
            row = k if k in self._used else count + chosen
            if row in self._used and (row == k or chosen >= 0):
                self._used[row](table, game, row * count + k)
        raise RuntimeError(f"a ghost of game {game} could not decide where to go")


_stream, _below = kernel(ghost_stream), kernel(below)


class MapGhosts:
    """Ghosts that stand until :meth:`step` is called, on a map prepared under ``config``; the seed decides paths."""

    def __init__(self, assets: MapAssets, config: Config, seed: int) -> None:
        self.cells = assets.clyde
        self._assets, self._config = assets, config
        self._ghosts = Ghosts(1, config)
        self._ghosts.bind(LevelSlots.only(Level.of(assets, config), config), assets.pellets + assets.refuges)
        self._parameters = batch_parameters(config, assets.grid.resolution, assets.pellets, assets.refuges)
        self._parameters["use_tf"] = 1  # the pose that is given is the one believed
        self._games = np.zeros(1, dtype=GAME)  # where the robot is; a step's number never counts
        self._games["pellets"], self._games["refuges"] = assets.pellets, assets.refuges
        self._remembered = np.zeros((1, 1, len(self)), dtype=np.int32)
        self._headings = [0.0] * len(self)
        self._table = self._ghosts.table(self._games, self._remembered, self._parameters)
        state = self._ghosts.state[0]
        state["stream"] = [_stream(np.uint64(seed), number) for number in range(len(self))]
        state["wanders"] = self._ghosts.wander_first
        self.speed_mps = config.clyde.speed_mps
        self.respawn([])

    def __len__(self) -> int:
        return len(self._ghosts.state[0])

    @property
    def poses(self) -> list[Pose]:
        """Where they are and where each last went, by number."""
        state = self._ghosts.state[0]
        return [(float(g["x"]), float(g["y"]), h) for g, h in zip(state, self._headings, strict=True)]

    @property
    def speed_mps(self) -> float:
        return float(self._ghosts.state["speed"][0, 0])

    @speed_mps.setter
    def speed_mps(self, value: float) -> None:
        self._ghosts.state["speed"] = value

    def see_robot(self, pose: Pose) -> None:
        self._games["x"], self._games["y"], self._games["heading"] = pose

    def place(self, number: int, cell: int) -> None:
        spawn_ghost(self._ghosts.state[0, number], cell, self._ghosts.paths[0, number], self.cells.position)

    def respawn(self, away_from: Sequence[tuple[float, float]], numbers: Sequence[int] | None = None) -> None:
        """Put ghosts on random cells of the robot's area, away from these places, m, of which the first is in it."""
        part = self._assets.clyde_part
        if away_from:
            part = int(self.cells.part[self.cells.nearest(*away_from[0])[0]])
        allowed = self.cells.start_cells(self._config.clyde, part, away_from)
        for number in range(len(self)) if numbers is None else numbers:
            ghost = self._ghosts.state[0, number]
            ghost["stream"], pick = _below(ghost["stream"], len(allowed))
            self.place(number, int(allowed[pick]))

    def decide(self, choices: NDArray[np.int64] | None = None) -> None:
        """Decide where ghosts that do not wander go; ``choices`` (G,) are candidates for those sent from outside."""
        if choices is not None:
            self._ghosts.choices[0] = choices
            self._ghosts.compile_choices()
        decide(self._table.address, 0)

    def rehearse(self, choices: NDArray[np.int64]) -> None:
        """Compile everything beforehand, and respawn."""
        self.decide(choices)
        self.step()
        self.respawn([])

    def step(self) -> None:
        move(self._table.address, 0)
        for number, ghost in enumerate(self._ghosts.state[0]):
            if ghost["vx"] or ghost["vy"]:
                self._headings[number] = math.atan2(ghost["vy"], ghost["vx"])
