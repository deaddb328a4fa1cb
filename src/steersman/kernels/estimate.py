"""One step of the estimator for one vehicle: an extended Kalman filter of car, road and biases.

The road's curvature is a random walk along the road, so that, given the state, what lies behind
the car says nothing more: the filter is the posterior of all observations so far.
docs/equations/estimated.md has the equations.
"""

from __future__ import annotations

import math

from steersman.kernels import observe
from steersman.kernels.actuator import slew
from steersman.kernels.compiled import kernel
from steersman.kernels.estimate_motion import predict
from steersman.kernels.estimate_update import (
    BEGUN,
    COMMAND,
    COUNT,
    CURVATURE,
    EXACT,
    LOST,
    NOISE,
    NOW,
    POINT,
    SEEN,
    STEER,
    TIME,
    Estimates,
    EstimatorWork,
    begin,
    listen,
    update,
)
from steersman.kernels.observe import wrap_angle
from steersman.kernels.road_walk import (
    HEADING,
    NODES,
    OFFSET,
    RATE,
    VX,
    VY,
    D,
    node_curvature,
    walk,
)
from steersman.kernels.vehicle import STEER_DOWN, STEER_UP, VehicleTable
from steersman.types import FloatArray

# Steps without a plausible road after which the filter begins anew.
_LOST_STEPS = 4.0
# A longer gap in the observations is a new beginning [s].
_LONGEST_GAP = 1.0
# Errors measured that differ more from the posterior are not passed on [m], [rad].
_PASS_D, _PASS_HEADING = 0.1, 0.05


@kernel
def step(  # noqa: PLR0917 - numba takes no keyword-only arguments
    table: VehicleTable,
    n: int,
    settings: FloatArray,
    spacing: float,
    h: float,
    dt: float,
    time: float,
    row: FloatArray,
    preview: FloatArray,
    kept: Estimates,
    work: EstimatorWork,
    out: FloatArray,
) -> bool:
    """Bring the estimates up to the present and write the observation that they mean.

    Returns whether all numbers are finite; if not, the estimates are to be made anew.

    Args:
        table: nominal vehicles.
        n: the row of this one.
        settings: (N_SETTINGS,) SD of the curvature's change over a metre [1/m]; SDs of the biases
            of v_y [m/s], of the yaw rate [rad/s] and of the scale of v_x [-]; SD of the errors
            below which the measured road is taken as exact [m].
        spacing: distance between waypoints [m].
        h: distance between nodes of the road [m].
        dt: control period [s].
        time: of the observation [s]. One with the time and the numbers of the last is the last
            again: a sample got lost.
        row: numbers of an observation row before the waypoints (O_PREVIEW,).
        preview: its waypoints (count, 2).
        kept: the estimates, in place.
        work: scratch.
        out: observation row that is written.
    """
    memory = kept.memory
    periods, fresh = _elapsed(dt, time, row, preview, memory)
    first = memory[BEGUN] == 0.0
    if not first:
        _advance(table, n, settings, h, dt, periods, fresh, row[observe.O_STEER], kept, work)
    if fresh:
        listen(spacing, row, preview, kept, work.spread)
        if not first:
            update(h, spacing, row, preview, kept, work, True)
        if first or memory[LOST] >= _LOST_STEPS:
            begin(settings, h, spacing, row, preview, kept, work)
        memory[STEER] = row[observe.O_STEER]
    kept.mean[HEADING] = wrap_angle(kept.mean[HEADING])
    _write(settings, h, spacing, fresh, row, preview, kept, work, out)
    total = observe.total(out) + observe.total(kept.mean)
    for i in range(kept.mean.shape[0]):
        total += kept.cov[i, i]
    return math.isfinite(total)


