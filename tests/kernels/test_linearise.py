"""The Jacobian of the control step: values are the plant's, slopes its differences."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from steersman.config import components, resolve
from steersman.kernels import linearise as kernel
from steersman.kernels import vehicle as car
from steersman.kernels import world
from steersman.kernels.dual_number import WIDTH
from steersman.kernels.fleet import DELAY_LINE
from steersman.kernels.steady_turn import steady_turn

H, SUBSTEPS = 0.01, 5
PEDALS = (0.4, 0.0)


def driven(table: Any, state: Any, commands: Any, late: int, pedals: Any = PEDALS) -> Any:
    """The plant's state after the step."""
    row, delayed = state.copy(), np.zeros(DELAY_LINE)
    delayed[:2] = commands[1], commands[0]  # they move on by one with the step's own command
    line = np.array([commands[1], commands[0], *[0.0] * (DELAY_LINE - 2)])
    # A delay of a whole period and ``late`` substeps: the older acts first.
    world.drive(
        table,
        0,
        row,
        np.array([0.0, *pedals]),
        line,
        SUBSTEPS + late,
        H,
        SUBSTEPS,
        np.zeros((3, car.N_MOTION)),
        np.zeros((0, 2)),
    )
    return row


def linearised(table: Any, state: Any, commands: Any, late: int, pedals: Any = PEDALS) -> Any:
    following = np.zeros(car.N_STATE)
    jacobian = np.zeros((kernel.N_MOVED, kernel.N_COLUMNS))
    scratch = np.full((kernel.N_SCRATCH, WIDTH), np.nan)
    kernel.linearise(
        table, 0, state, pedals, commands, late, H, SUBSTEPS, scratch, following, jacobian
    )
    return following, jacobian


def differences(table: Any, state: Any, commands: Any, late: int) -> Any:
    out = np.zeros((kernel.N_MOVED, kernel.N_COLUMNS))
    for j in range(kernel.N_COLUMNS):
        ends = []
        for side in (1.0, -1.0):
            row, given, h = state.copy(), list(commands), 1e-6
            if j < kernel.N_MOVED:
                h *= max(1.0, abs(row[j]))
                row[j] += side * h
            else:
                given[j - kernel.N_MOVED] += side * h
            ends.append(driven(table, row, tuple(given), late)[: kernel.N_MOVED])
        out[:, j] = (ends[0] - ends[1]) / (2.0 * h)
    return out


def turning(vehicle: str, speed: float, curvature: float) -> tuple[Any, Any]:
    """A car in a turn, a little out of it, so that no number stands at a kink."""
    table = resolve("vehicle", vehicle).table
    state = np.zeros(car.N_STATE)
    steady_turn(table, 0, state, speed, curvature)
    state[: car.N_MOTION] += [3.0, -2.0, 0.7, 0.1, 0.05, 0.02, 0.1, -0.2]
    state[car.THROTTLE] = 0.3
    return table, state


@pytest.mark.parametrize("vehicle", sorted(set(components("vehicle")) - {"file"}))
@pytest.mark.parametrize(("speed", "curvature"), [(4.0, 0.05), (13.0, -0.02), (24.0, 0.004)])
@pytest.mark.parametrize("late", [0, 2])
def test_values_are_the_plants_and_slopes_its_differences(
    vehicle: str, speed: float, curvature: float, late: int
) -> None:
    table, state = turning(vehicle, speed, curvature)
    steer = state[car.STEER]
    commands = (steer + 0.003, steer + 0.004)
    following, jacobian = linearised(table, state, commands, late)
    assert np.array_equal(following, driven(table, state, commands, late))
    wanted = differences(table, state, commands, late)
    assert np.abs(jacobian - wanted).max() < 1e-6 * max(1.0, np.abs(wanted).max())
    assert np.abs(jacobian[:, kernel.NEW_COMMAND]).max() > 0.0


def test_a_command_beyond_the_actuators_speed_has_no_slope() -> None:
    table, state = turning("carla_model3", 13.0, 0.02)
    jacobian = linearised(table, state, (1.0, 1.0), 0)[1]
    assert not jacobian[:, kernel.OLD_COMMAND :].any()


def test_sliding_tyres_keep_their_force() -> None:
    table, state = turning("carla_model3", 13.0, 0.02)
    table = table._replace(rows=table.rows.copy())
    table.rows[0, car.MU] = 0.05
    state[car.VY] = 6.0
    jacobian = linearised(table, state, (0.0, 0.0), 0)[1]
    wanted = differences(table, state, (0.0, 0.0), 0)
    assert np.abs(jacobian - wanted).max() < 1e-6 * max(1.0, np.abs(wanted).max())
