"""Side forces of a single track up to its grip, and the friction that explains the car's motion.

Each axle is one brush tyre (``tyre.side_force``: Pacejka, Tyre and Vehicle Dynamics, 3rd ed.,
sec. 3.2). Its longitudinal force takes its part of the grip, by the friction ellipse.
"""

from __future__ import annotations

import math

import numpy as np

from steersman.kernels.compiled import kernel
from steersman.kernels.tyre import side_force
from steersman.kernels.vehicle import (
    BRAKE_FRONT,
    C_F,
    C_R,
    DRAG,
    DRIVE_FRONT,
    GRAVITY,
    INERTIA,
    L_F,
    L_R,
    MASS,
    ROLL_ARM,
)
from steersman.types import FloatArray

# Largest side forces of axles without a limit (2,) [N].
NO_LIMIT = np.full(2, math.inf)
# By how much of the force of an unlimited tyre stiffness, mass and load may be wrong.
_DOUBT = 0.3
# By how much the side velocity may be wrong [m/s]: at low speed such an error looks like ice.
_SIDEWAYS = 0.2
# Noise of an axle's force that is assumed at least, as an acceleration of the car [m/s^2].
_LEAST_NOISE = 0.1
# An axle that drives or brakes with all its grip keeps this share of it for cornering.
_LEAST_SHARE = 0.1
# Share of the grip that is not used where all of it is wanted: there the inverse has no slope.
_LEFT = 1e-4
# So much of an acceleration that was measured is sure.
_SURE = 0.9
# An axle with less than this share of its grip slips little: its force grows with the slip.
LITTLE = 0.15
# Scores [variances] that differ by less are the same, but for rounding.
_SAME = 1e-6
# Added to the squared error of a friction that is less than that.
_IMPOSSIBLE = 10.0


@kernel
def axle_grips(row: FloatArray, friction: float, v: float, a_x: float) -> tuple[float, float]:
    """Largest side force of the front and of the rear axle [N].

    The longitudinal forces are those of the acceleration ``a_x`` [m/s^2] along the car's axis and
    of the drag at the speed ``v`` [m/s].
    """
    base, pull = row[L_F] + row[L_R], row[MASS] * a_x + row[DRAG] * v * v
    share = row[DRIVE_FRONT] if pull > 0.0 else row[BRAKE_FRONT]
    weight = row[MASS] * GRAVITY
    load_f = min(max((weight * row[L_R] - row[MASS] * a_x * row[ROLL_ARM]) / base, 0.0), weight)
    return (
        _side_grip(friction * load_f, share * pull),
        _side_grip(friction * (weight - load_f), (1.0 - share) * pull),
    )


@kernel
def _side_grip(grip: float, pull: float) -> float:
    least = _LEAST_SHARE * grip
    return math.sqrt(max(grip * grip - pull * pull, least * least))


@kernel
def turn_share(row: FloatArray, grips: FloatArray, side: float) -> float:
    """The larger share of its ``grips`` [N] that an axle needs in a steady turn [-].

    ``side`` is the turn's side acceleration [m/s^2].
    """
    force = row[MASS] * abs(side) / (row[L_F] + row[L_R])
    return float(max(force * row[L_R] / (grips[0] + 1e-9), force * row[L_F] / (grips[1] + 1e-9)))


@kernel
def axle_forces(
    row: FloatArray, grips: FloatArray, slip_f: float, slip_r: float
) -> tuple[float, float]:
    """Side forces [N] at slip angles [rad] that are positive where the force is, to the left.

    ``grips`` (2,) are the largest ones, of the front and of the rear axle [N].
    """
    return -side_force(row[C_F], slip_f, grips[0]), -side_force(row[C_R], slip_r, grips[1])


@kernel
def force_slope(stiffness: float, slip: float, grip: float) -> float:
    """Derivative of the side force by the slip [N/rad]; 0 where the whole tyre slides."""
    left = max(1.0 - stiffness * abs(slip) / (3.0 * grip + 1e-9), 0.0)
    return stiffness * left * left


