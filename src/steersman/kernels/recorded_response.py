"""What a vehicle does under recorded commands: at the recorded speed, or at one of its own."""

from __future__ import annotations

from typing import Any

from steersman.kernels.compiled import kernel
from steersman.kernels.vehicle import N_STATE, VX, VehicleTable, advance
from steersman.types import FloatArray


@kernel
def replay(
    table: VehicleTable,
    commands: FloatArray,
    starts: Any,
    base: FloatArray,
    held: bool,
    h: float,
    states: FloatArray,
    work: FloatArray,
) -> None:
    """Fill ``states`` (m + 1, N_STATE), put back to ``base`` (m + 1, N_STATE) at every start.

    ``commands`` (m, 3) act for a step of ``h`` [s] each; ``starts`` (k,) are steps, increasing, the
    first of them 0. If ``held``, the speed is that of ``base`` at every step; what is left is
    stable then: an error of the start is forgotten.
    """
    segment = 0
    for k in range(commands.shape[0]):
        if segment < starts.shape[0] and starts[segment] == k:
            for i in range(N_STATE):
                states[k, i] = base[k, i]
            segment += 1
        for i in range(N_STATE):
            states[k + 1, i] = states[k, i]
        advance(table, 0, states[k + 1], commands[k], h, 1, work)
        if held:
            states[k + 1, VX] = base[k + 1, VX]
