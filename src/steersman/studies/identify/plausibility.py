"""Wrong units and signs in recordings, with which a fit would converge to wrong figures.

Each check compares two columns that physics ties together; a slope near a known factor (degrees,
g, km/h, minus one) names the column and its probable unit or sign.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from steersman.errors import DataError
from steersman.kernels.vehicle import YAW_RATE
from steersman.studies.identify import stretch_replay
from steersman.studies.identify.recording import Log
from steersman.studies.identify.stretch_replay import Stretch
from steersman.types import FloatArray
from steersman.vehicles import Vehicle

# A slope is a factor if it is nearer than this ratio, and the two signals go together this well.
_NEAR = 1.25
_TOGETHER = 0.8
_AGAINST = -0.5
# Slopes of the vehicle's answer differ more: cars do.
_NEAR_CAR = 2.0
# Limit of a column, and the cure if it is exceeded.
_LIMITS = {
    "steer_command": (1.01, "steering is from -1 to 1; in percent name it steer_command_percent, "
                      "as an angle steer_angle_deg or steer_angle_rad (with --lock)"),
    "steer": (1.05, "steering is from -1 to 1; in percent name it steer_percent"),
    "throttle": (1.01, "pedals are from 0 to 1; in percent name it throttle_percent"),
    "brake": (1.01, "pedals are from 0 to 1; in percent name it brake_percent"),
    "wheel_angle": (1.6, "that is beyond a right angle [rad]; in degrees name it wheel_angle_deg"),
    "v_x": (120.0, "that is faster than cars go [m/s]; in km/h name it v_x_km_h"),
}  # fmt: skip
_SPREAD = 1e-3


def check(log: Log, stretches: list[Stretch], vehicle: Vehicle) -> None:
    """Refuse a recording whose columns contradict each other.

    Raises:
        DataError: one line says which column seems to be what.
    """
    if not stretches:
        raise DataError(f"{log.name}: no stretch of 3 s without a gap of more than 0.5 s")
    for name, (limit, cure) in _LIMITS.items():
        values = log.get(name)
        if values is not None and float(np.nanmax(np.abs(values))) > limit:
            most = float(values[np.nanargmax(np.abs(values))])
            raise DataError(f"{log.name}: {name} reaches {most:.4g}; {cure}")
    for name in ("throttle", "brake"):
        values = log.get(name)
        if values is not None and float(np.nanmin(values)) < -0.01:  # noqa: PLR2004 - rounding
            raise DataError(f"{log.name}: {name} is negative; pedals are from 0 to 1")
    _turning(log, stretches)
    _gaining(log, stretches)
    _answering(log, stretches, vehicle)


def _joined(log: Log, stretches: list[Stretch], name: str) -> FloatArray:
    return np.concatenate([log.signals[name][s.rows] for s in stretches])


def _slope(x: FloatArray, y: FloatArray) -> tuple[float, float]:
    """Slope of y on x through zero, by the ratio of their spreads, and the correlation."""
    known = np.isfinite(x) & np.isfinite(y)
    x, y = x[known], y[known]
    if len(x) < 20 or np.std(x) == 0.0 or np.std(y) == 0.0:  # noqa: PLR2004 - too few to say
        return 1.0, 0.0
    low, high = np.percentile(np.abs(x), 99.0), np.percentile(np.abs(y), 99.0)
    x, y = np.clip(x, -low, low), np.clip(y, -high, high)
    together = float(np.corrcoef(x, y)[0, 1])
    return float(np.std(y) / np.std(x)) * math.copysign(1.0, together), together


def _turning(log: Log, stretches: list[Stretch]) -> None:
    """a_y = v_x yaw_rate, nearly."""
    if log.get("a_y") is None:
        return
    turn = _joined(log, stretches, "v_x") * _joined(log, stretches, "yaw_rate")
    slope, together = _slope(turn, _joined(log, stretches, "a_y"))
    meanings = {
        math.pi / 180.0: "yaw_rate seems to be in degrees a second; name it yaw_rate_deg_s",
        180.0 / math.pi: "yaw_rate seems to be in rad/s already; name it yaw_rate_rad_s",
        1.0 / 9.81: "a_y seems to be in g; name it a_y_g",
        9.81: "a_y seems to be in m/s^2 already; name it a_y_m_s2",
        1.0 / 3.6: "v_x seems to be in km/h; name it v_x_km_h",
        3.6: "v_x seems to be in m/s already; name it v_x_m_s",
    }
    _refuse(log, "a_y is {slope:.3g} times v_x yaw_rate", slope, together, meanings, _NEAR)
    if together < -_TOGETHER:
        raise DataError(
            f"{log.name}: a_y and yaw_rate have opposite signs; both are positive to the left"
            " (change the sign of the one that is not)"
        )


def _gaining(log: Log, stretches: list[Stretch]) -> None:
    """a_x = the change of v_x, nearly."""
    if log.get("a_x") is None:
        return
    found = []
    for stretch in stretches:
        change = np.gradient(stretch.speed, stretch_replay.H)
        found.append(stretch_replay.at_rows(stretch, change))
    slope, together = _slope(np.concatenate(found), _joined(log, stretches, "a_x"))
    meanings = {
        1.0 / 9.81: "a_x seems to be in g; name it a_x_g",
        1.0 / 3.6: "v_x seems to be in km/h; name it v_x_km_h",
    }
    _refuse(log, "a_x is {slope:.3g} times the change of v_x", slope, together, meanings, _NEAR)
    if together < -_TOGETHER:
        raise DataError(
            f"{log.name}: a_x is negative while v_x grows; accelerations ahead are positive"
        )


def _answering(log: Log, stretches: list[Stretch], vehicle: Vehicle) -> None:
    """The yaw rate is about what the starting vehicle's is."""
    best, slope = 0.0, 1.0
    # Whatever unit it is in, the yaw rate is no state to start from.
    stretches = [s._replace(yaw_rate=0.0) for s in stretches]
    seen = _joined(log, stretches, "yaw_rate")
    for delay in (0.0, 0.1, 0.2, 0.3, 0.4):
        late = vehicle.replace(steer_delay=delay)
        rates = [
            stretch_replay.at_rows(s, stretch_replay.lateral(late, s)[:, YAW_RATE])
            for s in stretches
        ]
        gain, together = _slope(np.concatenate(rates), seen)
        if abs(together) > abs(best):
            best, slope = together, gain
    if best < _AGAINST:
        raise DataError(
            f"{log.name}: the car turns against its steering; steer_command and yaw_rate are both "
            "positive to the left (change the sign of the one that is not)"
        )
    if float(np.nanstd(_joined(log, stretches, "steer_command"))) < _SPREAD:
        return
    rate = "is yaw_rate in degrees a second (yaw_rate_deg_s)"
    meanings = {
        180.0 / math.pi: f"{rate}, or --lock in degrees?" if log.by_angle else f"{rate}?",
        math.pi / 180.0: "is yaw_rate in rad/s already, or steer_command an angle (steer_angle_rad "
        "and --lock)?",
    }
    what = "the car turns {slope:.3g} times as fast as " + (vehicle.title or "it") + " would"
    _refuse(log, what, slope, best, meanings, _NEAR_CAR)


def _refuse(
    log: Log,
    what: str,
    slope: float,
    together: float,
    meanings: Mapping[float, str],
    near: float,
) -> None:
    if abs(together) < _TOGETHER:
        return
    for factor, meaning in meanings.items():
        if max(abs(slope) / factor, factor / max(abs(slope), 1e-12)) < near:
            raise DataError(f"{log.name}: {what.format(slope=abs(slope))}: {meaning}")
