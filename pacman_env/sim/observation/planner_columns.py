"""Columns of the planner features, which kernels write by name.

Lengths are path lengths in m, capped at ``FAR_M``, unless they are called distances. No value exceeds ``MOST``. A
comment such as "/ 5 m" gives the divisor of the value.
"""

import enum

FAR_M = 20.0
MOST = 5.0
GHOST_TOKENS = 4  # number of described ghosts, nearest first


class CandidateColumn(enum.IntEnum):
    """Columns of a candidate; Clyde is the nearest ghost."""

    IS_PELLET = 0  # 1 or 0, like the next three
    IS_REFUGE = enum.auto()
    IS_HOLD = enum.auto()
    IS_CURRENT = enum.auto()  # the current goal
    PATH_ROBOT = enum.auto()  # / 5 m
    NEARNESS_ROBOT = enum.auto()  # exp(-length / 2 m)
    PATH_CLYDE = enum.auto()  # / 5 m, of the ghost nearest by path
    NEARNESS_CLYDE = enum.auto()
    TIME_MARGIN = enum.auto()  # / 20 s: arrival time of Clyde minus arrival time of the robot, -2 to 2
    CLYDE_DISTANCE = enum.auto()  # / 5 m, from Clyde
    CAUGHT_SOON = enum.auto()  # probability, like the next two; these and the next five are from prediction.py
    CAUGHT = enum.auto()
    APPROACHED = enum.auto()
    CLOSEST_MEAN = enum.auto()  # / 3 m
    CLOSEST_LEAST = enum.auto()  # / 3 m
    TURN_COSINE = enum.auto()
    TOWARDS_CLYDE = enum.auto()
    STANDING_CLEARANCE = enum.auto()  # / 3 m
    NEAREST_PELLET = enum.auto()  # / 5 m, from the candidate to the nearest other pellet
    MEAN_PELLET = enum.auto()  # / 5 m, from the candidate to all other pellets
    PELLETS_AROUND = enum.auto()  # / 4, within 2.5 m
    CLYDE_APART = enum.auto()  # m, smallest distance that a ghost can reach, at most 1
    HANDCRAFTED_COST = enum.auto()  # / 5, for pellets
    BEYOND_NEAREST = enum.auto()  # / 5 m, path length beyond that to the nearest pellet
    HUNTED = enum.auto()  # 1 if ghosts approach the robot; the next columns then are its outlook (coarse/outlook.py)
    HUNTED_CAUGHT = enum.auto()
    HUNTED_ARRIVES = enum.auto()  # / 15 s
    HUNTED_CLOSEST = enum.auto()  # / 3 m
    HUNTED_LEAD = enum.auto()  # / 5 m
    HUNTED_COLLECTED = enum.auto()  # / 3 pellets
    HUNTED_WAYS_ON = enum.auto()  # share
    HUNTED_LEAD_AFTER = enum.auto()  # / 5 m
    START = enum.auto()  # / 5 s, to turn to the path and to speed up: what a change of the goal costs now
    IS_POWER = enum.auto()  # 1 for a power pellet


class GlobalColumn(enum.IntEnum):
    """Columns of the whole situation; the columns of the ghosts follow."""

    CLYDE_DISTANCE = 0  # / 5 m
    CLYDE_NEAR = enum.auto()  # exp(-distance / m)
    CLOSING_SPEED = enum.auto()  # / 0.5 m/s
    CLYDE_SPEED = enum.auto()  # / 0.5 m/s
    V = enum.auto()  # / 0.3 m/s
    OMEGA = enum.auto()  # / 2 rad/s
    PELLETS_LEFT = enum.auto()  # / 8
    LAST_PELLET = enum.auto()  # 1 or 0
    CLYDE_TOWARDS = enum.auto()  # cosine between Clyde's velocity and the direction to the robot
    POSE_AGE = enum.auto()  # / 5 s
    NEAREST_WAY = enum.auto()  # / 5 m, to a pellet
    TIME_LEFT = enum.auto()  # / 200 s
    TIME_SHORT = enum.auto()  # exp(-time left / 30 s)
    COMING = enum.auto()  # number of ghosts that are believed to approach the robot
    FRIGHTENED = enum.auto()  # / 10 s, longest time for which a ghost stays frightened


class TokenColumn(enum.IntEnum):
    """Columns of one of the nearest ghosts."""

    THERE = 0  # 1 or 0
    DISTANCE = enum.auto()  # / 5 m
    NEAR = enum.auto()  # exp(-distance / m)
    PATH = enum.auto()  # / 5 m, lower bound
    TOWARDS = enum.auto()  # cosine, see CLYDE_TOWARDS
    SPEED = enum.auto()  # / 0.5 m/s
    ARCADE = enum.auto()  # probability, like the next two
    CHASE = enum.auto()
    OTHER = enum.auto()


CANDIDATE_FEATURES = tuple(column.name.lower() for column in CandidateColumn)
GLOBAL_FEATURES = (
    *(column.name.lower() for column in GlobalColumn),
    *(f"ghost_{k}_{column.name.lower()}" for k in range(GHOST_TOKENS) for column in TokenColumn),
)
