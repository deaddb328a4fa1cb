"""What a vehicle does under recorded commands: at the recorded speed, or at one of its own."""

from __future__ import annotations

from typing import Any

from steersman.kernels.compiled import kernel
from steersman.kernels.vehicle import N_STATE, VX, VehicleTable, advance
from steersman.types import FloatArray


@kernel
def follow(
    table: VehicleTable,
    commands: FloatArray,
    speed: FloatArray,
    h: float,
    states: FloatArray,
    work: FloatArray,
) -> None:
    """Fill ``states`` (m + 1, N_STATE) from its first row, held at ``speed`` (m + 1,) [m/s].

    ``commands`` (m, 3) act for a step of ``h`` [s] each. With the speed given, what is left is
    stable: an error of the start is forgotten.
    """
    states[0, VX] = speed[0]
    for k in range(commands.shape[0]):
        for i in range(N_STATE):
            states[k + 1, i] = states[k, i]
        advance(table, 0, states[k + 1], commands[k], h, 1, work)
        states[k + 1, VX] = speed[k + 1]


@kernel
def release(
    table: VehicleTable,
    commands: FloatArray,
    starts: Any,
    speeds: FloatArray,
    base: FloatArray,
    h: float,
    states: FloatArray,
    work: FloatArray,
) -> None:
    """Fill ``states`` (m + 1, N_STATE) with the speed left free between restarts.

    At each step of ``starts`` (n,), increasing and the first of them 0, the state is that of
    ``base`` (m + 1, N_STATE) with the speed of ``speeds`` (n,) [m/s].
    """
    segment = 0
    for k in range(commands.shape[0]):
        if segment < starts.shape[0] and starts[segment] == k:
            for i in range(N_STATE):
                states[k, i] = base[k, i]
            states[k, VX] = speeds[segment]
            segment += 1
        for i in range(N_STATE):
            states[k + 1, i] = states[k, i]
        advance(table, 0, states[k + 1], commands[k], h, 1, work)
