"""Bound and estimate on one map against one line-up of ghosts at one speed: a row of plain numbers.

The JSON of ``pacman-env bound`` is ``{"schema": 1, "version", "seed", "seeds", "preset", "maps", "arguments", "config",
"rows"}``, with ``seeds`` and ``maps`` as written by ``pacman-env compare``. Every row contains ``map``, ``ghosts``,
``clyde_speed`` (m/s), ``starts``, ``block_m`` (side of a block), ``robot_blocks`` and ``ghost_blocks``, and

- ``least_s``: lower bound of the time to collect all pellets, whatever the ghosts do;
- ``bounded``: numbers of the predictable ghosts; without any, the following bounds are trivial;
- ``safe_pairs``: share of the pairs of blocks from which the robot is never caught in the relaxed pursuit, by ghost;
- ``survival_bound``: share of the starts from which no single ghost ever catches the robot in the pursuit;
- ``caught_s``: for each start, the longest time until the robot is caught in the pursuit, null: never;
- ``bound``: share of the starts that are not lost, the upper bound; ``lost``: numbers of the lost starts;
- ``estimate``, ``estimate_ci`` (95 % Wilson), ``estimate_s`` (mean time if won, null: none), ``won`` (numbers of the
  starts): rounds of the coarse model, won by a search with perfect information; null without an estimate;
- ``contradictions``: number of starts that the search wins although the bound counts them as lost.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pacman_env.config import Config
from pacman_env.episodes.statistics import wilson
from pacman_env.game.ghosts import Behaviour, find_behaviour
from pacman_env.heuristics.search.search import is_predictable
from pacman_env.sim.coarse.model import MOST_PELLETS
from pacman_env.sim.core.batch import GameBatch
from pacman_env.sim.maps.assets import MapAssets, map_assets
from pacman_env.sim.observation.situation import Situation
from pacman_env.world.maps.occupancy import OccupancyMap

from .collecting import least_collection_s
from .estimate import Estimate
from .graph import Graph, build_graph, targets_of
from .pursuit import FOR_EVER, from_start, pace, survival

Row = dict[str, Any]


@dataclass(frozen=True)
class RowTask:
    """Work of one row, as plain data that can be sent to other processes and machines."""

    occupancy: OccupancyMap
    prepared: Config  # configuration of the first row, with which the map is prepared for all rows
    config: Config
    seeds: NDArray[np.uint64]
    width: int


def make_row(task: RowTask, played: Callable[[], Any] = lambda: None) -> Row:
    """Compute a row; ``played`` is called at the end of each start."""
    key = task.occupancy.hash, task.prepared, tuple(task.seeds.tolist())
    if key not in _last:
        _last.clear()
        _last[key] = MapBounds(map_assets(task.occupancy, task.prepared), task.seeds)
    return _last[key].row(task.config, task.width, played)


class MapBounds:
    """Computes the rows of one map; the pursuit of each ghost and speed is solved once."""

    def __init__(self, assets: MapAssets, seeds: NDArray[np.uint64]) -> None:
        self.assets, self.seeds = assets, seeds
        self.graph: Graph = build_graph(assets)
        self.home = self._block(*assets.grid.home[:2].tolist())
        self._targets: dict[tuple[str, int], NDArray[np.int16]] = {}
        self._solved: dict[tuple[str, int, float], tuple[NDArray[np.float64], float]] = {}

    def _block(self, x: float, y: float) -> int:
        column, row = self.assets.grid.to_cell(x, y)
        return int(self.graph.robot_block[self.assets.grid.snap[row, column]])

    def starts(self, config: Config) -> Situation:
        """Return the starts of the rounds, drawn as in the game."""
        batch = GameBatch(self.assets, config, len(self.seeds))
        batch.reset(np.arange(len(self.seeds)), self.seeds)
        return batch.situation()

    def caught_s(
        self, situation: Situation, number: int, behaviour: Behaviour, config: Config
    ) -> tuple[NDArray[np.float64], float]:
        """Return the longest times (N,) until this ghost alone catches the robot (inf: never), and the safe share."""
        key = behaviour.name, number, config.clyde.speed_mps
        if key not in self._solved:
            if key[:2] not in self._targets:
                self._targets[key[:2]] = targets_of(self.graph, self.assets, behaviour, config, number)
            step = pace(self.graph, config.robot.speed_mps, config.clyde.speed_mps)
            left = survival(self.graph, self._targets[key[:2]], step, config.execution.death_radius_m)
            column, row, _ = self.assets.grid.locate(situation.ghosts[:, number, :2].astype(np.float64))
            rows, columns = self.assets.grid.shape
            cells = self.assets.ghost_targets.snap[np.clip(row, 0, rows - 1), np.clip(column, 0, columns - 1)]
            times = from_start(self.graph, left, step, self.home, self.graph.ghost_block[cells])
            self._solved[key] = times, float(np.mean(left[:, :, 0] == FOR_EVER))
        return self._solved[key]

    def row(self, config: Config, width: int, played: Callable[[], Any] = lambda: None) -> Row:
        """Compute a row for the ghosts and speed in ``config``; ``width`` is the search width (0: no estimate)."""
        behaviours = [find_behaviour(name) for name in config.clyde.ghosts]
        situation = self.starts(config)
        bounded = [k for k, one in enumerate(behaviours) if is_predictable(one)]
        goals = self.assets.goal_xy[: self.assets.pellets]
        pellets = np.array([self._block(x, y) for x, y in goals.tolist()], dtype=np.int32)
        least = least_collection_s(self.graph, self.home, pellets, config)
        times = [self.caught_s(situation, k, behaviours[k], config) for k in bounded]
        caught = np.full(len(self.seeds), np.inf)
        for one, _ in times:
            caught = np.minimum(caught, one)
        lost = (caught < least) | (least > config.time_limit_s)
        row: Row = {
            "ghosts": ",".join(config.clyde.ghosts),
            "clyde_speed": config.clyde.speed_mps,
            "starts": len(self.seeds),
            "pellets": self.assets.pellets,
            "block_m": float(self.graph.edge_m),
            "robot_blocks": len(self.graph.robot_xy),
            "ghost_blocks": len(self.graph.ghost_xy),
            "least_s": least,
            "bounded": bounded,
            "safe_pairs": [share for _, share in times],
            "survival_bound": float(np.isinf(caught).mean()),
            "caught_s": [None if np.isinf(s) else round(float(s), 2) for s in caught],
            "bound": float(np.mean(~lost)),
            "lost": np.flatnonzero(lost).tolist(),
        }
        playable = width > 0 and len(bounded) == len(behaviours) and self.assets.pellets <= MOST_PELLETS
        return row | self._estimated(behaviours, situation, config, width if playable else 0, lost, played)

    def _estimated(
        self,
        behaviours: Sequence[Behaviour],
        situation: Situation,
        config: Config,
        width: int,
        lost: NDArray[np.bool_],
        played: Callable[[], Any],
    ) -> Row:
        if width == 0:
            for _ in self.seeds:
                played()
            names = ("estimate", "estimate_ci", "estimate_s", "won", "contradictions")
            return dict.fromkeys(names)
        estimate = Estimate(list(behaviours), config, width)
        won, times = np.zeros(len(self.seeds), dtype=np.bool_), np.zeros(len(self.seeds))
        for i in range(len(self.seeds)):
            won[i], times[i] = estimate.play(situation, i)
            played()
        return {
            "estimate": float(won.mean()),
            "estimate_ci": list(wilson(int(won.sum()), len(won))),
            "estimate_s": float(times[won].mean()) if won.any() else None,
            "won": np.flatnonzero(won).tolist(),
            "contradictions": int(np.count_nonzero(won & lost)),
        }


_last: dict[Any, MapBounds] = {}  # the last map of this process with its solutions, by its key
