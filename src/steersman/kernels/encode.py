"""From an observation row to the input of a policy's network, with the memory that it needs."""

from __future__ import annotations

from typing import Any, NamedTuple

from steersman.kernels import observe as o
from steersman.kernels.compiled import kernel
from steersman.kernels.formula import call
from steersman.types import FloatArray

# Scaled features are clipped to this.
FEATURE_LIMIT = 100.0
# Columns of a memory row; behind them are the cells of the features that remember something.
STARTED, LAST_COMMAND, BASE_COMMAND, DT, SPACING, LAST_SHARE, WISHES = range(7)
# From WISHES on: pairs of wished speed [m/s] and distance ahead [m], at every third waypoint.
N_WISHES, STRIDE = 5, 3
# The car ahead: gap [m], its speed less the own one [m/s], wished gap [m].
GAP, RELATIVE_SPEED, WISHED_GAP = range(WISHES + 2 * N_WISHES, WISHES + 2 * N_WISHES + 3)
CELLS = WISHED_GAP + 1
# Columns of EncodingTable.numbers and, behind the formulas, of EncodingTable.cells.
_FORMULA, _INDEX, _OWN, _CELL = range(4)
_BEGIN, _ADVANCE, _REMEMBER, _PLACE = range(4)


class EncodingTable(NamedTuple):
    """Formulas (addresses of :mod:`steersman.kernels.formula`) of the network's input."""

    numbers: Any
    """(features, 4) int64: formula, index in its feature, place in ``own``, place of its cells."""
    cells: Any
    """(cells, 6) int64: formulas that begin, advance and remember a cell (0: none), then index,
    place in ``own`` and place of the feature's cells."""
    own: FloatArray
    """Settings of all features behind each other."""
    spacing: float
    """Distance between waypoints [m]."""
    dt: float
    """Control period [s]."""


def memory_size(table: EncodingTable) -> int:
    """Columns of a memory row."""
    return CELLS + len(table.cells)


def feature_count(table: EncodingTable) -> int:
    """Length of the network's input."""
    return len(table.numbers)


@kernel
def _update(table: EncodingTable, row: FloatArray, memory: FloatArray, which: int) -> None:
    """Renew every cell by one of its formulas, the last cell first."""
    for c in range(table.cells.shape[0] - 1, -1, -1):
        cell = table.cells[c]
        if cell[which] != 0:
            i, own, first = cell[_PLACE], cell[_PLACE + 1], cell[_PLACE + 2]
            memory[CELLS + c] = call(cell[which], row, memory, table.own, own, first, i)


@kernel
def _number(table: EncodingTable, row: FloatArray, memory: FloatArray, j: int) -> float:
    n = table.numbers[j]
    return call(n[_FORMULA], row, memory, table.own, n[_OWN], n[_CELL], n[_INDEX])


@kernel
def remember(table: EncodingTable, row: FloatArray, memory: FloatArray, command: float) -> None:
    """Update the cells that remember this step; then ``command`` is the last command."""
    _update(table, row, memory, _REMEMBER)
    memory[LAST_COMMAND] = command


@kernel
def see_wishes(wished: FloatArray, spacing: float, memory: FloatArray) -> None:
    """Write the speeds wished at the waypoints [m/s], to be read by the next :func:`encode`.

    Places beyond the last waypoint have its speed.
    """
    if memory[STARTED] == 0.0:
        memory[LAST_SHARE] = 1.0
    last = wished.shape[0] - 1
    for j in range(N_WISHES):
        memory[WISHES + 2 * j] = wished[min(j * STRIDE, last)]
        memory[WISHES + 2 * j + 1] = j * STRIDE * spacing


@kernel
def see_lead(gap: float, relative_speed: float, wished: float, memory: FloatArray) -> None:
    """Write gap [m], speed less the own [m/s] and wished gap [m] of a car ahead, as above."""
    memory[GAP], memory[RELATIVE_SPEED], memory[WISHED_GAP] = gap, relative_speed, wished


@kernel
def encode(table: EncodingTable, row: FloatArray, memory: FloatArray, out: FloatArray) -> None:
    """Write the features (features,) of an observation row in SI units.

    A memory row of zeros begins anew. Until :func:`tell_base`, the last command stands for the
    base controller's.
    """
    if memory[STARTED] == 0.0:
        memory[STARTED] = 1.0
        memory[LAST_COMMAND] = row[o.O_STEER]
        memory[DT], memory[SPACING] = table.dt, table.spacing
        _update(table, row, memory, _BEGIN)
    else:
        _update(table, row, memory, _ADVANCE)
    memory[BASE_COMMAND] = memory[LAST_COMMAND]
    for j in range(table.numbers.shape[0]):
        out[j] = _number(table, row, memory, j)


@kernel
def tell_base(
    table: EncodingTable, row: FloatArray, memory: FloatArray, base: float, out: FloatArray
) -> None:
    """Write the last feature again, once the base controller's command is known."""
    memory[BASE_COMMAND] = base
    out[-1] = _number(table, row, memory, table.numbers.shape[0] - 1)


@kernel
def normalise(features: FloatArray, scale: FloatArray) -> None:
    """Scale features to about unit size and clip them, in place; a policy file does the same."""
    for j in range(features.shape[0]):
        features[j] = min(max(features[j] * scale[j], -FEATURE_LIMIT), FEATURE_LIMIT)
