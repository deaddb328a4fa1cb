"""What a scenario changes: the car, its sensors and the controller's nominal vehicle."""

from __future__ import annotations

import math
from typing import Annotated, Any, TypeVar

import numpy as np

from steersman.config import Of, Settings, param
from steersman.controllers.model_error import ModelError
from steersman.disturbances import DisturbanceComponent, PositionDrift, SensorBias
from steersman.faults import Fault
from steersman.kernels.vehicle import GRAVITY
from steersman.plants.base import ComputedComponent, PlantComponent
from steersman.rollout import RunConfig
from steersman.speed import SpeedComponent, SpeedTracking
from steersman.vehicles import Vehicle

# A run or, from the package for learning, a Problem.
C = TypeVar("C", bound=Any)
# Fields that are the sensor's of the same name.
_NOISES = ("position_noise", "heading_noise", "speed_noise", "v_y_noise", "yaw_rate_noise")
# Steps that differ by less are the same, but for rounding.
_SAME = 1e-6


class Disturbance(Settings):
    """How a run differs from a clean one; the defaults are the clean run.

    The controller's nominal vehicle is the suite's, times ``model``: controllers compute with
    the undisturbed mass.
    """

    delay: float = param(0.0, "s", "Steering delay.", ge=0)
    waypoint_noise: float = param(
        0.0, "m", "Waypoints are shifted by up to this in x and in y, anew at each step.", ge=0
    )
    mass: float = param(1.0, "-", "Factor on the mass.", gt=0)
    yaw_inertia: float = param(1.0, "-", "Factor on the yaw inertia.", gt=0)
    c_f: float = param(1.0, "-", "Factor on the front cornering stiffness.", gt=0)
    c_r: float = param(1.0, "-", "Factor on the rear cornering stiffness.", gt=0)
    friction: float | None = param(
        None, "-", "Tyre friction coefficient, with speeds to match; null: the vehicle's.", gt=0
    )
    used_grip: float = param(
        0.6, "-", "Share of that friction which speeds ask for in bends.", gt=0, le=2
    )
    used_along: float | None = param(
        0.3, "-", "Share which speeding up behind bends asks for; null: what the engine has.", gt=0
    )
    steer_rate: float = param(1.0, "-", "Factor on the steering actuator's rates.", gt=0)
    steer_bias: float = param(0.0, "rad", "Inner wheel angle at centred steering.")
    wind: float = param(0.0, "m/s", "Strongest gust of side wind.", ge=0)
    position_noise: float = param(0.0, "m", "SD of the measured position in x and in y.", ge=0)
    heading_noise: float = param(0.0, "rad", "SD of the measured yaw.", ge=0)
    speed_noise: float = param(0.0, "m/s", "SD of the measured v_x and v_y.", ge=0)
    v_y_noise: float | None = param(None, "m/s", "SD of the measured v_y; null: that of v_x.", ge=0)
    yaw_rate_noise: float = param(0.0, "rad/s", "SD of the measured yaw rate.", ge=0)
    latency: float = param(0.0, "s", "Age of the observation that arrives.", ge=0, le=0.5)
    start_offset: float = param(0.0, "m", "The run starts so far beside the path, left positive.")
    start_heading: float = param(
        0.0, "rad", "It starts turned by this against the path.", ge=-math.pi, le=math.pi
    )
    disturbances: tuple[Annotated[DisturbanceComponent, Of("disturbance")], ...] = param(
        (), "-", "Further ones: biased sensors, drift, drop-outs, friction that changes."
    )
    model: ModelError = param(
        ModelError(), "-", "Factors on the nominal vehicle of model-based controllers."
    )
    fault: Fault | None = param(None, "-", "What breaks on the way; null: nothing.")

    def beyond(self, plant: PlantComponent) -> list[str]:
        """What of this the plant cannot do, by the names of the fields.

        A steering delay acts in whole steps of the plant; where cars are computed here it is
        rounded. Sensors and controllers are disturbed outside the plant.
        """
        nothing = Disturbance()
        found = sorted(n for n in plant.cannot if getattr(self, n) != getattr(nothing, n))
        if not plant.computed and any(one.make(1, 0).on_vehicle for one in self.disturbances):
            found.append("disturbances")
        steps = self.delay / plant.h
        whole = plant.computed or abs(steps - round(steps)) <= _SAME
        return found if whole or "delay" in found else [*found, "delay"]

    def apply(self, run: C) -> C:
        """The run, or the problem of a training, with this disturbance.

        ``run.vehicle`` is the undisturbed one.
        """
        true, nominal = self._car(run.vehicle), self.model.nominal(run.vehicle)
        noise = {name: getattr(self, name) for name in _NOISES}
        plant: dict[str, Any] = {"steering_delay": run.plant.steering_delay + self.delay}
        if isinstance(run.plant, ComputedComponent):
            # Another stream of numbers than the sensors': the run's seed itself is theirs.
            wind = {"speed": self.wind, "seed": run.seed ^ 1}
            plant["wind"] = run.plant.wind.model_copy(update=wind) if self.wind else run.plant.wind
        changes: dict[str, Any] = {
            "vehicle": true,
            "nominal": None if nominal == true else nominal,
            "plant": run.plant.model_copy(update=plant),
            "sensor": run.sensor.model_copy(
                update={"error_range": self.waypoint_noise, "latency": self.latency, **noise}
            ),
            "fault": self.fault,
            "disturbances": (*run.disturbances, *self.disturbances),
        }
        if isinstance(run, RunConfig):
            changes["speed"] = self._careful(run.speed)
            beside = {"offset": self.start_offset, "heading": self.start_heading}
            changes["start"] = run.start.model_copy(update=beside)
        else:
            changes["speeds"] = tuple(map(self._careful, run.speeds))
        disturbed: C = run.model_copy(update=changes)
        return disturbed

    def _careful(self, speed: SpeedComponent) -> SpeedComponent:
        """Slower on a slippery road, so that part of the grip stays unused."""
        if self.friction is None or not isinstance(speed, SpeedTracking):
            return speed
        cap = self.used_grip * self.friction * GRAVITY
        cap = cap if speed.a_lat_max is None else min(cap, speed.a_lat_max)
        changes = {"a_lat_max": cap}
        if self.used_along is not None:
            along = self.used_along * self.friction * GRAVITY
            own = speed.acceleration
            changes["acceleration"] = along if own is None else min(along, own)
        return speed.model_copy(update=changes)

    def _car(self, vehicle: Vehicle) -> Vehicle:
        figures: dict[str, float] = {}
        for name in ("mass", "yaw_inertia", "c_f", "c_r"):
            if getattr(self, name) != 1.0:
                figures[name] = getattr(vehicle, name) * getattr(self, name)
        if self.mass != 1.0:
            # The throttle map stays that of the undisturbed car: a heavier one accelerates less.
            figures["map_mass"] = vehicle.mass if vehicle.map_mass is None else vehicle.map_mass
        if self.steer_rate != 1.0:
            figures["steer_rate_up"] = vehicle.steer_rate_up * self.steer_rate
            figures["steer_rate_down"] = vehicle.steer_rate_down * self.steer_rate
        if self.friction is not None:
            figures["friction"] = self.friction
        if self.steer_bias:
            figures["steer_bias"] = vehicle.steer_bias + self.steer_bias
        if not figures:
            return vehicle
        return vehicle.replace(**figures)

    def figures(self) -> dict[str, float | str | None]:
        """Every number by its name, what breaks by its kind.

        Those of the model and of further disturbances have ``model_`` or their kind before them.
        """
        plain = self.model_dump()
        model, fault = plain.pop("model"), plain.pop("fault")
        plain["fault"] = None if fault is None else fault["kind"]
        parts = {"model": model}
        for count, one in enumerate(plain.pop("disturbances")):
            kind = one.pop("kind")
            parts[f"{kind}_{count}" if kind in parts else kind] = one
        return plain | {f"{n}_{k}": value for n, part in parts.items() for k, value in part.items()}


