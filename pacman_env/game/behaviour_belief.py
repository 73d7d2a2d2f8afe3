"""Estimate the behaviour of a ghost from its moves: probabilities of the known behaviours and of any other.

A move is compared with the moves of each behaviour. ``chase`` approaches the robot by path; ``arcade`` does so from
afar and goes to its corner if it is near. It stays near the distance at which it changes its target, where it may do
either. ``wander`` goes to one of the map's places, all equally likely, and does not turn round on its way. If the paths
to its possible places fork, the likelihood of the move is the share of places on the chosen branch. Without a fork, a
move towards the robot carries no information. A ghost that a policy controls (``other``) may turn and stand.
"""

#: The behaviours that are told apart: prior probability, likelihood of standing far from the robot, and likelihood of
#: standing near the robot, where a chaser cannot come nearer. Any other behaviour, such as a new one, is ``other``.
_BELIEVED = {
    "wander": (0.55, 0.02, 0.02),
    "arcade": (0.15, 0.5, 0.5),
    "chase": (0.2, 0.1, 0.5),
    "other": (0.1, 0.5, 0.5),
}
BELIEVED = tuple(_BELIEVED)
WANDERS, ARCADE, CHASES, OTHER = range(len(BELIEVED))
PRIOR, _STANDS, _ARRIVED = zip(*_BELIEVED.values(), strict=True)
COMES = 0.5  # probability above which a ghost counts as approaching the robot
ANY_PLACE = -1  # all bits are set: every place is possible
_FORGOTTEN = 0.005  # share of the belief replaced by the prior at each move, because a ghost may change its behaviour
#: Likelihood of a move of a ghost with a target, by the share of the move towards the target. Measured: 0.98 to 1.0
#: (towards), 0.0 to 0.02 (across) and 0.0 (away). But moves across come in series, while the ghost goes round an
#: obstacle or after a jump of the robot's believed position, so a single one carries little information.
_TOWARDS_FROM, _ACROSS_FROM = 0.5, 0.0
_TOWARDS, _ACROSS, _AWAY = 0.95, 0.5, 0.02
_NEW_TARGET = 0.08  # measured likelihood that a wandering ghost approaches no possible place
#: Likelihood of turning round: wander, chase, arcade, other. Likelihood of not turning: other.
_TURN_WANDERING, _TURN_CHASING, _TURN_ARCADE, _TURN_OTHER, _ON_OTHER = 0.02, 0.09, 0.5, 0.13, 0.87
ARRIVED_M = 1.0
#: Within this distance of the boundary ``arcade`` can have had both targets during a move. Measured on generated houses
#: and two maps: 0.1 to 0.75 m recognize it equally well, but the more, the more wandering ghosts are taken for it.
_BOUNDARY_M = 0.25


def evidence(share):  # type: ignore[no-untyped-def]
    """Return the likelihood that a ghost with a target makes a move that brings it nearer to the target.

    ``share`` is the length by which the path to the target became shorter, relative to the length of the move.
    """
    if share >= _TOWARDS_FROM:
        return _TOWARDS
    return _ACROSS if share >= _ACROSS_FROM else _AWAY


def arcade_share(robot_share, corner_share, seen_m, now_m, arcade_m):  # type: ignore[no-untyped-def]
    """Return the share of a move towards the target of ``arcade``: the robot from afar, its corner if it is near.

    At the boundary between both, or if the ghost crossed it, the target that it approached more counts.

    Args:
        robot_share: length by which its path to the robot became shorter, relative to the length of the move.
        corner_share: the same for the path to its corner.
        seen_m: straight distance from the robot before the move, m; ``now_m``: after the move.
        arcade_m: distance at which ``arcade`` changes its target, m.
    """
    near = seen_m <= arcade_m
    if near != (now_m <= arcade_m) or abs(seen_m - arcade_m) < _BOUNDARY_M:
        return max(robot_share, corner_share)
    return corner_share if near else robot_share


def update_belief(belief, places_share, robot_share, to_arcade_target, turned):  # type: ignore[no-untyped-def]
    """Update ``belief`` (4,), probabilities in the order of ``BELIEVED``, after a move of a ghost.

    Args:
        places_share: share of its possible destinations that the ghost approached; 0: none.
        robot_share: length by which its path to the robot became shorter, relative to the length of the move.
        to_arcade_target: share of the move towards the target of ``arcade`` (:func:`arcade_share`).
        turned: the move was opposite to the previous one.
    """
    chase, arcade = evidence(robot_share), evidence(to_arcade_target)
    if turned:
        weigh(belief, (_TURN_WANDERING, arcade * _TURN_ARCADE, chase * _TURN_CHASING, _TURN_OTHER))
    else:
        wander = (1.0 - _NEW_TARGET) * places_share if places_share > 0.0 else _NEW_TARGET
        weigh(belief, (wander, arcade, chase, _ON_OTHER * wander))


def update_standing(belief, robot_m):  # type: ignore[no-untyped-def]
    """Update ``belief`` (4,) about a ghost that did not move, at a distance of ``robot_m`` m from the robot."""
    weigh(belief, _ARRIVED if robot_m <= ARRIVED_M else _STANDS)


def weigh(belief, likelihoods):  # type: ignore[no-untyped-def]
    """Multiply ``belief`` (4,) by ``likelihoods`` (4,), normalize it, and mix in a little of ``PRIOR``."""
    total = 0.0
    for k in range(len(belief)):
        belief[k] *= likelihoods[k]
        total += belief[k]
    for k in range(len(belief)):
        belief[k] = belief[k] / total * (1.0 - _FORGOTTEN) + PRIOR[k] * _FORGOTTEN


def comes(belief):  # type: ignore[no-untyped-def]
    """Return True if a ghost with this belief (4,) counts as approaching the robot; a mask (...) for (4, ...)."""
    return belief[ARCADE] + belief[CHASES] > COMES


def taken_for(belief):  # type: ignore[no-untyped-def]
    """Return the index in ``BELIEVED`` of the behaviour assumed for ``belief`` (4,): wandering unless it comes near."""
    if not comes(belief):
        return WANDERS
    return CHASES if belief[CHASES] >= belief[ARCADE] else ARCADE


def reset_belief(ghost):  # type: ignore[no-untyped-def]
    """Set a ghost's belief to ``PRIOR``, after a teleport or at the start of a round."""
    for k in range(len(PRIOR)):
        ghost.belief[k] = PRIOR[k]
    ghost.seen_cell = -1
    ghost.places = ANY_PLACE
