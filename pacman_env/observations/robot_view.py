"""Build situations from a real robot's knowledge with the simulator's kernels, so that the numbers are the same."""

import math
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..config import Config
from ..engine.arrays import Table, zeros
from ..game.execution import closing_speed
from ..game.ghosts import GHOST_NAMES
from ..game.goals import Goals, Place
from ..game.pellets import generate_pellets
from ..game.power import HARMLESS_UNTIL
from ..levels.assets import MapAssets
from ..levels.ghost_cells import step_of
from ..levels.level import Level
from ..levels.level_slots import LevelSlots
from ..sim import kernels
from ..sim.beliefs import reset_ghost_belief, watch
from ..sim.parameters import GHOST, batch_parameters
from ..world.navigation.grid import cell_of
from .situation import Situation
from .situation_kernel import REQUEST, ViewArrays, write_situations

_AWAY_M = 1.0  # a pose at a larger distance from all drivable cells is not on the map
_JUMP_M = 0.5  # a move that exceeds the ghost's speed by more than this counts as a teleport


@dataclass(frozen=True)
class Pellets:
    """Reported pellets, compared with the map."""

    known: dict[int, tuple[float, float]]  # pellets of the map, m, including unreachable ones
    unknown: tuple[int, ...]  # ids that are not on the map or at other positions


@dataclass(frozen=True)
class Seen:
    """A robot's knowledge at a decision; poses are in the map frame."""

    time_s: float  # since the round began
    pose: tuple[float, float, float]  # believed pose: m, m, rad
    left: Collection[int]  # ids of the remaining pellets
    velocity: tuple[float, float] = (0.0, 0.0)  # m/s, rad/s
    pose_age_s: float = 0.0
    masked: Collection[int] = ()  # forbidden candidates
    pursued: int = -1  # current candidate, -1: none
    harmless_s: NDArray[np.float64] | None = (
        None  # (G, 2) how long each ghost stays harmless and away, s; None: no ghost is harmless
    )