@kernel
def slip_for_force(stiffness: float, force: float, grip: float) -> float:
    """Slip angle [rad] at which an axle has a side force [N], or nearly all of its ``grip`` [N].

    The brush tyre's force is grip (1 - (1 - z)^3) at the slip 3 grip z / stiffness.
    """
    left = max(1.0 - abs(force) / (grip + 1e-9), _LEFT)
    z = 1.0 - left ** (1.0 / 3.0)
    return float(math.copysign(3.0 * grip * z / stiffness, force))


@kernel
def angle_for_linear(row: FloatArray, grip: float, points: float, angle: float) -> float:
    """Wheel angle [rad] with the front force that ``angle`` has on tyres without a limit.

    Where that is beyond the front axle's ``grip`` [N], the angle with nearly all of it.
    ``points`` is the direction in which the front axle moves [rad].
    """
    return points + slip_for_force(row[C_F], row[C_F] * (angle - points), grip)


@kernel
def linear_for_angle(row: FloatArray, grip: float, points: float, angle: float) -> float:
    """The inverse: wheel angle at which tyres without a limit have the front force of ``angle``."""
    return float(points - side_force(row[C_F], angle - points, grip) / row[C_F])


@kernel
def missed_forces(row: FloatArray, side: float, yaw: float, dt: float) -> tuple[float, float]:
    """Side forces [N] of both axles that change side velocity and yaw rate so over ``dt`` [s]."""
    m, inertia, base = row[MASS], row[INERTIA], (row[L_F] + row[L_R]) * dt
    front, rear = m * row[L_R] * side + inertia * yaw, m * row[L_F] * side - inertia * yaw
    return front / base, rear / base


@kernel
def score_frictions(  # noqa: PLR0917 - numba takes no keyword-only arguments
    row: FloatArray,
    frictions: FloatArray,
    v: float,
    a_x: float,
    slips: FloatArray,
    forces: FloatArray,
    noise: FloatArray,
    keep: float,
    scores: FloatArray,
) -> int:
    """Judge friction coefficients by how they explain the axles' side forces; the best one's index.

    Args:
        row: the car's parameters.
        frictions: the coefficients (n,).
        v: speed [m/s].
        a_x: acceleration along the car's axis [m/s^2].
        slips: (2,) slip angles of the front and of the rear axle [rad].
        forces: (2,) their side forces [N].
        noise: (2,) variances of the forces, without any model error [N^2].
        keep: share of the scores that is kept over a period.
        scores: (n,) fading means of the squared errors, over their variances; changed in place.
    """
    least = row[MASS] * _LEAST_NOISE
    best = frictions.shape[0] - 1
    most_f, most_r = axle_grips(row, frictions[best], v, a_x)
    doubt_f = _DOUBT * min(row[C_F] * abs(slips[0]), most_f)
    doubt_r = _DOUBT * min(row[C_R] * abs(slips[1]), most_r)
    unsure_f, unsure_r = row[C_F] * _SIDEWAYS / v, row[C_R] * _SIDEWAYS / v
    var_f = noise[0] + least * least + doubt_f * doubt_f + unsure_f * unsure_f
    var_r = noise[1] + least * least + doubt_r * doubt_r + unsure_r * unsure_r
    # No car accelerates by more than friction times gravity.
    across = max(abs(forces[0] + forces[1]) - 2.0 * math.sqrt(noise[0] + noise[1]), 0.0) / row[MASS]
    least_friction = _SURE * math.hypot(a_x, across) / GRAVITY
    for i in range(best, -1, -1):
        grip_f, grip_r = axle_grips(row, frictions[i], v, a_x)
        off_f = forces[0] + side_force(row[C_F], slips[0], grip_f)
        off_r = forces[1] + side_force(row[C_R], slips[1], grip_r)
        error = off_f * off_f / var_f + off_r * off_r / var_r
        if frictions[i] < least_friction:
            error += _IMPOSSIBLE
        scores[i] = keep * scores[i] + (1.0 - keep) * error
        if scores[i] < scores[best] - _SAME:
            best = i
    return int(best)
