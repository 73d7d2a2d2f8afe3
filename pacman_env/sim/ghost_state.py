"""State, paths and destinations of the ghosts of N games; ``game/ghosts.py`` contains the rules."""

import math
from collections.abc import Callable, Collection, Sequence
from typing import Any, NamedTuple

import numpy as np
from numba.np.unsafe.ndarray import to_fixed_tuple
from numpy.typing import NDArray

from ..config import Config, ConfigError, located
from ..engine.arrays import Array, Table, address, arrays_by_address, reals_at
from ..engine.bucket_queue import SearchArrays
from ..engine.jit import kernel
from ..engine.native import address_of_kernel, call_range
from ..game import ghosts as rules
from ..game.ghosts import POLICY, WANDER, at_target, choose_target, find_behaviour, spawn, view_of, walk
from ..game.power import HARMLESS_UNTIL, is_away, is_frightened, is_harmless
from ..levels.assets import MapAssets
from ..levels.ghost_cells import find_path, search_memory
from ..levels.level import Level, level_arrays
from ..levels.level_slots import LevelSlots
from ..rng import below
from ..world.navigation.grid import cell_of
from ..world.navigation.localization import Pose
from .behaviour_kernels import CONSTANTS, behaviour_kernel, target_of
from .beliefs import watch as watch_ghosts
from .kernels import believed, see_ghosts
from .parameters import GAME, GHOST, PARAMETERS, batch_parameters

_TABLE = tuple(entry for entry in rules.BEHAVIOURS.values() if entry.target is not None and entry.name != rules.FLEE)
BEHAVIOUR_NAMES = tuple(entry.name for entry in _TABLE)
_FROM_OUTSIDE = -1  # instead of a kernel's address: a policy sends the ghost
TO_WANDER, TO_CANDIDATE, AS_BEHAVIOUR, TO_CELL = range(4)  # kinds of a choice for a ghost that a policy sends
GHOST_CHOICE = np.dtype(
    [
        ("kind", np.int64),
        ("value", np.int64),  # 0, candidate (the last one: wander), index in ``BEHAVIOUR_NAMES``, cell of its map
    ]
)


class GhostArrays(NamedTuple):
    """Arrays of :func:`decide`, :func:`move` and the kernels of B behaviours, which are called by address."""

    games: Any = Array(GAME, "N")
    ghosts: Any = Array(GHOST, "N G")
    paths: Any = Array(np.int32, "N G l")  # cells of each ghost's path
    obstacles: Any = Array(np.float64, "N G 5")  # of ``kernels.RuleArrays``
    parameters: Any = Array(PARAMETERS, "1")
    choices: Any = Array(GHOST_CHOICE, "N G")  # for the ghosts that a policy sends
    behaviours: Any = Array(np.int64, "B 2")  # addresses of the kernel and its constants; the last: of the frightened
    levels: Any = Array(np.int64, "L")  # addresses
    search: Any = SearchArrays


#: In the kernels ``path`` (L,) are the cells of a ghost, ``level`` the arrays of its map, and ``table`` this address.
ghost_arrays = arrays_by_address(GhostArrays)


@kernel
def wander_on(ghost, path, level, search):  # type: ignore[no-untyped-def]
    """Draw a new target at the end of the path and find the shortest path to it (Algorithm 2)."""
    node, queue = search
    current = path[ghost.path_index]
    target = choose_target(ghost, current, level.ghost_part, level.ghost_part_start, level.ghost_part_cells)
    ghost.path_length = find_path(np.int64(current), np.int64(target), level.ghost_graph, node, queue, path)
    ghost.path_index = 0
    ghost.path_offset = 0.0
    if ghost.path_length == 0:  # cannot happen inside a connected part; the ghost stays
        path[0] = current
        ghost.path_length = 1


@kernel
def head_for(ghost, path, target, level, search):  # type: ignore[no-untyped-def]
    """Redirect a ghost at once: to the next cell of its path, then on the shortest path to ``target``, if any."""
    part = level.ghost_part
    node, queue = search
    current = path[ghost.path_index]
    if path[ghost.path_length - 1] == target or part[current] != part[target]:
        return
    first = 0
    following = current
    if ghost.path_offset > 0.0:
        first = 1
        following = path[ghost.path_index + 1]
    count = find_path(np.int64(following), np.int64(target), level.ghost_graph, node, queue, path[first:])
    if count > 0:
        path[0] = current
        ghost.path_index = 0
        ghost.path_length = count + first


@kernel
def _go(ghost, path, target, level, search):  # type: ignore[no-untyped-def]
    """Send a ghost to a cell, or let it wander if the target is -1 or unreachable."""
    part = level.ghost_part
    ghost.wanders = target < 0 or part[path[ghost.path_index]] != part[target]
    if not ghost.wanders:
        head_for(ghost, path, target, level, search)


