"""Poses in the plane as frames: put together and turned round, as TF does."""

from __future__ import annotations

import math

from ...world.navigation.localization import wrap

Pose = tuple[float, float, float]  # x, y in m, heading in rad


def compose(a: Pose, b: Pose) -> Pose:
    """The pose ``b``, given in the frame ``a``, in the frame that ``a`` is given in."""
    cos, sin = math.cos(a[2]), math.sin(a[2])
    return a[0] + cos * b[0] - sin * b[1], a[1] + sin * b[0] + cos * b[1], wrap(a[2] + b[2])


def inverse(a: Pose) -> Pose:
    """The frame's own origin seen from ``a``: ``compose(a, inverse(a))`` is zero."""
    cos, sin = math.cos(a[2]), math.sin(a[2])
    return -cos * a[0] - sin * a[1], sin * a[0] - cos * a[1], wrap(-a[2])


def relative(a: Pose, b: Pose) -> Pose:
    """The pose ``b`` as seen from ``a``, both given in one frame: ``compose(a, relative(a, b))`` is ``b``."""
    return compose(inverse(a), b)
