"""Ghosts that walk on a grid of streets by the rules of their behaviours, and what is believed of them."""

import functools
import math
from collections import deque

import numpy as np

from pacman_env.game.behaviour_belief import BELIEVED, PRIOR, arcade_share, taken_for, update_belief

Cell = tuple[int, int]
CELL_M, TICK_S, ROBOT_MPS, ARCADE_M, CAUGHT_M = 0.1, 0.5, 0.3, 2.0, 0.4
SEEN_CELLS = 3  # length of a move that is compared with the behaviours
#: Streets of one cell, 1.2 m apart.
STREETS = [(x, y) for x in range(61) for y in range(61) if x % 12 == 0 or y % 12 == 0]
CORNER = STREETS[0]


def around(cell: Cell) -> list[Cell]:
    x, y = cell
    return [cell, (x + 1, y), (x - 1, y), (x, y + 1), (x, y - 1)]


@functools.cache
def cells_to(target: Cell) -> dict[Cell, int]:
    """Path length from each cell to the target, in cells."""
    lengths, waiting = dict.fromkeys(STREETS, -1), deque([target])
    lengths[target] = 0
    while waiting:
        cell = waiting.popleft()
        for other in around(cell):
            if lengths.get(other) == -1:
                lengths[other] = lengths[cell] + 1
                waiting.append(other)
    return lengths


class Walker:
    """A robot or a ghost; without a target it walks from one drawn cell to the next."""

    def __init__(self, generator: np.random.Generator, speed_mps: float) -> None:
        self.generator, self.cells_per_tick, self.rest = generator, speed_mps * TICK_S / CELL_M, 0.0
        self.cell, self.target = self.draw(), self.draw()

    def draw(self) -> Cell:
        return STREETS[self.generator.integers(len(STREETS))]

    def move(self, target: Cell | None = None) -> None:
        self.target = target or self.target
        self.rest += self.cells_per_tick
        while self.rest >= 1.0:
            self.rest -= 1.0
            if target is None and self.cell == self.target:
                self.target = self.draw()
            lengths = cells_to(self.target)
            self.cell = min((cell for cell in around(self.cell) if cell in lengths), key=lengths.__getitem__)

    def target_of(self, behaviour: str, robot: Cell, robot_m: float) -> Cell | None:
        if behaviour == "arcade":
            return CORNER if robot_m <= ARCADE_M else robot
        return robot if behaviour == "chase" else None


class Belief:
    """Compares the moves of one ghost with the behaviours, as the simulator does."""

    def __init__(self, ghost: Walker, robot: Walker) -> None:
        self.places = {ghost.draw() for _ in range(40)}
        self.possible, self.belief, self.step = self.places, np.array(PRIOR), (0, 0)
        self.seen = ghost.cell, robot.cell, CELL_M * math.dist(ghost.cell, robot.cell)

    def watch(self, ghost: Cell, robot: Cell) -> str:
        """Update the belief after a tick and return the name of the assumed behaviour."""
        before, robot_before, before_m = self.seen
        robot_m, length = CELL_M * math.dist(ghost, robot), math.dist(ghost, before)
        if length >= SEEN_CELLS:
            share = {
                cell: (cells_to(cell)[before] - cells_to(cell)[ghost]) / length
                for cell in {*self.places, robot_before, CORNER}
            }
            ahead = {place for place in self.places if share[place] >= 0.5}
            left = len(self.possible & ahead) / len(self.possible)
            self.possible = self.possible & ahead or ahead or self.places
            step = ghost[0] - before[0], ghost[1] - before[1]
            turned = step[0] * self.step[0] + step[1] * self.step[1] < 0
            to_robot = share[robot_before]
            to_target = arcade_share(to_robot, share[CORNER], before_m, robot_m, ARCADE_M)
            update_belief(self.belief, left, to_robot, to_target, turned)
            self.seen, self.step = (ghost, robot, robot_m), step
        return BELIEVED[taken_for(self.belief)]


def recognized(
    behaviour: str, speed_mps: float, seed: int, seconds: float = 120.0, after_s: float = 15.0
) -> list[bool]:
    """After each tick from ``after_s`` until the robot is caught by a chaser: is the ghost taken for what it is."""
    generator = np.random.default_rng(seed)
    robot, ghost = Walker(generator, ROBOT_MPS), Walker(generator, speed_mps)
    belief, verdicts = Belief(ghost, robot), []
    for tick in range(round(seconds / TICK_S)):
        ghost.move(ghost.target_of(behaviour, robot.cell, CELL_M * math.dist(ghost.cell, robot.cell)))
        robot.move()
        verdict = belief.watch(ghost.cell, robot.cell)
        if behaviour == "chase" and CELL_M * math.dist(ghost.cell, robot.cell) <= CAUGHT_M:
            break
        if tick >= after_s / TICK_S:
            verdicts.append(verdict == behaviour)
    return verdicts