class RobotView:
    """The robot's view of one game on a map prepared with ``config``; candidates are numbered as in simulation.

    ``seed`` is the seed of the rounds, for policies that draw random numbers; ``levels`` may already contain the map.
    """

    def __init__(self, assets: MapAssets, config: Config, seed: int = 0, levels: LevelSlots | None = None) -> None:
        self.assets = assets
        self.hold = assets.pellets + assets.refuges
        self.clyde_speed_mps = config.clyde.speed_mps
        self._config = config
        self._levels = levels or LevelSlots.only(Level.of(assets, config), config)
        self._parameters = batch_parameters(config, assets.grid.resolution, assets.pellets, assets.refuges)
        self._parameters["use_tf"] = 1  # the given pose is the believed one
        pellets = generate_pellets(assets.occupancy, config.pellets)
        positions = map(tuple, pellets.position.tolist())
        others: dict[int, tuple[float, float]] = dict(zip(pellets.ids.tolist(), positions, strict=True))
        candidates = {number: others.pop(number) for number in assets.pellet_ids.tolist()}
        self.goals = Goals(candidates, others, assets.goal_xy[assets.pellets :].tolist())
        own = "games", "alive", "waits", "aborts"
        rules = zeros(kernels.RuleArrays, own, N=1, P=assets.pellets, C=self.hold + 1)
        self._games, self._alive, self._waits, _ = rules.values()
        self._games["seed"] = seed
        self._games["pellets"], self._games["refuges"] = assets.pellets, assets.refuges
        count = len(config.clyde.ghosts)
        self._ghosts = np.zeros((1, count), dtype=GHOST)
        self._ghosts["place"] = -1
        self._reset_beliefs()
        self._cells = np.zeros((1, count, 1), dtype=np.int32)  # only the last cell of each ghost's path is known
        self._obstacles = np.zeros((1, count, 5))
        self._stamp_ns: list[int | None] = [None] * count
        self._seen_s: float | None = None
        self._power = self._levels.level(0).arrays["power"][: assets.pellets]
        self.goals.power[: assets.pellets] = self._power  # until reports say otherwise
        self._written = Situation.empty(1, self.hold + 1, count, self._levels)
        self._request = np.array([(self._written.table.address, -1)], dtype=REQUEST)
        self._view_table = Table(
            ViewArrays,
            rules=kernels.RuleArrays(
                **rules, obstacles=self._obstacles, parameters=self._parameters, levels=self._levels.addresses
            ),
            ghosts=self._ghosts,
            ghost_paths=self._cells,
            request=self._request,
            summary=np.zeros((len(kernels.SUMMARY), 1), dtype=np.int64),
        )

    def begin(self) -> None:
        """Start a round: reset beliefs and distances."""
        self._games["tick"] = 0
        self._games["closing"] = 0.0
        self._seen_s = None
        self._reset_beliefs()

    def _reset_beliefs(self) -> None:
        for ghost in self._ghosts[0]:
            reset_ghost_belief(ghost)

    @property
    def unseen(self) -> list[str]:
        return [GHOST_NAMES[k] for k, stamp_ns in enumerate(self._stamp_ns) if stamp_ns is None]

    @property
    def ghosts(self) -> list[tuple[float, float]]:
        """Last observed position of each ghost, m; NaN if never observed."""
        return [
            (math.nan, math.nan) if stamp_ns is None else (float(ghost["x"]), float(ghost["y"]))
            for ghost, stamp_ns in zip(self._ghosts[0], self._stamp_ns, strict=True)
        ]

    def see_ghost(self, number: int, x: float, y: float, stamp_ns: int) -> None:
        """Record that a ghost is at (x, y), m, at ``stamp_ns``; its velocity is taken from its last move."""
        ghost, before_ns = self._ghosts[0, number], self._stamp_ns[number]
        if before_ns == stamp_ns:
            return
        period = 0.0 if before_ns is None else (stamp_ns - before_ns) / 1e9
        dx, dy = x - ghost["x"], y - ghost["y"]
        if period > 0 and math.hypot(dx, dy) <= 2 * self.clyde_speed_mps * period + _JUMP_M:
            ghost["vx"], ghost["vy"] = dx / period, dy / period
        else:  # first observation, teleport, or a clock was set back
            ghost["vx"] = ghost["vy"] = 0.0
            reset_ghost_belief(ghost)
        ghost["x"], ghost["y"] = x, y
        self._obstacles[0, number, :2] = x, y
        self._stamp_ns[number] = stamp_ns
        moving, cells = np.array([ghost[name] for name in ("x", "y", "vx", "vy")]), self.assets.clyde
        self._cells[0, number, 0], _ = step_of(moving, cells.position, cells.graph)

    def pellets(self, shown: Mapping[int, tuple[float, float]], power: Collection[int] = ()) -> Pellets:
        """Compare reported pellets (positions by id) with the map; positions may differ by one cell edge.

        ``power`` are the ids of power pellets among them, which are remembered.
        """
        known, unknown = {}, []
        for number, (x, y) in shown.items():
            own = self.goals.positions.get(number)
            if own is not None and math.hypot(own[0] - x, own[1] - y) <= self.assets.grid.resolution:
                known[number] = own
                self.goals.power[self.goals.slot[number]] = number in power
            else:
                unknown.append(number)
        self._power[:] = self.goals.power[: self.assets.pellets]
        return Pellets(known, tuple(unknown))

    def nearest_ghost_m(self, at: tuple[float, float]) -> float:
        """Return the straight distance, m, from a place to the nearest ghost that is not harmless."""
        return float(kernels.nearest(*at, self._obstacles[0], np.int32(self._games["step"][0]))[1])

    def out_of_reach(self, pellets: Iterable[int]) -> list[int]:
        return [number for number in pellets if self.goals.slot[number] >= self.goals.candidates]

    def off_the_map(self, x: float, y: float) -> bool:
        """Return True if a position, m, is more than ``_AWAY_M`` from all drivable cells."""
        grid = self.assets.grid
        column, row = cell_of(grid.affine, *grid.shape, x, y)
        near = self.assets.cell_xy[grid.snap[row, column]]
        return math.hypot(near[0] - x, near[1] - y) > _AWAY_M

    def goal(self, candidate: int) -> Place | None:
        if candidate == self.hold:
            return None
        x, y = self.assets.goal_xy[candidate].tolist()
        is_pellet = candidate < self.assets.pellets
        return Place(candidate, x, y, int(self.assets.pellet_ids[candidate]) if is_pellet else None)

    def situation(self, seen: Seen, player: int = -1) -> Situation:
        """Return the situation (N = 1) of the robot, or of ghost ``player``. Raises ValueError for unseen ghosts."""
        if self.unseen:
            raise ValueError(f"{self.unseen[0]} has not been seen yet")
        g = self._games[0]
        g["x"], g["y"], g["heading"] = seen.pose
        g["pursued"] = seen.pursued
        self._ghosts["speed"] = self.clyde_speed_mps
        self._alive[:] = False
        slot, pellets = self.goals.slot, self.goals.candidates
        self._alive[0, [slot[number] for number in seen.left if number in slot and slot[number] < pellets]] = True
        g["spawned"] = self._alive.sum()
        if seen.harmless_s is not None:
            self._obstacles[0, :, HARMLESS_UNTIL:] = g["step"] + seen.harmless_s / self._config.physics_step_s
        self._waits[:] = 0
        self._waits[0, list(seen.masked)] = g["step"] + 1
        self._watch_distance(seen)
        self._request["player"] = player
        write_situations(self._view_table.address, 0, 1)
        situation = self._written.copy()
        situation.time_s[0] = seen.time_s
        situation.robot_velocity[0] = seen.velocity
        situation.pose_age_s[0] = seen.pose_age_s
        g["tick"] += 1
        return situation

    def sample_situation(self, player: int = -1) -> Situation:
        """Return a situation at the home pose with all pellets, to warm up a policy; this view does not change."""
        other = RobotView(self.assets, self._config, levels=self._levels)
        x, y = self.assets.clyde.position[self.assets.spawn_cells[0]].tolist()
        for number in range(len(self._stamp_ns)):
            other.see_ghost(number, x, y, 0)
        hx, hy, heading = self.assets.grid.home.tolist()
        return other.situation(Seen(0.0, (hx, hy, heading), left=self.assets.pellet_ids.tolist()), player)

    def compile_kernels(self) -> None:
        """Compile all kernels in advance; this view does not change."""
        other = RobotView(self.assets, self._config, levels=self._levels)
        x, y = self.assets.clyde.position[self.assets.spawn_cells[0]].tolist()
        pose = tuple(self.assets.grid.home.tolist())
        for time_s in (0.0, 0.5):  # the second time measures motion
            for number in range(len(self._stamp_ns)):
                other.see_ghost(number, x + time_s / 10, y, int(time_s * 1e9))
            other.situation(Seen(time_s, pose, left=self.assets.pellet_ids.tolist()))
        other.off_the_map(0.0, 0.0)

    def _watch_distance(self, seen: Seen) -> None:
        g, x, y = self._games[0], *seen.pose[:2]
        passed_s = math.inf if self._seen_s is None else seen.time_s - self._seen_s
        if 0 <= passed_s < self._config.execution.tick_s / 2:
            return
        distance = self.nearest_ghost_m((x, y))
        nowhere = max(distance, g["distance"]) == kernels.NOWHERE_M
        closes = 0 < passed_s < math.inf and not nowhere
        g["closing"] = closing_speed(g["distance"], distance, passed_s) if closes else 0.0
        g["distance"] = distance
        if 0 < passed_s < math.inf:
            if seen.harmless_s is not None:
                harmless = self._obstacles[0, :, HARMLESS_UNTIL] > g["step"]
                self._ghosts["seen_cell"][0, harmless] = -1  # their motion says nothing about their behaviour
            p = self._parameters[0]
            where = (x, y), int(g["tick"]), int(self._levels.addresses[0])
            watch(self._ghosts[0], self._cells[0], *where, float(p["arcade_m"]), float(p["tick_s"]))
        self._seen_s = seen.time_s