@kernel
def _cell_of(chosen, g, level, p):  # type: ignore[no-untyped-def]
    """Return the cell to which a choice sends a ghost, or -1 (wander) if its game or map has no such place."""
    value = chosen.value
    if chosen.kind == TO_CELL and value < len(level.ghost_part):
        return value
    if chosen.kind == TO_CANDIDATE and value < p.pellet_slots + p.refuge_slots:
        goal = value if value < p.pellet_slots else g.pellets + value - p.pellet_slots
        if goal < g.pellets + g.refuges and (value >= p.pellet_slots or value < g.pellets):
            return np.int64(level.ghost_place[goal])
    return -1


@kernel
def _own_row(ghost, k, count):  # type: ignore[no-untyped-def]
    """Return the row in ``GhostArrays.behaviours`` of the behaviour of ghost k of ``count``."""
    return k if ghost.behaviour == 0 else count + ghost.behaviour - 1


@kernel
def decide(table, i):  # type: ignore[no-untyped-def]
    """Choose targets for the ghosts of game i that have a behaviour or policy; return False if a behaviour failed."""
    a = ghost_arrays(table)
    ghosts, paths, behaviours = a.ghosts, a.paths, a.behaviours
    g, p = a.games[i], a.parameters[0]
    level = level_arrays(a.levels[g.level])
    count = ghosts.shape[1]
    flee = len(behaviours) - 1
    for k in range(count):
        row = -1
        ghost = ghosts[i, k]
        own = _own_row(ghost, k, count)
        frightened = is_frightened(a.obstacles[i, k], g.step)
        if ghost.fled and not frightened:  # a ghost that wanders draws a new target at the end of its path
            ghost.wanders |= behaviours[own, 0] == 0
        ghost.fled = frightened
        if is_away(a.obstacles[i, k], g.step):
            continue
        if behaviours[own, 0] > 0:
            row = own
        elif behaviours[own, 0] < 0:  # a policy sends it
            chosen = a.choices[i, k]
            if chosen.kind == AS_BEHAVIOUR:
                row = count + chosen.value
            else:
                _go(ghost, paths[i, k], _cell_of(chosen, g, level, p), level, a.search)
            ghost.place = chosen.value if chosen.kind == TO_CANDIDATE and not ghost.wanders else -1
        if frightened and behaviours[own, 0] >= 0:
            row = flee
        if row >= 0 and call_range(behaviours[row, 0], table, i, row * count + k) < 0:
            return False
    return True


@kernel
def move(table, i):  # type: ignore[no-untyped-def]
    """Move the ghosts of a game; wandering ghosts at the end of their paths draw new targets."""
    a = ghost_arrays(table)
    ghosts, paths, behaviours = a.ghosts, a.paths, a.behaviours
    g, p = a.games[i], a.parameters[0]
    level = level_arrays(a.levels[g.level])
    count = ghosts.shape[1]
    for k in range(count):
        ghost = ghosts[i, k]
        away = is_away(a.obstacles[i, k], g.step)
        if away and not ghost.gone:
            spawn(ghost, ghost.spawn_cell, paths[i, k], level.ghost_xy)
            ghost.wanders |= behaviours[_own_row(ghost, k, count), 0] == 0
        ghost.gone = away
        if not away:
            share = p.frightened_speed if is_frightened(a.obstacles[i, k], g.step) else 1.0
            walk(ghost, paths[i, k], level.ghost_xy, share, p.clyde_period)
    see_ghosts(g, ghosts[i], a.obstacles[i])
    for k in range(count):
        if ghosts[i, k].wanders & at_target(ghosts[i, k]) & (not ghosts[i, k].gone):
            wander_on(ghosts[i, k], paths[i, k], level, a.search)


@kernel
def watch(table, i):  # type: ignore[no-untyped-def]
    """Update the beliefs about the ghosts of a game after a tick."""
    a = ghost_arrays(table)
    g, p = a.games[i], a.parameters[0]
    bx, by, _ = believed(g, p.use_tf)
    for k in range(a.ghosts.shape[1]):
        if is_harmless(a.obstacles[i, k], g.step) or a.ghosts[i, k].fled:
            a.ghosts[i, k].seen_cell = -1  # its motion says nothing about its behaviour
    watch_ghosts(a.ghosts[i], a.paths[i], (bx, by), g.tick, a.levels[g.level], p.arcade_m, p.tick_s)


