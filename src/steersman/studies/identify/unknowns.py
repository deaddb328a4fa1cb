"""The unknowns: figures of a vehicle, and offsets of the sensors.

A figure is searched as z, the steps of its ``prior`` by which it lies off the starting vehicle's:
value = start x exp(prior z) or, for those that can be zero, start + prior z.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

from steersman.types import FloatArray
from steersman.vehicles import Vehicle

# 95 % of a normal distribution lie within so many standard deviations.
SIGMAS = 1.96
# What is searched of sensors: an offset, how far ahead of the centre of mass they are, and by how
# much the measured steering that is replayed comes late.
OFFSET, ARM, CLOCK = SENSOR = "offset", "arm", "clock"
_LARGEST_ANGLE = 1.5


class Unknown(NamedTuple):
    """A figure that is searched."""

    field: str
    """Field of the vehicle, or one of ``SENSOR`` of the signal ``at``."""
    at: tuple[Any, ...]
    """Indices within the field."""
    unit: str
    start: float
    ratio: bool
    """Whether its steps are factors."""
    prior: float
    """Standard deviation of its distance from the starting vehicle's figure, before the log is
    read: a share of it if ``ratio``, else in its unit."""
    need: float
    """Half width of the 95 % interval (a share or in its unit) beyond which the log is taken not
    to determine it."""
    low: float
    high: float
    coarse: float = 0.0
    """Least difference of z from which intervals are computed: below the step of the integration
    a delay or lag shows in part."""

    @property
    def name(self) -> str:
        """Name as tables have it."""
        return self.field + "".join(f"[{i}]" for i in self.at)

    @property
    def sensor(self) -> bool:
        """Whether it is a sensor's, not the vehicle's."""
        return self.field in SENSOR

    def value(self, z: float) -> float:
        """The figure at ``z``."""
        value = self.start * math.exp(self.prior * z) if self.ratio else self.start + self.prior * z
        return min(max(value, self.low), self.high)

    def z(self, value: float) -> float:
        """Inverse of :meth:`value`."""
        if self.ratio:
            return math.log(value / self.start) / self.prior
        return (value - self.start) / self.prior

    def bounds(self) -> tuple[float, float]:
        """Least and largest z, the start between them."""
        low, high = (self.z(v) for v in (self.low, self.high))
        return min(low, 0.0) - 1e-9, max(high, 0.0) + 1e-9

    @property
    def need_z(self) -> float:
        """``need`` in steps of z."""
        return (math.log1p(self.need) if self.ratio else self.need) / self.prior


def _ratio(
    vehicle: Vehicle, field: str, unit: str, prior: float, need: float, span: float = 5.0
) -> Unknown:
    start = float(getattr(vehicle, field))
    low, high = start / span, start * span
    if field == "max_wheel_angle":
        high = _LARGEST_ANGLE
    return Unknown(field, (), unit, start, True, prior, need, low, high)


def _plain(
    vehicle: Vehicle, field: str, unit: str, prior: float, need: float, low: float, high: float
) -> Unknown:
    start = float(getattr(vehicle, field))
    return Unknown(field, (), unit, start, False, prior, need, low, high)


def steering(vehicle: Vehicle, responses: Iterable[str], *, by_angle: bool) -> list[Unknown]:
    """Of the lateral fit: steering, axles, inertia, sensors.

    Args:
        vehicle: where the search starts.
        responses: signals that are compared.
        by_angle: whether the steering is replayed as it was measured, not as it was commanded: of
            the actuator nothing shows then.
    """
    curve = [
        Unknown(
            "steer_curve_factor", (i,), "-", factor, True, 0.1, 0.06, 0.2 * factor, 2.0 * factor
        )
        for i, factor in enumerate(vehicle.steer_curve_factor)
        if i > 0 and set(vehicle.steer_curve_factor) != {1.0}  # a car without a curve keeps none
    ]
    delay = _plain(vehicle, "steer_delay", "s", 0.05, 0.03, 0.0, 0.5)._replace(coarse=0.1)
    actuator = [
        delay,
        _plain(vehicle, "steer_lag", "s", 0.05, 0.05, 0.0, 0.6)._replace(coarse=0.3),
        _ratio(vehicle, "steer_rate_up", "1/s", 0.5, 0.2, 20.0),
        _ratio(vehicle, "steer_rate_down", "1/s", 0.5, 0.2, 20.0),
    ]
    if by_angle:
        actuator = [delay._replace(field=CLOCK, at=("wheel_angle",), start=0.0, low=-0.3, high=0.3)]
    return [
        *actuator,
        _ratio(vehicle, "max_wheel_angle", "rad", 0.15, 0.2),
        *curve,
        _plain(vehicle, "steer_bias", "rad", 0.02, 0.01, -0.2, 0.2),
        _ratio(vehicle, "c_f", "N/rad", 0.3, 0.5, 10.0),
        _ratio(vehicle, "c_r", "N/rad", 0.3, 0.5, 10.0),
        _ratio(vehicle, "yaw_inertia", "kg m^2", 0.2, 0.5, 4.0),
        *(_offset(name) for name in responses),
        *(
            Unknown(ARM, (name,), "m", 0.0, False, 0.5, 0.3, -4.0, 4.0)
            for name in responses
            if name in {"v_y", "a_y"}
        ),
    ]


# Unit and standard deviation of each sensor's offset.
_OFFSETS: Mapping[str, tuple[str, float]] = {
    "yaw_rate": ("rad/s", 0.005),
    "a_y": ("m/s^2", 0.2),
    "v_y": ("rad", 0.01),
    "wheel_angle": ("rad", 0.01),
    "steer": ("-", 0.01),
}


def _offset(name: str) -> Unknown:
    unit, prior = _OFFSETS[name]
    return Unknown(OFFSET, (name,), unit, 0.0, False, prior, prior, -50.0 * prior, 50.0 * prior)


def pedals(vehicle: Vehicle, *, brake: bool) -> list[Unknown]:
    """Of the longitudinal fit: every knot of the throttle map, and the brakes if they were used."""
    knots = [
        Unknown("map_acceleration", (i, j), "m/s^2", a, False, 2.0, 0.4, a - 20.0, a + 20.0)
        for i, row in enumerate(vehicle.map_acceleration)
        for j, a in enumerate(row)
    ]
    if not brake or vehicle.brake_force == 0.0:
        return knots
    return [*knots, _ratio(vehicle, "brake_force", "N", 0.3, 0.2)]


def vehicle_at(vehicle: Vehicle, unknowns: Sequence[Unknown], z: FloatArray) -> Vehicle:
    """The starting vehicle with the figures of ``z``; offsets are left out."""
    return vehicle.replace(**_figures(vehicle, unknowns, z))


def guess_at(vehicle: Vehicle, unknowns: Sequence[Unknown], z: FloatArray) -> Vehicle:
    """The same, not validated: a search makes thousands of them, within their bounds."""
    guess = vehicle.model_copy(update=_figures(vehicle, unknowns, z))
    guess.__dict__.pop("_built", None)  # belongs to the other figures
    return guess


def _figures(vehicle: Vehicle, unknowns: Sequence[Unknown], z: FloatArray) -> dict[str, Any]:
    figures: dict[str, Any] = {}
    for unknown, step in zip(unknowns, z.tolist(), strict=True):
        if unknown.sensor:
            continue
        if not unknown.at:
            figures[unknown.field] = unknown.value(step)
            continue
        if unknown.field not in figures:
            figures[unknown.field] = _lists(getattr(vehicle, unknown.field))
        nested = figures[unknown.field]
        for i in unknown.at[:-1]:
            nested = nested[i]
        nested[unknown.at[-1]] = unknown.value(step)
    if "steer_curve_factor" in figures:  # no wheel turns further than the model goes
        most = 0.999999 * _LARGEST_ANGLE / figures.get("max_wheel_angle", vehicle.max_wheel_angle)
        figures["steer_curve_factor"] = [min(f, most) for f in figures["steer_curve_factor"]]
    if "map_acceleration" in figures:  # it was measured with this mass
        figures["map_mass"] = figures["map_drag_area"] = None
    return figures


class Sensors(NamedTuple):
    """What the sensors add to the car's own motion."""

    offsets: Mapping[str, float]
    """Signal -> offset, of v_y an angle [rad]: its sensor may be mounted askew."""
    arms: Mapping[str, float]
    """Signal -> how far ahead of the centre of mass it was measured [m]."""
    clock: float = 0.0
    """Delay of the answer to the measured steering that is replayed [s]."""
    yaw_rate_lag: float = 0.0
    """Time constant of the yaw rate's low pass [s]."""


def sensors_at(unknowns: Sequence[Unknown], z: FloatArray, yaw_rate_lag: float) -> Sensors:
    """The sensors at ``z``."""
    by: dict[str, dict[str, float]] = {field: {} for field in SENSOR}
    for unknown, step in zip(unknowns, z.tolist(), strict=True):
        if unknown.sensor:
            by[unknown.field][unknown.at[0]] = unknown.value(step)
    return Sensors(by[OFFSET], by[ARM], sum(by[CLOCK].values()), yaw_rate_lag)


def _lists(values: Any) -> Any:
    return [_lists(v) for v in values] if isinstance(values, (list, tuple)) else values
