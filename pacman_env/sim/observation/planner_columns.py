"""The columns of the planner's features: each is declared once, by its name; kernels write them by it.

Lengths are path lengths unless they are called distances, m, capped at ``FAR_M``. No column is beyond ``MOST``. The
number behind a slash is what the value is divided by.
"""

import enum

FAR_M = 20.0
MOST = 5.0
GHOST_TOKENS = 4  # the nearest ghosts, from the nearest on


class CandidateColumn(enum.IntEnum):
    """Number the columns of a candidate; Clyde is the nearest ghost."""

    IS_PELLET = 0  # 1 or 0, and the next three
    IS_REFUGE = enum.auto()
    IS_HOLD = enum.auto()
    IS_CURRENT = enum.auto()  # the goal pursued now
    PATH_ROBOT = enum.auto()  # / 5 m
    NEARNESS_ROBOT = enum.auto()  # exp(-length / 2 m)
    PATH_CLYDE = enum.auto()  # / 5 m, of the nearest of all ghosts by path
    NEARNESS_CLYDE = enum.auto()
    TIME_MARGIN = enum.auto()  # / 20 s: when Clyde is there, less when the robot is, -2 to 2
    CLYDE_DISTANCE = enum.auto()  # / 5 m, from Clyde
    CAUGHT_SOON = enum.auto()  # probability, and the next two (prediction.py, as the six behind them)
    CAUGHT = enum.auto()
    APPROACHED = enum.auto()
    CLOSEST_MEAN = enum.auto()  # / 3 m
    CLOSEST_LEAST = enum.auto()  # / 3 m
    TURN_COSINE = enum.auto()
    TOWARDS_CLYDE = enum.auto()
    STANDING_CLEARANCE = enum.auto()  # / 3 m
    NEAREST_PELLET = enum.auto()  # / 5 m, from here to the nearest other one
    MEAN_PELLET = enum.auto()  # / 5 m, from here to all others
    PELLETS_AROUND = enum.auto()  # / 4, within 2.5 m
    CLYDE_APART = enum.auto()  # m, how near a ghost can come, at most 1
    HANDCRAFTED_COST = enum.auto()  # / 5, of a pellet
    BEYOND_NEAREST = enum.auto()  # / 5 m, by which it is farther than the nearest pellet
    HUNTED = (
        enum.auto()
    )  # 1: ghosts come for the robot, and the next columns say what becomes of it (coarse/outlook.py)
    HUNTED_CAUGHT = enum.auto()
    HUNTED_ARRIVES = enum.auto()  # / 15 s
    HUNTED_CLOSEST = enum.auto()  # / 3 m
    HUNTED_LEAD = enum.auto()  # / 5 m
    HUNTED_COLLECTED = enum.auto()  # / 3 pellets
    HUNTED_WAYS_ON = enum.auto()  # share
    HUNTED_LEAD_AFTER = enum.auto()  # / 5 m


class GlobalColumn(enum.IntEnum):
    """Number the columns of the situation; the columns of the ghosts' tokens follow."""

    CLYDE_DISTANCE = 0  # / 5 m
    CLYDE_NEAR = enum.auto()  # exp(-distance / m)
    CLOSING_SPEED = enum.auto()  # / 0.5 m/s
    CLYDE_SPEED = enum.auto()  # / 0.5 m/s
    V = enum.auto()  # / 0.3 m/s
    OMEGA = enum.auto()  # / 2 rad/s
    PELLETS_LEFT = enum.auto()  # / 8
    LAST_PELLET = enum.auto()  # 1 or 0
    CLYDE_TOWARDS = enum.auto()  # cosine of its velocity and the direction to the robot
    POSE_AGE = enum.auto()  # / 5 s
    NEAREST_WAY = enum.auto()  # / 5 m, to a pellet
    TIME_LEFT = enum.auto()  # / 200 s
    TIME_SHORT = enum.auto()  # exp(-time left / 30 s)
    COMING = enum.auto()  # ghosts that are believed to come for the robot


class TokenColumn(enum.IntEnum):
    """Number the columns of one of the nearest ghosts."""

    THERE = 0  # 1 or 0
    DISTANCE = enum.auto()  # / 5 m
    NEAR = enum.auto()  # exp(-distance / m)
    PATH = enum.auto()  # / 5 m, no path is shorter
    TOWARDS = enum.auto()  # cosine, as CLYDE_TOWARDS
    SPEED = enum.auto()  # / 0.5 m/s
    ARCADE = enum.auto()  # probability, and the next two
    CHASE = enum.auto()
    OTHER = enum.auto()


CANDIDATE_FEATURES = tuple(column.name.lower() for column in CandidateColumn)
GLOBAL_FEATURES = (
    *(column.name.lower() for column in GlobalColumn),
    *(f"ghost_{k}_{column.name.lower()}" for k in range(GHOST_TOKENS) for column in TokenColumn),
)
