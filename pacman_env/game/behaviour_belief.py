"""What a ghost is believed to do, from its moves: probabilities of the table's behaviours, and of any other.

A move is compared with what each behaviour would have done. ``chase`` comes nearer to the robot by path; ``arcade``
does so from afar and goes to its corner when it is near. ``wander`` goes to one of the map's places, which are equally
likely, and does not turn round on its way: where the ways to the places that it may be going to part, the share that
it goes on with is the likelihood of the move. On the only way to all of them a move towards the robot says nothing,
however long the way is. A ghost that is sent from outside is none of them: it may turn and stand.
"""

BELIEVED = ("wander", "arcade", "chase", "other")
WANDERS, ARCADE, CHASES, OTHER = range(len(BELIEVED))
COMES = 0.5  # probability above which a ghost is taken to come for the robot
PRIOR = (0.55, 0.15, 0.2, 0.1)
ANY_PLACE = -1  # all bits
_FORGOTTEN = 0.005  # of the belief at each move: a ghost may change what it does
#: Likelihood of a move of a ghost that has a target, by the share of it that went towards the target. Measured: 0.98 to
#: 1.0, 0.0 to 0.02 and 0.0; but moves across follow one another where the robot's believed place jumps or the ghost
#: goes round something, so that one says little.
_TOWARDS_FROM, _ACROSS_FROM = 0.5, 0.0
_TOWARDS, _ACROSS, _AWAY = 0.95, 0.5, 0.02
_NEW_TARGET = 0.08  # of a move that leads to none of the places that a wanderer was going to, as measured
#: Likelihood of turning round: of wandering, chasing, arcade far from the robot, being sent; of the last not to turn.
_TURN_WANDERING, _TURN_CHASING, _TURN_ARCADE, _TURN_OTHER, _ON_OTHER = 0.02, 0.09, 0.5, 0.13, 0.87
_STANDS = (0.02, 0.5, 0.1, 0.5)  # standing, for each behaviour
_ARRIVED = (0.02, 0.5, 0.5, 0.5)  # standing beside the robot: a chaser may not come nearer
ARRIVED_M = 1.0


def evidence(share):  # type: ignore[no-untyped-def]
    """How likely a move is if the ghost has the target that it approached by this share of the move's length."""
    if share >= _TOWARDS_FROM:
        return _TOWARDS
    return _ACROSS if share >= _ACROSS_FROM else _AWAY


def update_belief(belief, places_share, robot_share, corner_share, near, turned):  # type: ignore[no-untyped-def]
    """Update ``belief``, probabilities in the order of ``BELIEVED``, after a move.

    Args:
        places_share: of the places that it may have been going to, those that it came nearer to; 0: none.
        robot_share: length by which its path to the robot got shorter, of the length of the move.
        corner_share: likewise of the path to its corner.
        near: the robot was nearer than the distance at which ``arcade`` turns away.
        turned: the move went against the one before.
    """
    chase = evidence(robot_share)
    arcade = evidence(corner_share) if near else chase
    if turned:
        arcade *= 1.0 if near else _TURN_ARCADE  # it turns wherever it comes near, and back again
        weigh(belief, (_TURN_WANDERING, arcade, chase * _TURN_CHASING, _TURN_OTHER))
    else:
        wander = (1.0 - _NEW_TARGET) * places_share if places_share > 0.0 else _NEW_TARGET
        weigh(belief, (wander, arcade, chase, _ON_OTHER * wander))


def update_standing(belief, robot_m):  # type: ignore[no-untyped-def]
    """Update ``belief`` of a ghost that did not move, so far from the robot, m."""
    weigh(belief, _ARRIVED if robot_m <= ARRIVED_M else _STANDS)


def weigh(belief, likelihoods):  # type: ignore[no-untyped-def]
    total = 0.0
    for k in range(len(belief)):
        belief[k] *= likelihoods[k]
        total += belief[k]
    for k in range(len(belief)):
        belief[k] = belief[k] / total * (1.0 - _FORGOTTEN) + PRIOR[k] * _FORGOTTEN


def comes(belief):  # type: ignore[no-untyped-def]
    """Whether a ghost is taken to come for the robot; ``belief`` (4, ...) may be of many ghosts."""
    return belief[ARCADE] + belief[CHASES] > COMES


def taken_for(belief):  # type: ignore[no-untyped-def]
    """What a ghost is taken to do, as a number in ``BELIEVED``; one that does not come is taken to wander."""
    if not comes(belief):
        return WANDERS
    return CHASES if belief[CHASES] >= belief[ARCADE] else ARCADE


def forget(ghost):  # type: ignore[no-untyped-def]
    """A ghost is somewhere else now, or a round begins: nothing has been seen of it."""
    for k in range(len(PRIOR)):
        ghost.belief[k] = PRIOR[k]
    ghost.seen_cell = -1
    ghost.places = ANY_PLACE
