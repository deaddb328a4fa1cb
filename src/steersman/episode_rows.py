"""From the rows of a drive, as the kernels fill them, to the columns of its episode."""

from __future__ import annotations

import numpy as np

from steersman.episode import COLUMNS, LEAD_COLUMNS
from steersman.kernels.lead import GAP, SPEED
from steersman.sensing import Tracking
from steersman.types import FloatArray

# Names of what a state row, a tracking row and a step hold, as the columns of an episode have them.
_ROW = (
    *("x", "y", "psi", "v_x", "v_y", "yaw_rate", "load_a_x", "load_a_y"),
    *("steer", "throttle_position", "brake_position", "a_x", "a_y", "wheel_angle"),
    *Tracking._fields,
)
_MORE = (
    *("time", "steer_command", "throttle", "brake"),
    *("control_time", "status", "driver", "reason"),
)
N_MORE = len(_MORE)


def columns_of(
    rows: FloatArray, more: FloatArray, lead: FloatArray | None = None
) -> dict[str, FloatArray]:
    """An episode's columns.

    Args:
        rows: state and tracking before each step, (steps, N_STATE + N_TRACKING).
        more: time, command, computing time, status, driver and reason of each, (steps, 8).
        lead: the car ahead before each step, (steps, N_LEAD or 0); None: there is none.
    """
    found: dict[str, FloatArray] = {}
    for names, table in ((_ROW, rows), (_MORE, more)):
        found |= zip(names, table.reshape(-1, len(names)).T, strict=True)
    columns = {name: np.ascontiguousarray(found[name]) for name in COLUMNS}
    if lead is not None and lead.shape[1]:
        columns |= zip(LEAD_COLUMNS, lead.T[[GAP, SPEED]].copy(), strict=True)
    return columns
