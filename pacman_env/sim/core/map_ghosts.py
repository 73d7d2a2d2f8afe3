"""The ghosts of one game on one map, moved by a clock from outside: the simulator's, without its robot."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ...config import Config
from ...engine.jit import kernel
from ...game import ghosts as rule
from ...rng import below
from ..maps.assets import MapAssets
from ..maps.level_stack import LevelStack
from . import ghosts, records
from .ghosts import Ghosts
from .parameters import batch_parameters
from .poses import Pose

_stream, _below = kernel(rule.ghost_stream), kernel(below)


class MapGhosts:
    """Ghosts that stand until :meth:`step` is called, on a map prepared under ``config``; the seed decides paths."""

    def __init__(self, assets: MapAssets, config: Config, seed: int) -> None:
        self.cells = assets.clyde
        self._assets, self._config = assets, config
        self._ghosts = Ghosts(1, config)
        self._ghosts.bind(LevelStack(assets, config), assets.pellets + assets.refuges)
        self._parameters = batch_parameters(config, assets.grid.resolution, assets.pellets, assets.refuges)
        self._parameters["use_tf"] = 1  # the pose that is given is the one believed
        self._games = np.zeros(1, dtype=records.GAME)  # where the robot is; a step's number never counts
        self._games["pellets"], self._games["refuges"] = assets.pellets, assets.refuges
        self._remembered = np.zeros((1, 1, len(self)), dtype=np.int16)
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
        """Put a ghost on a cell and forget the path that it was on."""
        ghosts.spawn_ghost(self._ghosts.state[0, number], cell, self._ghosts.paths[0, number], self.cells.position)

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
        ghosts.decide(self._table.address, 0)

    def rehearse(self, choices: NDArray[np.int64]) -> None:
        """Compile everything beforehand, and respawn."""
        self.decide(choices)
        self.step()
        self.respawn([])

    def step(self) -> None:
        ghosts.move(self._table.address, 0)
        for number, ghost in enumerate(self._ghosts.state[0]):
            if ghost["vx"] or ghost["vy"]:
                self._headings[number] = math.atan2(ghost["vy"], ghost["vx"])
