"""Local controller of the simulated Nav2: converts a plan to wheel speeds and a force on the body.

Roll-outs over (v, omega) within the base's limits are scored on progress along the plan, wall clearance and distance to
Clyde. Kernels work on one game's record ``g`` and its plan ``path`` (PATH_POINTS, 2), m. ``p`` is a record of
``PARAMETERS``, v and w are m/s and rad/s, ``pose`` is a ``Pose``, ``around`` are ``Obstacles``, and ``level`` is a
``planner.DriveMap`` or the arrays of a level.
"""

import math
from typing import NamedTuple

import numpy as np

from ...config import Config
from ...engine.jit import kernel
from .grid import cell_of

LOOKAHEAD_M = 0.35  # to the target point of pure pursuit
_ROTATE_COS = 0.765  # cosine of the angle off the path (0.7 rad) beyond which the robot turns on the spot
HORIZON_S = 0.8  # duration of a roll-out
_SAMPLES = 3  # points tested along a roll-out
_BRAKE = 0.7  # share of the base's braking used when a turn on the spot ends


#: Constants of :func:`start_s`; values from :func:`start_values`.
START_FIELDS = tuple((name, np.float64) for name in ("free_turn", "turn_radps", "speed_up_s", "late_s"))


def start_values(config: Config) -> tuple[float, float, float, float]:
    """Return the values of ``START_FIELDS``.

    These are the largest turn that costs no time (rad), the turn rate beyond it (rad/s), the time lost by speeding up
    (s), and any other delay (s). For MPPI, the start times computed from them are within 1 s on open floor.
    """
    if config.nav2.controller == "pure_pursuit":
        return 0.7, 1.2, 0.0, 0.0
    return 0.0, 0.9 * config.mppi.turn_radps, 1.0 / config.mppi.speed_response, 0.4


@kernel
def start_s(off, v, p):  # type: ignore[no-untyped-def]
    """Return the seconds lost by turning to a path ``off`` rad from the heading and speeding up.

    ``v`` is the present speed as a share of the full speed; ``p`` is a record with the fields ``START_FIELDS``.
    """
    return p.late_s + max(off - p.free_turn, 0.0) / p.turn_radps + p.speed_up_s * (1.0 - v * math.cos(off))


@kernel
def _turned(c, s, angle):  # type: ignore[no-untyped-def]
    """Rotate a heading (cosine, sine) by a small angle, rad, using a series with an error of 1e-5 at 0.5 rad."""
    a2 = angle * angle
    ca = 1.0 - a2 * (0.5 - a2 * (1.0 / 24.0))
    sa = angle * (1.0 - a2 * (1.0 / 6.0 - a2 * (1.0 / 120.0)))
    return c * ca - s * sa, s * ca + c * sa


class Pose(NamedTuple):
    """Believed pose of the robot."""

    x: float  # m
    y: float
    cos: float  # cosine of the heading
    sin: float


class Obstacles(NamedTuple):
    """Clearance at the robot's pose, and Clyde's position if he is near."""

    free_cm: int  # clearance at the robot
    clyde_near: bool
    clyde_x: float  # m
    clyde_y: float


class Target(NamedTuple):
    """Target point of the controller, relative to the robot along the axes of the map."""

    x: float  # m
    y: float
    omega: float  # rad/s, turn rate of the direct arc


@kernel
def _clear(pose, v, w, around, p, level):  # type: ignore[no-untyped-def]
    """Return the cost, m, of driving (v, w) from a pose for ``HORIZON_S``, or -1 if the arc is not admissible.

    The cost is the sum of the amounts by which the clearance is too small for comfort at ``_SAMPLES`` points of the
    arc. A point inside the inscribed radius, or inside Clyde's region, is only admissible if it is not worse than the
    robot's position, which lets the robot get out.
    """
    x, y, ch, sh = pose.x, pose.y, pose.cos, pose.sin
    cx, cy = around.clyde_x, around.clyde_y
    cost = 0.0
    rows, columns = level.clearance_cm.shape
    # The chord from the start turns by the same small angle from point to point.
    step_s = HORIZON_S / _SAMPLES
    ct, st = _turned(1.0, 0.0, 0.5 * w * step_s)
    for k in range(1, _SAMPLES + 1):
        ch, sh = ch * ct - sh * st, sh * ct + ch * st
        s = v * step_s * k
        px, py = x + s * ch, y + s * sh
        column, row = cell_of(level.affine, rows, columns, px, py)
        free = level.clearance_cm[row, column]
        if free < p.comfort_cm:
            if free <= p.inscribed_cm and free < around.free_cm:
                return -1.0
            cost += 0.01 * (p.comfort_cm - free)
        if around.clyde_near:
            d2 = (px - cx) * (px - cx) + (py - cy) * (py - cy)
            now2 = (x - cx) * (x - cx) + (y - cy) * (y - cy)
            if d2 < p.clyde_keepout * p.clyde_keepout and d2 < now2 - 1e-9:
                return -1.0
        elif free > p.open_cm - int(100.0 * s):
            break  # clearance falls by at most the driven distance, so the rest is free
    return cost


