"""Where a vehicle is on its path, and what a sensor measures of the road ahead."""

from __future__ import annotations

import math

from steersman.kernels import path as paths
from steersman.kernels import vehicle
from steersman.kernels.compiled import kernel
from steersman.kernels.path import PathTable
from steersman.types import FloatArray

# Columns of a tracking row: the truth, whatever sensors say.
S, D, HEADING, COURSE, KAPPA, PATH_X, PATH_Y = range(7)
N_TRACKING = 7
# Columns of a state row that sensors measure: pose and velocities, the first ones.
N_MEASURED = 6
# Column of the error of v_x that is in proportion to it, behind the errors of those.
V_X_SCALE = 6
# Columns of an observation row before the waypoints (x0, y0, x1, y1, ... in the vehicle's frame).
O_D, O_HEADING, O_VX, O_VY, O_RATE, O_STEER, O_KAPPA = range(7)
O_PREVIEW = 7


@kernel
def wrap_angle(angle: float) -> float:
    """The same direction in (-pi, pi]."""
    return angle - 2.0 * math.pi * math.ceil(angle / (2.0 * math.pi) - 0.5)


@kernel
def total(values: FloatArray) -> float:
    """Sum of the values, which is finite only if all are."""
    out = 0.0
    for i in range(values.shape[0]):
        out += values[i]
    return out


@kernel
def track(table: PathTable, p: int, state: FloatArray, near: float, out: FloatArray) -> None:
    """Fill a tracking row: projection, errors and path point beside the centre of mass."""
    s, d, psi, kappa = paths.project_near(table, p, state[vehicle.X], state[vehicle.Y], near)
    heading = wrap_angle(state[vehicle.PSI] - psi)
    slip = 0.0
    if abs(state[vehicle.VX]) + abs(state[vehicle.VY]) > 1e-9:
        slip = math.atan2(state[vehicle.VY], state[vehicle.VX])
    out[S], out[D], out[HEADING], out[KAPPA] = s, d, heading, kappa
    out[COURSE] = wrap_angle(heading + slip)
    out[PATH_X] = state[vehicle.X] + d * math.sin(psi)
    out[PATH_Y] = state[vehicle.Y] - d * math.cos(psi)


@kernel
def sense(  # noqa: PLR0917 - numba takes no keyword-only arguments
    table: PathTable,
    p: int,
    state: FloatArray,
    tracking: FloatArray,
    spacing: float,
    count: int,
    shift: FloatArray,
    weights: FloatArray,
    out: FloatArray,
) -> None:
    """Fill an observation row with ``count`` waypoints ``spacing`` apart [m].

    ``shift`` (count, 2) is added to the waypoints in the vehicle's frame (first dimension 0: no
    errors). Errors and curvature are then those of the road as estimated from the shifted
    waypoints: the shift across the road is fitted by a parabola, whose value, slope and second
    derivative beside the vehicle are ``weights`` (3, count) times the shifts.
    """
    out[O_D], out[O_HEADING] = tracking[D], tracking[HEADING]
    out[O_VX], out[O_VY] = state[vehicle.VX], state[vehicle.VY]
    out[O_RATE], out[O_STEER] = state[vehicle.YAW_RATE], state[vehicle.STEER]
    out[O_KAPPA] = tracking[KAPPA]
    c, n = math.cos(state[vehicle.PSI]), math.sin(state[vehicle.PSI])
    noisy = shift.shape[0] > 0
    for i in range(count):
        x, y, psi, _ = paths.at(table, p, tracking[S] + i * spacing)
        dx, dy = x - state[vehicle.X], y - state[vehicle.Y]
        ahead, left = c * dx + n * dy, c * dy - n * dx
        if noisy:
            ahead += shift[i, 0]
            left += shift[i, 1]
            turned = psi - state[vehicle.PSI]
            across = math.cos(turned) * shift[i, 1] - math.sin(turned) * shift[i, 0]
            out[O_D] -= weights[0, i] * across
            out[O_HEADING] -= weights[1, i] * across
            out[O_KAPPA] += weights[2, i] * across
        out[O_PREVIEW + 2 * i] = ahead
        out[O_PREVIEW + 2 * i + 1] = left
    if noisy:
        out[O_HEADING] = wrap_angle(out[O_HEADING])
