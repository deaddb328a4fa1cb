"""The way back through an encoding: from slopes at the features to slopes at what they are made of.

Only what a formula reads can have a slope, and that follows from its source. So the way back costs
about as much as the way there.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from steersman.kernels import encode as enc
from steersman.kernels import formula_slopes as _calls  # noqa: F401 - calls with dual numbers
from steersman.kernels.compiled import inlined, kernel
from steersman.kernels.dual_number import LANES, WIDTH, rows
from steersman.kernels.encode import EncodingTable
from steersman.kernels.formula import call
from steersman.types import FloatArray

# Values of ``which``, see ``EncodingTable.cells``.
ADVANCE, REMEMBER = 1, 2
_UPDATES = 3


class EncodingSlopes(NamedTuple):
    """Derivatives of an encoding's formulas, and what each of them reads.

    A place is a column of the memory row, or, behind those, of the observation row.
    """

    table: EncodingTable
    """As the encoding's own, with the addresses of the derivatives."""
    first: Any
    """(features + 3 cells + 1,) int64: where in ``reads`` each formula's places begin: features,
    then for each cell those of begin, advance and remember."""
    reads: Any
    """(any,) int64 places."""
    hands_on: Any
    """(features + 3 cells,) bool: the formula gives the one number that it reads, as it is."""


def scratch(slopes: EncodingSlopes, columns: int) -> FloatArray:
    """Scratch for observation rows of so many columns: dual numbers, and one for a result."""
    return np.zeros((enc.memory_size(slopes.table) + columns + 1, WIDTH))


@kernel
def put(memory: FloatArray, row: FloatArray, work: FloatArray) -> None:
    """Write memory and observation into the scratch."""
    for k in range(memory.shape[0]):
        work[k, 0] = memory[k]
    for k in range(row.shape[0]):
        work[memory.shape[0] + k, 0] = row[k]


@inlined
def _pull(
    slopes: EncodingSlopes,
    place: tuple[int, int, int, int],
    k: int,
    weight: float,
    work: FloatArray,
    adjoint: FloatArray,
) -> None:
    """Add ``weight`` times the derivatives of formula ``k``; ``place``: address, own, cells, i."""
    address, own, cells, i = place
    loop, seen = rows(work), rows(work)[enc.CELLS + slopes.table.cells.shape[0] :]
    out = work[work.shape[0] - 1]
    at, end = slopes.first[k], slopes.first[k + 1]
    while at < end:
        count = min(LANES, end - at)
        for j in range(count):
            work[slopes.reads[at + j], 1 + j] = 1.0
        rows(out)[0] = call(address, seen, loop, slopes.table.own, own, cells, i)
        for j in range(count):
            adjoint[slopes.reads[at + j]] += weight * out[1 + j]
            work[slopes.reads[at + j], 1 + j] = 0.0
        at += count


@kernel
def pull_features(
    slopes: EncodingSlopes, weights: FloatArray, work: FloatArray, adjoint: FloatArray
) -> None:
    """From slopes at the features (features,) in SI units to those at the places, added.

    ``work`` holds memory and observation as they were when the features were made.
    """
    for j in range(slopes.table.numbers.shape[0]):
        if slopes.hands_on[j]:
            adjoint[slopes.reads[slopes.first[j]]] += weights[j]
        elif weights[j] != 0.0:
            n = slopes.table.numbers[j]
            _pull(slopes, (n[0], n[2], n[3], n[1]), j, weights[j], work, adjoint)
    # The last command stands for the base's.
    adjoint[enc.LAST_COMMAND] += adjoint[enc.BASE_COMMAND]
    adjoint[enc.BASE_COMMAND] = 0.0


@kernel
def pull_update(
    slopes: EncodingSlopes, which: int, old: FloatArray, work: FloatArray, adjoint: FloatArray
) -> None:
    """From slopes at the cells after an update to those at the places before it.

    ``work`` holds the cells after the update, and the observation, and ends with ``old``, the
    memory before it. Cells are renewed from the last to the first, so the way back is ascending.
    """
    cells = slopes.table.cells
    for c in range(cells.shape[0]):
        cell, place = cells[c], enc.CELLS + c
        work[place, 0] = old[place]
        weight = adjoint[place]
        if cell[which] == 0 or weight == 0.0:
            continue
        adjoint[place] = 0.0
        k = slopes.table.numbers.shape[0] + _UPDATES * c + which
        if slopes.hands_on[k]:
            adjoint[slopes.reads[slopes.first[k]]] += weight
            continue
        _pull(slopes, (cell[which], cell[4], cell[5], cell[3]), k, weight, work, adjoint)