class Mixed(Settings):
    """Everything at once, drawn from the benchmark's seed; each range is drawn from uniformly."""

    delay: float = param(0.2, "s", "Longest steering delay.", ge=0)
    waypoint_noise: float = param(0.1, "m", "Largest range of waypoint errors.", ge=0)
    mass: float = param(0.2, "-", "Mass is scaled by up to 1 +- this.", ge=0, lt=1)
    yaw_inertia: float = param(0.2, "-", "Yaw inertia is scaled by up to 1 +- this.", ge=0, lt=1)
    stiffness: float = param(0.3, "-", "Each axle's stiffness, up to 1 +- this.", ge=0, lt=1)
    v_y: float = param(0.0, "m/s", "Largest error of the measured lateral velocity.", ge=0)
    yaw_rate: float = param(0.0, "rad/s", "Largest error of the measured yaw rate.", ge=0)
    v_x_scale: float = param(0.0, "-", "Largest share by which v_x is read wrong.", ge=0, lt=1)
    drift: float = param(0.0, "m", "Largest SD of the position's slow error.", ge=0)

    def draw(self, rng: np.random.Generator) -> Disturbance:
        """One disturbance out of the ranges."""
        delay, noise = rng.uniform(0.0, 1.0, 2) * (self.delay, self.waypoint_noise)
        spread = (self.mass, self.yaw_inertia, self.stiffness, self.stiffness)
        mass, inertia, c_f, c_r = (1.0 + rng.uniform(-1.0, 1.0, 4) * spread).tolist()
        more: list[DisturbanceComponent] = []
        if self.v_y or self.yaw_rate or self.v_x_scale:
            v_y, yaw_rate, scale = rng.uniform(-1.0, 1.0, 3).tolist()
            more.append(
                SensorBias(
                    v_y=v_y * self.v_y,
                    yaw_rate=yaw_rate * self.yaw_rate,
                    v_x_scale=scale * self.v_x_scale,
                )
            )
        if self.drift:
            more.append(PositionDrift(deviation=float(rng.uniform(0.0, self.drift))))
        return Disturbance(
            delay=float(delay),
            waypoint_noise=float(noise),
            mass=mass,
            yaw_inertia=inertia,
            c_f=c_f,
            c_r=c_r,
            disturbances=tuple(more),
        )