def _follow_behaviour(table, i, which):  # type: ignore[no-untyped-def]
    """Choose the target of a ghost of game i; ``which`` is the row of its behaviour * G + its number. Return 0."""
    a = ghost_arrays(table)
    row, number = divmod(which, a.ghosts.shape[1])
    constants = reals_at(a.behaviours[row, 1], CONSTANTS)
    g, p = a.games[i], a.parameters[0]
    level, ghost = level_arrays(a.levels[g.level]), a.ghosts[i, number]
    corner = level.ghost_corner[number]
    view = view_of(number, ghost, believed(g, p.use_tf), (level.ghost_xy[corner, 0], level.ghost_xy[corner, 1]))
    x, y = target_of(view, to_fixed_tuple(constants, CONSTANTS))
    target = -1
    if math.isfinite(x) and math.isfinite(y):
        rows, columns = level.ghost_snap.shape
        column, row = cell_of(level.affine, rows, columns, x, y)
        target = level.ghost_snap[row, column]
    _go(ghost, a.paths[i, number], target, level, a.search)
    return 0


#: Version for calls from Python.
spawn_ghost = kernel(spawn)


def choices_of(values: NDArray[Any], kind: int = TO_CANDIDATE) -> NDArray[Any]:
    """Return integers of any shape as choices of one kind; choices (``GHOST_CHOICE``) are returned unchanged."""
    if values.dtype == GHOST_CHOICE:
        return values
    choices = np.zeros(values.shape, dtype=GHOST_CHOICE)
    choices["kind"], choices["value"] = kind, values
    return choices


class Ghosts:
    def __init__(self, n: int, config: Config) -> None:
        with located(f"clyde.ghosts = {config.clyde.ghosts!r}"):
            behaviours = [find_behaviour(name) for name in config.clyde.ghosts]
        count = len(behaviours)
        self.state = np.zeros((n, count), dtype=GHOST)
        self.paths = np.zeros((n, count, 0), dtype=np.int32)  # (N, G, L) cells of each ghost's path
        self.obstacles = np.zeros((n, count, 5))  # of ``kernels.RuleArrays``
        self.choices = np.zeros((n, count), dtype=GHOST_CHOICE)  # for the ghosts that a policy sends
        self.wander_first = np.array([one.name in (WANDER, POLICY) for one in behaviours])
        self.sent_from_outside = np.array([one.name == POLICY for one in behaviours])
        self._any_sent = bool(self.sent_from_outside.any())
        self._config = config
        self._behaviours = np.zeros((count + len(_TABLE) + 1, 2), dtype=np.int64)
        self._constants: list[NDArray[np.float64]] = []
        self._used: dict[int, Callable[[int, int, int], int]] = {}  # kernels by their row
        for k, one in enumerate(behaviours):
            if one.name == POLICY:
                self._behaviours[k, 0] = _FROM_OUTSIDE
            elif one.name != WANDER:
                self._use(k, one)
        if config.power.pellets > 0:
            with located("power.behaviour"):
                frightened = find_behaviour(config.power.behaviour)
            if frightened.target is None:
                name = frightened.name
                raise ConfigError(f"power.behaviour = {name!r}: must not be a behaviour that needs a policy")
            self._use(len(self._behaviours) - 1, frightened)

    def _use(self, row: int, behaviour: rules.Behaviour) -> None:
        self._used[row] = behaviour_kernel(_follow_behaviour, behaviour)
        self._constants.append(np.array(behaviour.constants(self._config), dtype=np.float64))
        self._behaviours[row] = address_of_kernel(self._used[row]), address(self._constants[-1])

    def compile_behaviours(self, indices: Collection[int]) -> None:
        """Compile behaviours by index in ``BEHAVIOUR_NAMES``, so that ``behaviour`` of a ghost may select them."""
        for k in indices:
            row = len(self.wander_first) + k
            if row not in self._used:
                self._use(row, _TABLE[k])

    def send(self, choices: NDArray[Any] | None) -> None:
        """Set the choices of ghosts that a policy sends, (N, G) records or candidates, and compile their behaviours.

        None lets them wander. A ValueError changes nothing.
        """
        if not self._any_sent:
            return
        if choices is None:
            self.choices.fill(0)
            return
        if choices.shape != self.choices.shape:
            raise ValueError(f"ghost choices of shape {choices.shape}: must be {self.choices.shape}")
        sent = choices_of(choices)
        kind, value = sent["kind"], sent["value"]
        bad = np.flatnonzero(((value < 0) | (value > self._most[kind])).any(axis=1))
        if len(bad) > 0:
            wrong = value[bad[0]].tolist()
            raise ValueError(f"ghost choices {wrong} of game {bad[0]}: candidates are 0 to {self._hold}")
        self.choices[:] = sent
        self.compile_behaviours(set(value[kind == AS_BEHAVIOUR].tolist()))

    def bind(self, levels: LevelSlots, hold: int) -> None:
        """Set the levels that the ghosts walk on and the number ``hold`` of the candidate "hold"; erase all paths."""
        self._levels, self._hold = levels, hold
        self._most = np.array([0, hold, len(_TABLE) - 1, levels.sizes.ghost_cells - 1])  # largest value by kind
        # A ghost that turns round between two cells first walks to the second one.
        self.paths = np.zeros((*self.state.shape, levels.sizes.longest_ghost_way + 1), dtype=np.int32)

    def table(self, games: NDArray[Any], parameters: NDArray[Any]) -> Table:
        """Return a table for the kernels with its own scratch memory; each thread needs one."""
        return Table(
            GhostArrays,
            games=games,
            ghosts=self.state,
            paths=self.paths,
            obstacles=self.obstacles,
            parameters=parameters,
            choices=self.choices,
            behaviours=self._behaviours,
            levels=self._levels.addresses,
            search=search_memory(self._levels.sizes.ghost_cells, self._levels.sizes.longest_ghost_way),
        )

    def raise_error_of(self, table: int, game: int) -> None:
        count = len(self.wander_first)
        for k in range(count):
            kind, value = self.choices[game, k].tolist()
            row = count + value if kind == AS_BEHAVIOUR else k
            if self.state["fled"][game, k] and not self.sent_from_outside[k]:
                row = len(self._behaviours) - 1
            if row in self._used:
                self._used[row](table, game, row * count + k)
        raise RuntimeError(f"a ghost of game {game} could not decide where to go")