@kernel
def limit(v, w, p):  # type: ignore[no-untyped-def]
    """Clip (v, omega) so that no wheel exceeds its limit; turning has priority over driving."""
    most = min(p.omega_max, p.wheel_max / p.half_base)
    w = min(max(w, -most), most)
    spare = p.wheel_max - abs(w) * p.half_base
    return min(max(v, -spare), spare), w


@kernel
def _turn_rate(forward, aside, limit, p):  # type: ignore[no-untyped-def]
    """Return the fastest turn rate, rad/s, up to ``limit``, at which the robot can still stop when it faces a point.

    The point is ``forward`` and ``aside`` (to the left) of the robot, m.
    """
    off = math.atan2(aside, forward)
    return math.copysign(min(limit, math.sqrt(2.0 * _BRAKE * p.omega_rate * abs(off))), off)


@kernel
def _angle(x, y):  # type: ignore[no-untyped-def]
    """Return atan2(y, x), rad, with an error of at most 0.004 rad, faster than ``math.atan2``."""
    ax, ay = abs(x), abs(y)
    t = min(ax, ay) / max(max(ax, ay), 1e-12)
    angle = t * (0.25 * math.pi + 0.273 * (1.0 - t))
    if ay > ax:
        angle = 0.5 * math.pi - angle
    if x < 0.0:
        angle = math.pi - angle
    return math.copysign(angle, y)


@kernel
def _mppi_command(g, off, p):  # type: ignore[no-untyped-def]
    """Return the target (v, omega) of MPPI for a path ``off`` rad from the heading.

    The robot turns towards the path. It drives slower with a larger heading error and with a higher turn rate.
    """
    turning = max(1.0 - abs(g.right - g.left) * p.per_base / p.mppi_turn_stops, 0.0)
    turned = min(max((p.mppi_stop_angle - abs(off)) * p.mppi_angle_slope, 0.0), 1.0)
    return g.speed_limit * turning * turned, min(max(p.mppi_gain * off, -p.mppi_turn), p.mppi_turn)


@kernel
def _approached(g, v, w, p):  # type: ignore[no-untyped-def]
    """Return the speed, m/s, and the turn rate, rad/s, of MPPI's next step, for the target velocities (v, w).

    MPPI improves its last plan a little in each cycle, so both values only approach their targets.
    """
    now, turn = 0.5 * (g.left + g.right), (g.right - g.left) * p.per_base
    return limit(now + p.mppi_speed_share * (v - now), turn + p.mppi_turn_share * (w - turn), p)


@kernel
def _other_way(g, path, pose, target, around, p, level):  # type: ignore[no-untyped-def]
    """Return a command (ok, v, omega) for the case that the direct arc to ``target``, a ``Target``, is not admissible.

    ``ok`` is False if there is no admissible command.
    """
    ch, sh = pose.cos, pose.sin
    v_max = g.speed_limit
    # Sample arcs for the best progress at the highest admissible speed.
    best_score = 1e9
    ok, best_v, best_w = False, 0.0, 0.0
    for k in range(4, 0, -1):
        for j in range(-4, 5):
            sv, sw = limit(v_max * k * 0.25, target.omega + 0.35 * j, p)
            cost = _clear(pose, sv, sw, around, p, level)
            if cost < 0.0:
                continue
            ca, sa = _turned(ch, sh, 0.5 * sw * HORIZON_S)
            s = sv * HORIZON_S
            ex, ey = s * ca - target.x, s * sa - target.y
            score = math.sqrt(ex * ex + ey * ey) + cost + 0.02 * abs(j)
            if score < best_score:
                best_score, ok, best_v, best_w = score, True, sv, sw
        if ok:
            return ok, best_v, best_w
    # No arc leads towards the target point, for example round a corner: creep along the path.
    near = min(g.nav_at + 2, g.nav_points - 1)
    tx, ty = path[near, 0] - pose.x, path[near, 1] - pose.y
    if around.clyde_near:  # shortcuts of a path along Clyde's region would enter it: aim farther out
        ox, oy = path[near, 0] - around.clyde_x, path[near, 1] - around.clyde_y
        out = max((p.clyde_keepout + 0.05) / math.sqrt(max(ox * ox + oy * oy, 1e-6)), 1.0) - 1.0
        tx, ty = tx + out * ox, ty + out * oy
    forward, aside = tx * ch + ty * sh, ty * ch - tx * sh
    if abs(aside) > 0.1 * forward:
        return True, 0.0, _turn_rate(forward, aside, 1.0, p)
    v = 0.25 * v_max
    return _clear(pose, v, 0.0, around, p, level) >= 0.0, v, 0.0


