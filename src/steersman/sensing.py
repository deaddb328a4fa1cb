"""Sensors: from the vehicle's true place on the path to the controller's observation."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import NamedTuple

import numpy as np

from steersman.config import Component, param, register
from steersman.disturbances import Disturber
from steersman.episode import Episode
from steersman.errors import ConfigError
from steersman.kernels import observe as kernel
from steersman.kernels import vehicle as car
from steersman.kernels.fleet import Fleet, World
from steersman.protocols import Path
from steersman.types import FloatArray, Observation, VehicleState

NO_SHIFT = np.zeros((0, 2))
# Times that differ by less are the same, but for rounding [s].
_SAME = 1e-9


class Tracking(NamedTuple):
    """The truth about a vehicle on its path, at the centre of mass."""

    s: float
    """Arc length of the closest point [m]."""
    lateral_error: float
    """Signed distance from the path, left positive [m]."""
    heading_error: float
    """Yaw minus path tangent, in (-pi, pi] [rad]."""
    course_error: float
    """Direction of the velocity minus path tangent, in (-pi, pi] [rad]."""
    curvature: float
    """Path curvature at the closest point [1/m]."""
    path_x: float
    """Closest point [m]."""
    path_y: float
    """Closest point [m]."""


# The columns of a kernel's state row in the order of a VehicleState behind its time.
STATE_COLUMNS = [
    *(car.X, car.Y, car.PSI, car.VX, car.VY, car.YAW_RATE, car.AX, car.AY),
    *(car.STEER, car.WHEEL, car.THROTTLE, car.BRAKE),
]


def state_row(state: VehicleState) -> FloatArray:
    """A state as a kernel's row (N_STATE,); the loads, which it does not hold, are zero."""
    row = np.zeros(car.N_STATE)
    row[STATE_COLUMNS] = state[1:]
    return row


def to_state(row: FloatArray, time: float) -> VehicleState:
    """A kernel's state row as a named tuple, at a time [s]."""
    return VehicleState(time, *row[STATE_COLUMNS].tolist())


def track(state: VehicleState, path: Path, near: float) -> Tracking:
    """Project the vehicle onto the path, searching from arc length ``near`` [m]."""
    out = np.zeros(kernel.N_TRACKING)
    kernel.track(path.table, 0, state_row(state), near, out)
    return Tracking(*out.tolist())


def to_observation(row: FloatArray, time: float, spacing: float) -> Observation:
    """A kernel's observation row as a named tuple; the preview is a view of the row."""
    d, heading, v_x, v_y, rate, steer, kappa = row[: kernel.O_PREVIEW].tolist()
    preview = row[kernel.O_PREVIEW :].reshape(-1, 2)
    return Observation(time, d, heading, v_x, v_y, rate, steer, kappa, preview, spacing)


def to_row(observation: Observation, waypoints: int, spacing: float) -> FloatArray:
    """An observation as the kernels' row.

    Raises:
        ConfigError: the sensor's waypoints are not those that the policy was trained with.
    """
    given = len(observation.preview)
    if given < waypoints or abs(observation.spacing - spacing) > _SAME:
        raise ConfigError(
            f"the policy reads {waypoints} waypoints {spacing:g} m apart, but the sensor gives "
            f"{given}, {observation.spacing:g} m apart; set sensor.count and sensor.spacing"
        )
    row = np.empty(kernel.O_PREVIEW + 2 * waypoints)
    row[: kernel.O_PREVIEW] = observation[1:8]
    row[kernel.O_PREVIEW :] = observation.preview[:waypoints].ravel()
    return row


@cache
def _fit_weights(count: int, spacing: float) -> FloatArray:
    """Pseudo-inverse of the parabola's design matrix, made once and never written into."""
    u = np.arange(count) * spacing
    design = np.stack([np.ones_like(u), u, 0.5 * u * u], axis=1)
    # Not marked as read-only: for numba that is another type, and kernels would compile twice.
    return np.ascontiguousarray(np.linalg.pinv(design))


