"""Columns of the planner features, which kernels write by name.

Path lengths are capped at ``FAR_M``, and no value exceeds ``MOST``. "/ 5 m" in a comment means that the value is
divided by 5 m, so it has no unit. The pages of the environments show these comments.
"""

import enum

from ..game.behaviour_belief import BELIEVED

FAR_M = 20.0
MOST = 5.0
GHOST_TOKENS = 4  # number of described ghosts, nearest first


class CandidateColumn(enum.IntEnum):
    """Columns of a candidate; Clyde is the nearest ghost."""

    IS_PELLET = 0  # 1 for a pellet, otherwise 0
    IS_REFUGE = enum.auto()  # 1 for a refuge, otherwise 0
    IS_HOLD = enum.auto()  # 1 for hold, otherwise 0
    IS_CURRENT = enum.auto()  # 1 for the current goal, otherwise 0
    PATH_ROBOT = enum.auto()  # path length from the robot / 5 m
    NEARNESS_ROBOT = enum.auto()  # exp(-path length from the robot / 2 m)
    PATH_CLYDE = enum.auto()  # shortest path length from a ghost (for hold: straight distance) / 5 m
    NEARNESS_CLYDE = enum.auto()  # exp(-the same length / 2 m)
    TIME_MARGIN = enum.auto()  # (arrival time of Clyde - arrival time of the robot) / 20 s, -2 to 2
    CLYDE_DISTANCE = enum.auto()  # straight distance from Clyde / 5 m
    CAUGHT_SOON = enum.auto()  # probability that a ghost comes within 0.45 m on the way, in the first 5 s
    CAUGHT = enum.auto()  # probability that a ghost comes within 0.45 m on the way, in the first 10 s
    APPROACHED = enum.auto()  # probability that a ghost comes within 0.8 m on the way, in the first 10 s
    CLOSEST_MEAN = enum.auto()  # smallest distance to a ghost on the way / 3 m: mean over the ghost's predicted paths
    CLOSEST_LEAST = enum.auto()  # smallest distance to a ghost on the way / 3 m: minimum over the predicted paths
    TURN_COSINE = enum.auto()  # cosine of the angle between the robot's heading and the start of the path
    TOWARDS_CLYDE = enum.auto()  # cosine of the angle between the start of the path and the direction to Clyde
    STANDING_CLEARANCE = enum.auto()  # smallest distance to a ghost on the way / 3 m, if the ghosts stood still
    NEAREST_PELLET = enum.auto()  # path length from the candidate to the nearest other pellet / 5 m
    MEAN_PELLET = enum.auto()  # mean path length from the candidate to all other pellets / 5 m
    PELLETS_AROUND = enum.auto()  # (number of other pellets within 2.5 m) / 4
    CLYDE_APART = enum.auto()  # distance from the candidate to the nearest place that a ghost can reach, at most 1 m
    HANDCRAFTED_COST = enum.auto()  # cost of a pellet by the scorer `clyde_aware` / 5 m, 0 for other candidates
    BEYOND_NEAREST = enum.auto()  # (path length from the robot - path length to the nearest pellet) / 5 m
    HUNTED = enum.auto()  # 1 if ghosts approach the robot, otherwise 0: then the next seven columns are 0, too
    HUNTED_CAUGHT = enum.auto()  # 1 if the robot is caught on the way
    HUNTED_ARRIVES = enum.auto()  # time until arrival or capture / 15 s
    HUNTED_CLOSEST = enum.auto()  # smallest distance to a ghost on the way / 3 m
    HUNTED_LEAD = enum.auto()  # shortest path length from a ghost to the robot on arrival / 5 m
    HUNTED_COLLECTED = enum.auto()  # pellets collected on the way / 3
    HUNTED_WAYS_ON = enum.auto()  # share of the next paths, from the candidate to other goals, that the robot survives
    HUNTED_LEAD_AFTER = enum.auto()  # shortest path length from a ghost at the end of the best of these paths / 5 m
    START = enum.auto()  # time that the robot needs to turn to the path and to speed up / 5 s
    IS_POWER = enum.auto()  # 1 for a power pellet, otherwise 0


class GlobalColumn(enum.IntEnum):
    """Columns of the whole situation; the columns of the ghosts follow."""

    CLYDE_DISTANCE = 0  # straight distance to the nearest ghost / 5 m
    CLYDE_NEAR = enum.auto()  # exp(-straight distance to the nearest ghost / 1 m)
    CLOSING_SPEED = enum.auto()  # speed at which that distance shrinks / 0.5 m/s
    CLYDE_SPEED = enum.auto()  # speed of the nearest ghost in this round / 0.5 m/s
    V = enum.auto()  # speed of the robot / 0.3 m/s
    OMEGA = enum.auto()  # turn rate of the robot / 2 rad/s
    PELLETS_LEFT = enum.auto()  # pellets left / 8
    LAST_PELLET = enum.auto()  # 1 if one pellet is left, otherwise 0
    CLYDE_TOWARDS = enum.auto()  # cosine between the velocity of the nearest ghost and the direction to the robot
    POSE_AGE = enum.auto()  # age of the believed pose / 5 s
    NEAREST_WAY = enum.auto()  # path length to the nearest pellet / 5 m
    TIME_LEFT = enum.auto()  # time left / 200 s
    TIME_SHORT = enum.auto()  # exp(-time left / 30 s)
    COMING = enum.auto()  # number of ghosts that are believed to approach the robot
    FRIGHTENED = enum.auto()  # longest time for which a ghost stays frightened / 10 s


class TokenColumn(enum.IntEnum):
    """Columns of one of the nearest ghosts; the probabilities of its behaviours follow."""

    THERE = 0  # 1 if these columns describe a ghost, otherwise 0
    DISTANCE = enum.auto()  # straight distance to the robot / 5 m
    NEAR = enum.auto()  # exp(-straight distance to the robot / 1 m)
    PATH = enum.auto()  # lower bound of the path length to the robot / 5 m
    TOWARDS = enum.auto()  # cosine between its velocity and the direction to the robot
    SPEED = enum.auto()  # speed in this round / 0.5 m/s


#: The probability of wandering is left out, because it follows from the others.
TOKEN_FEATURES = (*(column.name.lower() for column in TokenColumn), *BELIEVED[1:])
CANDIDATE_FEATURES = tuple(column.name.lower() for column in CandidateColumn)
GLOBAL_FEATURES = (
    *(column.name.lower() for column in GlobalColumn),
    *(f"ghost_{k}_{name}" for k in range(GHOST_TOKENS) for name in TOKEN_FEATURES),
)
