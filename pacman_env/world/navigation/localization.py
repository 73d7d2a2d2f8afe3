"""Model AMCL's belief: when poses are published, their errors, and the TF pose in between; compose poses as frames.

At a filter update a new error is drawn, which may keep a share of the last one. Between updates odometry carries the
error along unchanged: TF gives the true pose with the error of the last update, while the latched message keeps the
pose of the update.
"""

import math
from typing import Any

import numpy as np

from ...engine.jit import kernel
from ...rng import normal


def record_fields(kind: Any, names: str) -> list[tuple[str, Any]]:
    """Return fields of a game's record for ``numpy.dtype``: one of type ``kind`` for each word of ``names``."""
    return [(name, kind) for name in names.split()]


LOCALIZATION_FIELDS = [
    *record_fields(np.float64, "error_x error_y error_heading"),  # at the last update: m, m, rad
    *record_fields(np.float64, "error_cos error_sin"),  # cosine and sine of error_heading
    *record_fields(np.float64, "bias_x bias_y bias_heading"),  # mean error, to which the filter converges
    *record_fields(np.float64, "amcl_x amcl_y amcl_heading"),  # the latched pose
    *record_fields(np.int32, "amcl_step"),  # physics step of the last update
    *record_fields(np.float64, "odom_x odom_y odom_heading"),  # true pose at the last update
    *record_fields(np.float64, "sigma_xy sigma_heading"),  # m, rad
    *record_fields(np.float64, "error_kept"),  # correlation of successive errors
    *record_fields(np.float64, "update_distance update_angle"),  # m, rad: motion that triggers an update
    *record_fields(np.uint64, "localization_stream"),
]


@kernel
def wrap(angle):  # type: ignore[no-untyped-def]
    """Return the same angle in [-pi, pi)."""
    return angle - 2.0 * math.pi * math.floor((angle + math.pi) / (2.0 * math.pi))


@kernel
def update(g, step):  # type: ignore[no-untyped-def]
    """Update the filter of game ``g`` at a physics step: draw the error and publish the pose.

    At step 0 no old error is kept.
    """
    stream = g.localization_stream
    share = g.error_kept if step > 0 else 0.0
    new = math.sqrt(1.0 - share * share)  # keeps the standard deviation at sigma
    g.error_x = g.bias_x + share * (g.error_x - g.bias_x)
    g.error_y = g.bias_y + share * (g.error_y - g.bias_y)
    g.error_heading = g.bias_heading + share * (g.error_heading - g.bias_heading)
    if g.sigma_xy > 0.0:
        stream, a = normal(stream)
        stream, b = normal(stream)
        g.error_x += new * a * g.sigma_xy
        g.error_y += new * b * g.sigma_xy
    if g.sigma_heading > 0.0:
        stream, c = normal(stream)
        g.error_heading += new * c * g.sigma_heading
    g.error_cos, g.error_sin = math.cos(g.error_heading), math.sin(g.error_heading)
    g.localization_stream = stream
    g.odom_x, g.odom_y, g.odom_heading = g.x, g.y, g.heading
    g.amcl_x = g.x + g.error_x
    g.amcl_y = g.y + g.error_y
    g.amcl_heading = wrap(g.heading + g.error_heading)
    g.amcl_step = step


@kernel
def scan(g, step):  # type: ignore[no-untyped-def]
    """Process a laser scan at a physics step: update the filter if the robot has moved or turned enough."""
    if (
        abs(g.x - g.odom_x) > g.update_distance
        or abs(g.y - g.odom_y) > g.update_distance
        or abs(wrap(g.heading - g.odom_heading)) > g.update_angle
    ):
        update(g, step)


Pose = tuple[float, float, float]  # x, y in m, heading in rad


def compose(a: Pose, b: Pose) -> Pose:
    """Return the pose ``b``, given in frame ``a``, in the parent frame of ``a``."""
    cos, sin = math.cos(a[2]), math.sin(a[2])
    return a[0] + cos * b[0] - sin * b[1], a[1] + sin * b[0] + cos * b[1], wrap(a[2] + b[2])


def inverse(a: Pose) -> Pose:
    """Return the parent frame's origin as seen from ``a``: ``compose(a, inverse(a))`` is zero."""
    cos, sin = math.cos(a[2]), math.sin(a[2])
    return -cos * a[0] - sin * a[1], sin * a[0] - cos * a[1], wrap(-a[2])


def relative(a: Pose, b: Pose) -> Pose:
    """Return the pose ``b`` as seen from ``a``, both in one frame: ``compose(a, relative(a, b))`` is ``b``."""
    return compose(inverse(a), b)
