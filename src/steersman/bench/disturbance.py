"""What a scenario does to the car, to its sensors and to what its controller believes."""

from __future__ import annotations

from typing import Any

import numpy as np

from steersman.config import Settings, param
from steersman.controllers.mpc_pid import ModelError
from steersman.rollout import RunConfig
from steersman.vehicles import Vehicle


class Disturbance(Settings):
    """How a run differs from a clean one; the defaults are the clean run.

    The controller is told of the vehicle as the suite names it, times ``model``: a disturbed mass
    is one that no controller knows of.
    """

    delay: float = param(0.0, "s", "Steering delay.", ge=0)
    waypoint_noise: float = param(
        0.0, "m", "Waypoints are shifted by up to this in x and in y, anew at each step.", ge=0
    )
    mass: float = param(1.0, "-", "Factor on the mass.", gt=0)
    yaw_inertia: float = param(1.0, "-", "Factor on the yaw inertia.", gt=0)
    c_f: float = param(1.0, "-", "Factor on the front cornering stiffness.", gt=0)
    c_r: float = param(1.0, "-", "Factor on the rear cornering stiffness.", gt=0)
    model: ModelError = param(
        ModelError(), "-", "Factors on the vehicle that model-based controllers believe in."
    )

    def apply(self, run: RunConfig) -> RunConfig:
        """The run with this disturbance; ``run.vehicle`` is the undisturbed one."""
        true, believed = self._car(run.vehicle), self.model.nominal(run.vehicle)
        sensor = run.sensor.model_copy(update={"error_range": self.waypoint_noise})
        changes: dict[str, Any] = {
            "vehicle": true,
            "nominal": None if believed == true else believed,
            "plant": run.plant.model_copy(update={"steering_delay": self.delay}),
            "sensor": sensor,
        }
        return run.model_copy(update=changes)

    def _car(self, vehicle: Vehicle) -> Vehicle:
        factors = {name: getattr(self, name) for name in ("mass", "yaw_inertia", "c_f", "c_r")}
        if all(factor == 1.0 for factor in factors.values()):
            return vehicle
        figures = {name: getattr(vehicle, name) * factor for name, factor in factors.items()}
        # The throttle map stays that of the undisturbed car: a heavier one accelerates less.
        known = vehicle.mass if vehicle.map_mass is None else vehicle.map_mass
        return vehicle.replace(map_mass=known, **figures)

    def figures(self) -> dict[str, float]:
        """Every number by its name, those of the model as ``model_mass`` and so on."""
        plain = self.model_dump()
        model = plain.pop("model")
        return plain | {f"model_{name}": value for name, value in model.items()}


class Mixed(Settings):
    """Everything at once, drawn from the benchmark's seed; each range is drawn from uniformly."""

    delay: float = param(0.2, "s", "Longest steering delay.", ge=0)
    waypoint_noise: float = param(0.1, "m", "Largest range of waypoint errors.", ge=0)
    mass: float = param(0.2, "-", "Mass is scaled by up to 1 +- this.", ge=0, lt=1)
    yaw_inertia: float = param(0.2, "-", "Yaw inertia is scaled by up to 1 +- this.", ge=0, lt=1)
    stiffness: float = param(0.3, "-", "Each axle's stiffness, up to 1 +- this.", ge=0, lt=1)

    def draw(self, rng: np.random.Generator) -> Disturbance:
        """One disturbance out of the ranges."""
        delay, noise = rng.uniform(0.0, 1.0, 2) * (self.delay, self.waypoint_noise)
        spread = (self.mass, self.yaw_inertia, self.stiffness, self.stiffness)
        mass, inertia, c_f, c_r = (1.0 + rng.uniform(-1.0, 1.0, 4) * spread).tolist()
        return Disturbance(
            delay=float(delay),
            waypoint_noise=float(noise),
            mass=mass,
            yaw_inertia=inertia,
            c_f=c_f,
            c_r=c_r,
        )
