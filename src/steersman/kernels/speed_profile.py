"""The fastest speed along a path that limits of acceleration allow.

Source: forward-backward passes over a path's curvature, N. R. Kapania, J. Subosits and J. C.
Gerdes, A sequential two-step algorithm for fast generation of vehicle racing trajectories, ASME
J. Dyn. Sys. Meas. Control 138 (2016), sec. 3; limits that depend on speed ("ggv diagram") as in
TUM's global_racetrajectory_optimization.
"""

from __future__ import annotations

import math

from steersman.kernels.compiled import kernel
from steersman.kernels.path import CLOSED, PathTable, at
from steersman.kernels.vehicle import interpolate
from steersman.types import FloatArray

# Columns of a table of grip.
G_SPEED, G_ALONG, G_ACROSS = range(3)
# A path of less curvature counts as one of this, 10 km of radius [1/m].
_STRAIGHT = 1e-4
_HALVINGS = 60


@kernel
def cornering_speed(grip: FloatArray, kappa: float, most: float) -> float:
    """Largest speed, up to ``most``, whose lateral acceleration grip allows [m/s]."""
    kappa = max(abs(kappa), _STRAIGHT)
    if grip.shape[0] == 1:
        return min(most, math.sqrt(grip[0, G_ACROSS] / kappa))
    low, high = 0.0, most
    if kappa * high * high <= interpolate(grip[:, G_SPEED], grip[:, G_ACROSS], high):
        return most
    for _ in range(_HALVINGS):
        v = 0.5 * (low + high)
        if kappa * v * v <= interpolate(grip[:, G_SPEED], grip[:, G_ACROSS], v):
            low = v
        else:
            high = v
    return low


@kernel
def available(grip: FloatArray, exponent: float, v: float, kappa: float) -> float:
    """Longitudinal acceleration that is left of the grip in a bend [m/s^2].

    With shares p along and q across of the grip, p^exponent + q^exponent <= 1; infinite: each for
    itself.
    """
    along = interpolate(grip[:, G_SPEED], grip[:, G_ALONG], v)
    if math.isinf(exponent):
        return along
    used = v * v * abs(kappa) / interpolate(grip[:, G_SPEED], grip[:, G_ACROSS], v)
    if used >= 1.0:
        return 0.0
    return float(along * (1.0 - used**exponent) ** (1.0 / exponent))


@kernel
def _reach(
    grip: FloatArray,
    exponent: float,
    engine: float,
    v: float,
    kappa: float,
    most: float,
    step: float,
) -> float:
    """Largest speed, up to ``most``, one step from the speed ``v`` that is not larger.

    Limits hold for the larger speed at the larger curvature of both places, hence between them.
    As they fall with speed, a larger ``v`` reaches at least as far: that makes passes optimal.
    """
    along = 0.0
    for i in range(grip.shape[0]):
        along = max(along, grip[i, G_ALONG])
    along = min(engine, along)
    low, high = v, min(most, math.sqrt(v**2 + 2.0 * along * step))
    if high <= v or (math.isinf(exponent) and grip.shape[0] == 1):
        return high
    for _ in range(_HALVINGS):
        to = 0.5 * (low + high)
        if to * to - v * v <= 2.0 * step * min(engine, available(grip, exponent, to, kappa)):
            low = to
        else:
            high = to
    return low


@kernel
def fastest(
    grip: FloatArray,
    exponent: float,
    engine: float,
    kappa: FloatArray,
    step: float,
    closed: bool,
    limit: FloatArray,
) -> None:
    """Lower ``limit`` to the fastest speeds that can be driven, in place.

    Args:
        grip: rows of speed [m/s], longitudinal and lateral acceleration [m/s^2] that grip allows,
            linear between, constant beyond; braking has all of the former.
        exponent: how both share the grip, see :func:`available`.
        engine: largest acceleration of the engine [m/s^2]; infinite: speed rises at once.
        kappa: curvature at equal distances [1/m]; on a closed path the last place is the first.
        step: distance between two [m].
        closed: whether the end joins the start.
        limit: speed that must not be exceeded at each place [m/s].
    """
    count = kappa.shape[0]
    for i in range(count):
        limit[i] = cornering_speed(grip, kappa[i], limit[i])
    rounds = 2 if closed else 1
    for _ in range(rounds if math.isfinite(engine) else 0):
        for i in range(1, count):
            bend = max(abs(kappa[i - 1]), abs(kappa[i]))
            limit[i] = _reach(grip, exponent, engine, limit[i - 1], bend, limit[i], step)
        if closed:
            limit[0] = min(limit[0], limit[-1])
    for _ in range(rounds):
        for i in range(count - 2, -1, -1):
            bend = max(abs(kappa[i + 1]), abs(kappa[i]))
            limit[i] = _reach(grip, exponent, math.inf, limit[i + 1], bend, limit[i], step)
        if closed:
            limit[-1] = min(limit[-1], limit[0])


@kernel
def gain_ahead(table: PathTable, p: int, reach: float, limit: FloatArray) -> None:
    """Lower speed limits along path ``p`` so that they rise as fast as the car may, in place.

    Arguments as of :func:`brake_ahead`; ``reach`` is what the square of the speed gains.
    """
    closed = table.meta[p, CLOSED] > 0.0
    for _ in range(2 if closed else 1):
        for i in range(1, limit.shape[0]):
            limit[i] = min(limit[i], math.sqrt(limit[i - 1] ** 2 + reach))
        if closed:
            limit[0] = min(limit[0], limit[-1])


@kernel
def curvatures(table: PathTable, p: int, step: float, end: float, kappa: FloatArray) -> None:
    """Fill ``kappa`` [1/m] with the curvature of path ``p`` every ``step`` [m].

    Places behind ``end`` [m] are there.
    """
    for i in range(kappa.shape[0]):
        kappa[i] = at(table, p, min(i * step, end))[3]


@kernel
def brake_ahead(table: PathTable, p: int, reach: float, limit: FloatArray) -> None:
    """Lower speed limits along path ``p`` so that braking suffices to keep them, in place.

    Args:
        table: the paths.
        p: which of them.
        reach: what the square of the speed loses from one place to the next [m^2/s^2].
        limit: speed that must not be exceeded at each place [m/s].
    """
    closed = table.meta[p, CLOSED] > 0.0
    for _ in range(2 if closed else 1):
        for i in range(limit.shape[0] - 2, -1, -1):
            limit[i] = min(limit[i], math.sqrt(limit[i + 1] ** 2 + reach))
        if closed:
            limit[-1] = min(limit[-1], limit[0])
