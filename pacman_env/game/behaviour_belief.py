"""What a ghost is believed to do, from its moves: probabilities of the table's behaviours, and of any other.

A move is compared with what each behaviour would have done. ``wander`` moves anywhere, but does not turn round on its
way; ``chase`` comes nearer to the robot by path; ``arcade`` does so from afar and goes to its corner when it is near.
A ghost that is sent from outside is none of them: it may turn and stand. One move is less evidence than its frequency
says, since a ghost that wanders keeps its direction for seconds.
"""

BELIEVED = ("wander", "arcade", "chase", "other")
WANDERS, ARCADE, CHASES, OTHER = range(len(BELIEVED))
COMES = 0.5  # probability above which a ghost is taken to come for the robot
PRIOR = (0.55, 0.15, 0.2, 0.1)
_FORGOTTEN = 0.005  # of the belief at each move: a ghost may change what it does
#: How much likelier a move is of a ghost that has a target, by the share of the move that went towards the target.
#: A ghost that wanders goes so far towards it in 45 % of its moves (`house`), which persist: 1.8, not 2.2.
_TOWARDS_FROM, _ACROSS_FROM = 0.5, 0.0
_TOWARDS, _ACROSS, _AWAY = 1.8, 0.5, 0.05
_TURN_WANDERING, _TURN_CHASING = 0.15, 0.7  # turning round, against a ghost that is sent from outside
_ON_OTHER = 0.87  # a move that did not turn round, likewise
_STANDS = (0.02, 0.5, 0.1, 0.5)  # standing, for each behaviour


def evidence(share):  # type: ignore[no-untyped-def]
    """How much likelier a move is if the ghost has the target that it approached by this share of the move's length."""
    if share >= _TOWARDS_FROM:
        return _TOWARDS
    return _ACROSS if share >= _ACROSS_FROM else _AWAY


def update_belief(belief, robot_share, corner_share, near, turned):  # type: ignore[no-untyped-def]
    """Update ``belief``, probabilities in the order of ``BELIEVED``, after a move.

    Args:
        robot_share: length by which its path to the robot got shorter, of the length of the move.
        corner_share: likewise of the path to its corner.
        near: the robot was nearer than the distance at which ``arcade`` turns away.
        turned: the move went against the one before.
    """
    wander, other, chase = 1.0, 1.0, evidence(robot_share)
    arcade = evidence(corner_share) if near else chase
    if turned:
        wander, chase = wander * _TURN_WANDERING, chase * _TURN_CHASING  # arcade turns wherever it comes near
    else:
        other *= _ON_OTHER
    weigh(belief, (wander, arcade, chase, other))


def update_standing(belief):  # type: ignore[no-untyped-def]
    """Update ``belief`` of a ghost that did not move."""
    weigh(belief, _STANDS)


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
