"""From an observation row to the network's input, with the little memory that it needs."""

from __future__ import annotations

from typing import NamedTuple

from steersman.kernels import observe as o
from steersman.kernels.compiled import kernel
from steersman.types import FloatArray

# Columns of a memory row: started flag, integral of the lateral error, last command, then the
# last errors (newest first) and the last commands before the last one.
# Scaled features are clipped to this.
FEATURE_LIMIT = 100.0
STARTED, INTEGRAL, LAST_COMMAND, HISTORY = range(4)


class EncodingTable(NamedTuple):
    """Layout of the network's input; the features follow in this order."""

    waypoints: int
    """Waypoints ahead (x, y of each), every one that the sensor gives up to this number."""
    roads: int
    """Mean curvatures of the road from the vehicle to as many distances ahead."""
    steer: int
    """1: the actual steering is a feature."""
    errors: int
    """1: lateral and heading error, and both once more with a fine scale."""
    integral: int
    """1: the integral of the lateral error."""
    command: int
    """1: the last command."""
    history: int
    """Past lateral errors and past commands, this many of each."""
    spacing: float
    """Distance between waypoints [m]."""
    fine_error: float
    """Lateral error at which the fine feature is at half its range [m]."""
    fine_heading: float
    """Heading error at which the fine feature is at half its range [rad]."""
    integral_limit: float
    """Bound of the integral [m s]."""
    dt: float
    """Control period [s]."""
    base: int = 0
    """1: the base controller's command, less the last command, is the last feature."""


def memory_size(table: EncodingTable) -> int:
    """Columns of a memory row."""
    return HISTORY + 2 * table.history


def feature_count(table: EncodingTable) -> int:
    """Length of the network's input."""
    return (
        2 * table.waypoints
        + table.roads
        + 3
        + table.steer
        + 4 * table.errors
        + table.integral
        + table.command
        + 2 * table.history
        + table.base
    )


@kernel
def _remember_error(table: EncodingTable, row: FloatArray, memory: FloatArray) -> None:
    error = row[o.O_D]
    k = table.history
    if memory[STARTED] == 0.0:
        memory[STARTED] = 1.0
        memory[INTEGRAL] = 0.0
        memory[LAST_COMMAND] = row[o.O_STEER]
        for i in range(k):
            memory[HISTORY + i] = error
            memory[HISTORY + k + i] = row[o.O_STEER]
        return
    total = memory[INTEGRAL] + error * table.dt
    memory[INTEGRAL] = min(max(total, -table.integral_limit), table.integral_limit)


@kernel
def remember(table: EncodingTable, row: FloatArray, memory: FloatArray, command: float) -> None:
    """Push this step's lateral error and the last command into the history; keep ``command``."""
    k = table.history
    for i in range(k - 1, 0, -1):
        memory[HISTORY + i] = memory[HISTORY + i - 1]
        memory[HISTORY + k + i] = memory[HISTORY + k + i - 1]
    if k > 0:
        memory[HISTORY] = row[o.O_D]
        memory[HISTORY + k] = memory[LAST_COMMAND]
    memory[LAST_COMMAND] = command


@kernel
def encode(table: EncodingTable, row: FloatArray, memory: FloatArray, out: FloatArray) -> None:
    """Write the features of an observation row in SI units; updates the integral.

    The base's feature stays zero: :func:`tell_base`.
    """
    _remember_error(table, row, memory)
    i = 0
    for j in range(2 * table.waypoints):
        out[i] = row[o.O_PREVIEW + j]
        i += 1
    if table.roads > 0:
        i = _roads(table, row, out, i)
    out[i], out[i + 1], out[i + 2] = row[o.O_VX], row[o.O_VY], row[o.O_RATE]
    i += 3
    if table.steer:
        out[i] = row[o.O_STEER]
        i += 1
    if table.errors:
        d, heading = row[o.O_D], row[o.O_HEADING]
        out[i], out[i + 1] = d, heading
        out[i + 2] = d / (table.fine_error + abs(d))
        out[i + 3] = heading / (table.fine_heading + abs(heading))
        i += 4
    if table.integral:
        out[i] = memory[INTEGRAL]
        i += 1
    if table.command:
        out[i] = memory[LAST_COMMAND]
        i += 1
    for j in range(2 * table.history):
        out[i] = memory[HISTORY + j]
        i += 1
    if table.base:
        out[i] = 0.0


@kernel
def tell_base(memory: FloatArray, base: float, out: FloatArray) -> None:
    """Fill the last feature in: the base's command relative to the last one."""
    out[-1] = base - memory[LAST_COMMAND]


@kernel
def normalise(features: FloatArray, scale: FloatArray) -> None:
    """Scale features to about unit size and clip them, in place; a policy file does the same."""
    for j in range(features.shape[0]):
        features[j] = min(max(features[j] * scale[j], -FEATURE_LIMIT), FEATURE_LIMIT)


@kernel
def _roads(table: EncodingTable, row: FloatArray, out: FloatArray, i: int) -> int:
    """Curvature beside the vehicle, then twice the road's offset from its tangent over u^2.

    The tangent is the one the sensed heading error tells, so these features hold the road's
    shape and nothing of the vehicle's own error (small angles).
    """
    out[i] = row[o.O_KAPPA]
    x0, y0 = row[o.O_PREVIEW], row[o.O_PREVIEW + 1]
    for j in range(1, table.roads):
        at = o.O_PREVIEW + 2 * (2 * j)
        u = 2 * j * table.spacing
        offset = row[at + 1] - y0 + row[o.O_HEADING] * (row[at] - x0)
        out[i + j] = 2.0 * offset / (u * u)
    return i + table.roads