_stream, _below = kernel(rules.ghost_stream), kernel(below)


class MapGhosts:
    """Ghosts of one game without a robot, on a map prepared with ``config``; the seed decides their paths."""

    def __init__(self, assets: MapAssets, config: Config, seed: int) -> None:
        self.cells = assets.clyde
        self._assets, self._config = assets, config
        self._ghosts = Ghosts(1, config)
        self._ghosts.bind(LevelSlots.only(Level.of(assets, config), config), assets.pellets + assets.refuges)
        self._parameters = batch_parameters(config, assets.grid.resolution, assets.pellets, assets.refuges)
        self._parameters["use_tf"] = 1  # the pose of see_robot is the believed pose
        self._games = np.zeros(1, dtype=GAME)  # only holds the robot's pose
        self._games["pellets"], self._games["refuges"] = assets.pellets, assets.refuges
        self._headings = [0.0] * len(self)
        self._table = self._ghosts.table(self._games, self._parameters)
        state = self._ghosts.state[0]
        state["stream"] = [_stream(np.uint64(seed), number) for number in range(len(self))]
        state["wanders"] = self._ghosts.wander_first
        self.speed_mps = config.clyde.speed_mps
        self.respawn([])

    def __len__(self) -> int:
        return len(self._ghosts.state[0])

    @property
    def poses(self) -> list[Pose]:
        """Position, m, and last direction of motion, rad, of each ghost."""
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

    def see_harmless(self, left_s: NDArray[np.float64]) -> None:
        """Set how much longer each ghost is harmless and away, (G, 2), s."""
        self._ghosts.obstacles[0, :, HARMLESS_UNTIL:] = left_s / float(self._parameters["dt"][0])

    def place(self, number: int, cell: int) -> None:
        spawn_ghost(self._ghosts.state[0, number], cell, self._ghosts.paths[0, number], self.cells.position)

    def send_back(self, numbers: Sequence[int]) -> None:
        """Place caught ghosts on the cells on which they started."""
        for number in numbers:
            self.place(number, int(self._ghosts.state[0, number]["spawn_cell"]))

    def respawn(self, away_from: Sequence[tuple[float, float]], numbers: Sequence[int] | None = None) -> None:
        """Place the ghosts ``numbers`` (None: all) on random cells far from the places ``away_from`` (m).

        The cells are in the connected area of the first of these places, or in Clyde's area if there are none.
        """
        part = self._assets.clyde_part
        if away_from:
            part = int(self.cells.part[self.cells.nearest(*away_from[0])[0]])
        cells = self.cells.start_cells(self._config.clyde, part, away_from)
        for number in range(len(self)) if numbers is None else numbers:
            ghost = self._ghosts.state[0, number]
            ghost["stream"], pick = _below(ghost["stream"], len(cells))
            self.place(number, int(cells[pick]))

    def decide(self, choices: NDArray[Any] | None = None) -> None:
        """Choose the targets of ghosts that do not wander; ``choices`` (G,) are as in :meth:`Ghosts.send`."""
        self._ghosts.send(None if choices is None else choices[None])
        decide(self._table.address, 0)

    def compile_kernels(self, choices: NDArray[Any] | None = None) -> None:
        """Compile all kernels in advance, then respawn the ghosts."""
        self.decide(choices)
        self.step()
        self.respawn([])

    def step(self) -> None:
        move(self._table.address, 0)
        for number, ghost in enumerate(self._ghosts.state[0]):
            if ghost["vx"] or ghost["vy"]:
                self._headings[number] = math.atan2(ghost["vy"], ghost["vx"])