@kernel
def command(g, path, pose, p, level):  # type: ignore[no-untyped-def]
    """Run the local controller and return (ok, v, omega) for the next step; ``ok`` is False if the way is blocked."""
    bx, by, ch, sh = pose.x, pose.y, pose.cos, pose.sin
    points = g.nav_points
    at = g.nav_at
    best = (path[at, 0] - bx) ** 2 + (path[at, 1] - by) ** 2
    while at + 1 < points:
        d2 = (path[at + 1, 0] - bx) ** 2 + (path[at + 1, 1] - by) ** 2
        if d2 > best:
            break
        best = d2
        at += 1
    ahead = max(at, min(g.nav_ahead, points - 1))
    while ahead + 1 < points:
        if (path[ahead, 0] - bx) ** 2 + (path[ahead, 1] - by) ** 2 > p.lookahead * p.lookahead:
            break
        ahead += 1
    g.nav_at, g.nav_ahead = at, ahead
    tx, ty = path[ahead, 0] - bx, path[ahead, 1] - by
    forward, aside = tx * ch + ty * sh, ty * ch - tx * sh
    v_max = g.speed_limit
    if p.mppi:
        v, direct_w = _mppi_command(g, _angle(forward, aside), p)
        v, w = _approached(g, v, direct_w, p)
    else:
        if forward < 0.0 or forward * forward < _ROTATE_COS * _ROTATE_COS * (tx * tx + ty * ty):
            return True, 0.0, _turn_rate(forward, aside, p.omega_max, p)
        # Pure pursuit: the arc through the target point, slower for sharper arcs.
        by_distance = v_max / math.sqrt(max(tx * tx + ty * ty, 0.01))
        v, w = limit(forward * by_distance, 2.0 * aside * by_distance * by_distance / v_max, p)
        direct_w = w
    column, row = cell_of(level.affine, level.clearance_cm.shape[0], level.clearance_cm.shape[1], bx, by)
    free_here = level.clearance_cm[row, column]
    cx, cy = g.clyde_x, g.clyde_y
    reach = p.clyde_keepout + v_max * HORIZON_S + 0.05
    clyde_near = (bx - cx) ** 2 + (by - cy) ** 2 < reach * reach
    around = Obstacles(free_here, clyde_near, cx, cy)
    # Open areas need no roll-outs, and a roll-out that was clear for 0.8 s holds for one more step.
    if not clyde_near and (free_here > p.open_cm or g.nav_clear_step == g.step - 1):
        return True, v, w
    if _clear(pose, v, w, around, p, level) >= 0.0:
        g.nav_clear_step = g.step
        return True, v, w
    ok, v, w = _other_way(g, path, pose, Target(tx, ty, direct_w), around, p, level)
    if p.mppi:
        v, w = _approached(g, v, w, p)
    return ok, v, w


@kernel
def drive_wheels(g, v, w, p):  # type: ignore[no-untyped-def]
    """Let the wheels follow (v, w) within their acceleration, and set the force that gives the body their speed."""
    change = p.wheel_rate * p.dt
    left, right = v - w * p.half_base, v + w * p.half_base
    left = min(max(left, g.left - change), g.left + change)
    right = min(max(right, g.right - change), g.right + change)
    g.left, g.right = left, right
    speed, turn = 0.5 * (left + right), (right - left) * p.per_base
    # Chipmunk moves bodies before it changes velocities, so this velocity acts in the next step: its direction is the
    # heading at the middle of that step.
    g.heading += g.omega * p.dt
    c, s = _turned(g.heading_cos, g.heading_sin, g.omega * p.dt)
    g.heading_cos, g.heading_sin = c, s
    c, s = _turned(c, s, 0.5 * turn * p.dt)
    g.force_x = p.mass_rate * (speed * c - g.vx)
    g.force_y = p.mass_rate * (speed * s - g.vy)
    g.omega = turn


@kernel
def refresh_heading(g):  # type: ignore[no-untyped-def]
    """Compute the heading's unit vector exactly, once per tick; in between it is rotated step by step."""
    g.heading_cos, g.heading_sin = math.cos(g.heading), math.sin(g.heading)