@register("sensor", "waypoints")
class WaypointSensor(Component):
    """Waypoints ahead at equal distances, and the errors that follow from them.

    With waypoint errors, lateral error, heading error and curvature are those of the road as
    estimated from the shifted waypoints, so no controller sees more than the others. Errors of
    pose and speed are normal and drawn anew at each step; the road is measured from
    the wrong pose.
    """

    count: int = param(15, "-", "Number of waypoints, the first beside the car.", ge=4, le=100)
    spacing: float = param(2.0, "m", "Distance between waypoints.", gt=0, le=1e3)
    error_range: float = param(
        0.0, "m", "Waypoints are shifted by up to this in x and in y, uniformly.", ge=0
    )
    redraw: bool = param(True, "-", "New shifts at every step; else one draw for the whole run.")
    position_noise: float = param(
        0.0, "m", "SD of the error of the vehicle's position in x and in y.", ge=0
    )
    heading_noise: float = param(0.0, "rad", "SD of the error of the vehicle's yaw.", ge=0)
    speed_noise: float = param(0.0, "m/s", "SD of the errors of v_x and of v_y.", ge=0)
    v_y_noise: float | None = param(None, "m/s", "SD of the error of v_y; null: that of v_x.", ge=0)
    yaw_rate_noise: float = param(0.0, "rad/s", "SD of the error of the yaw rate.", ge=0)
    latency: float = param(
        0.0, "s", "Age of the observation that arrives; whole control periods.", ge=0, le=0.5
    )

    @property
    def deviations(self) -> tuple[float, ...]:
        """SDs of the first columns of a state row: x, y [m], yaw [rad], v_x, v_y, yaw rate."""
        position, v_x = self.position_noise, self.speed_noise
        v_y = v_x if self.v_y_noise is None else self.v_y_noise
        return position, position, self.heading_noise, v_x, v_y, self.yaw_rate_noise

    def periods(self, dt: float) -> int:
        """The latency in control periods of ``dt`` [s].

        Raises:
            ConfigError: it is no whole number of them.
        """
        count = round(self.latency / dt)
        if abs(count * dt - self.latency) > _SAME:
            raise ConfigError(
                f"{self.latency:g} is not allowed; give whole control periods of {dt:g} s, "
                f"e.g. {count * dt:g} [s]",
                ("sensor", "latency"),
            )
        return count

    def fit_weights(self) -> FloatArray:
        """Weights (3, count) of the least-squares parabola: value, slope, second derivative."""
        return _fit_weights(self.count, self.spacing)

    def draw(self, rng: np.random.Generator) -> FloatArray:
        """Shifts of all waypoints (count, 2) in the vehicle's frame; (0, 2) without errors."""
        if self.error_range == 0.0:
            return NO_SHIFT
        return rng.uniform(-self.error_range, self.error_range, (self.count, 2))

    def make(self, n: int, seed: int) -> Disturber | None:
        """Its errors at work on a world; None where it has none."""
        return SensorErrors(self) if any(self.deviations) or self.error_range > 0.0 else None

    def init(self, rng: np.random.Generator) -> FloatArray | None:
        """State before the first step: the fixed shifts, if they are fixed."""
        return None if self.redraw else self.draw(rng)

    def observe(
        self,
        sensor_state: FloatArray | None,
        state: VehicleState,
        tracking: Tracking,
        path: Path,
        rng: np.random.Generator,
    ) -> Observation:
        """The controller's observation of the path at this moment."""
        row = np.zeros(kernel.O_PREVIEW + 2 * self.count)
        vehicle, place = state_row(state), np.array(tracking)
        if any(self.deviations):
            vehicle[: kernel.N_MEASURED] += rng.normal(0.0, self.deviations)
            kernel.track(path.table, 0, vehicle, tracking.s, place)
        shift = self.draw(rng) if sensor_state is None else sensor_state
        weights = self.fit_weights() if shift.shape[0] else NO_SHIFT
        kernel.sense(
            path.table,
            0,
            vehicle,
            place,
            self.spacing,
            self.count,
            shift,
            weights,
            row,
        )
        return to_observation(row, state.time, self.spacing)


def observations(
    episode: Episode, path: Path, sensor: WaypointSensor, count: int
) -> list[Observation]:
    """What ``sensor`` gives at the first ``count`` steps of a recorded drive on ``path``."""
    rng = np.random.default_rng(0)
    out = []
    for k in range(min(count, len(episode))):
        state = VehicleState(*(float(episode[name][k]) for name in VehicleState._fields))
        place = track(state, path, float(episode["s"][k]))
        out.append(sensor.observe(None, state, place, path, rng))
    return out


class SensorErrors(Disturber):
    """Errors of pose, velocities and waypoints, drawn from each vehicle's own generator."""

    def __init__(self, sensor: WaypointSensor) -> None:
        """Of that sensor."""
        self._sensor, self._deviations = sensor, np.array(sensor.deviations)
        self.errors = bool(self._deviations.any())

    def begin(self, world: World, fleet: Fleet, i: int, rng: np.random.Generator) -> None:
        """Draw the waypoints' errors, if they stay for the whole drive."""
        if not self._sensor.redraw and fleet.shifts.shape[1]:
            fleet.shifts[i] = fleet.levels[i] * self._sensor.draw(rng)

    def sense_each(
        self,
        world: World,
        fleet: Fleet,
        chosen: Sequence[int],
        times: FloatArray,
        rngs: Sequence[np.random.Generator],
    ) -> None:
        """Draw the errors of this moment, each vehicle's from its own generator."""
        levels, error_range = fleet.levels[chosen], self._sensor.error_range
        moved = self._sensor.redraw and fleet.shifts.shape[1] > 0
        normal = np.zeros((len(chosen), kernel.N_MEASURED))
        uniform = np.zeros((len(chosen), *fleet.shifts.shape[1:]))
        for i, pose, shift in zip(chosen, normal, uniform, strict=True):
            if self.errors:
                rngs[i].standard_normal(out=pose)
            if moved:
                rngs[i].random(out=shift)
        if self.errors:
            errors = levels[:, None] * (self._deviations * normal)
            fleet.errors[chosen, : kernel.N_MEASURED] += errors
        if moved:
            fleet.shifts[chosen] = levels[:, None, None] * (
                2.0 * error_range * uniform - error_range
            )