@kernel
def _elapsed(
    dt: float, time: float, row: FloatArray, preview: FloatArray, memory: FloatArray
) -> tuple[int, bool]:
    """Periods since the last step, and whether there is a new observation.

    An observation that is much older or newer than the last one is a new beginning.
    """
    total = observe.total(row)
    for i in range(preview.shape[0]):
        total += preview[i, 0] + preview[i, 1]
    same_time, same = time == memory[TIME], total == memory[SEEN]
    memory[TIME], memory[SEEN] = time, total
    if memory[BEGUN] != 0.0 and same_time:
        # A clock that stands still with new numbers is none: a period has passed.
        memory[NOW] += dt
        return 1, not same
    gap = time - memory[NOW]
    memory[NOW] = time
    if not -0.5 * dt <= gap <= _LONGEST_GAP:
        memory[BEGUN] = memory[COUNT] = memory[LOST] = 0.0
        return 0, True
    return int(gap / dt + 0.5), True


@kernel
def _advance(  # noqa: PLR0917 - numba takes no keyword-only arguments
    table: VehicleTable,
    n: int,
    settings: FloatArray,
    h: float,
    dt: float,
    periods: int,
    fresh: bool,
    steer: float,
    kept: Estimates,
    work: EstimatorWork,
) -> None:
    """Predict period by period; the steering goes to that measured or else to the command."""
    memory, mean, cov = kept
    growth = settings[CURVATURE] * settings[CURVATURE] * h
    up, down = table.rows[n, STEER_UP], table.rows[n, STEER_DOWN]
    for i in range(periods):
        before = memory[STEER]
        if fresh:
            after = before + (steer - before) / (periods - i)
        else:
            after = slew(before, memory[COMMAND], up, down, dt)
        predict(table, n, 0.5 * (before + after), dt, h, mean, cov, work.rows)
        memory[STEER] = after
        shifts = 0
        while mean[OFFSET] >= h and shifts < mean.shape[0]:
            _next_node(growth, h, mean, cov)
            shifts += 1


@kernel
def _next_node(growth: float, h: float, mean: FloatArray, cov: FloatArray) -> None:
    """The first node falls behind the car, and one is added at the end of the road."""
    size = mean.shape[0]
    for i in range(NODES, size - 1):
        mean[i] = mean[i + 1]
    for i in range(size):
        source = cov[i + 1] if NODES <= i < size - 1 else cov[i]
        for j in range(size):
            cov[i, j] = source[j + 1] if NODES <= j < size - 1 else source[j]
    for j in range(size):
        cov[size - 1, j] = cov[j, size - 1] = cov[size - 2, j]
    cov[size - 1, size - 1] = cov[size - 2, size - 2] + growth
    mean[OFFSET] -= h


@kernel
def _write(  # noqa: PLR0917 - numba takes no keyword-only arguments
    settings: FloatArray,
    h: float,
    spacing: float,
    fresh: bool,
    row: FloatArray,
    preview: FloatArray,
    kept: Estimates,
    work: EstimatorWork,
    out: FloatArray,
) -> None:
    """The observation of the posterior; the measured road as far as it is exact."""
    memory, mean, _ = kept
    walk(mean, h, spacing, work.points, work.directions, work.jacobian, work.rows)
    out[observe.O_D], out[observe.O_HEADING] = mean[D], mean[HEADING]
    out[observe.O_VX], out[observe.O_VY], out[observe.O_RATE] = mean[VX], mean[VY], mean[RATE]
    out[observe.O_STEER] = memory[STEER]
    out[observe.O_KAPPA] = node_curvature(mean, h, mean[OFFSET])
    exact = 0.0
    if fresh and settings[EXACT] > 0.0:
        ratio = (memory[POINT] + memory[NOISE]) / (settings[EXACT] * settings[EXACT])
        exact = 1.0 / (1.0 + ratio * ratio)
    for i in range(preview.shape[0]):
        share = exact * work.spread[i]
        for axis in range(2):
            seen, found = preview[i, axis], work.points[i, axis]
            out[observe.O_PREVIEW + 2 * i + axis] = found + share * (seen - found)
    d = row[observe.O_D] - mean[D]
    heading = wrap_angle(row[observe.O_HEADING] - mean[HEADING])
    if abs(d) <= _PASS_D and abs(heading) <= _PASS_HEADING:
        out[observe.O_D] += exact * d
        out[observe.O_HEADING] += exact * heading
        out[observe.O_KAPPA] += exact * (row[observe.O_KAPPA] - out[observe.O_KAPPA])
