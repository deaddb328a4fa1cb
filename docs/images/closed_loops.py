"""Closed loops that several figures show."""

from __future__ import annotations

from typing import Any

import numpy as np

from steersman.config import resolve
from steersman.episode import Episode
from steersman.kernels.observe import D
from steersman.paths.analytic import Straight
from steersman.paths.base import PathComponent
from steersman.plants.simulator import SimulatorConfig
from steersman.profiles import stack_profiles
from steersman.rollout import RunConfig, run
from steersman.sensing import WaypointSensor
from steersman.speed import ConstantSpeed, SpeedComponent
from steersman.types import FloatArray, Pose
from steersman.vehicles import CarlaModel3
from steersman.world import Simulation

CAR = CarlaModel3()
ROAD = Straight(distance=1000.0)


def back_to_the_road(
    controller: Any, speed: float = 10.0, offset: float = 0.5, seconds: float = 4.0
) -> tuple[FloatArray, FloatArray]:
    """Time [s] and lateral error [m] of a car that starts beside a straight road."""
    driver: Any = resolve("controller", controller)
    source = ConstantSpeed(speed=speed)
    table = stack_profiles([source.profile()], [ROAD])
    world = Simulation(
        SimulatorConfig(), CAR, WaypointSensor(), (ROAD,), table, corridor=2.0 * abs(offset)
    )
    world.begin(0, 0, 0.0, Pose(0.0, offset, 0.0), speed, source.profile())
    world.look(0)
    state, times, errors = driver.init(CAR, world.dt), [], []
    while world.time(0) < seconds:
        decision, state = driver.step(state, world.observation(0))
        times.append(world.time(0))
        errors.append(world.fleet.tracking[0, D])
        world.step(np.array([decision.steer]))
    return np.array(times), np.array(errors)


def drive(
    controller: Any,
    path: PathComponent,
    speed: float | SpeedComponent = 10.0,
    *,
    seconds: float | None = None,
    delay: float = 0.0,
    sensor: WaypointSensor | None = None,
    friction: float | None = None,
) -> Episode:
    """A run from the path's start; the controller knows of no other ``friction``."""
    driver: Any = resolve("controller", controller)
    source = speed if isinstance(speed, SpeedComponent) else ConstantSpeed(speed=speed)
    parts = {
        "plant": SimulatorConfig(steering_delay=delay),
        "vehicle": CAR if friction is None else CAR.replace(friction=friction),
        "nominal": CAR,
        "controller": driver,
        "path": path,
        "speed": source,
        "sensor": sensor or WaypointSensor(),
        "duration": seconds,
    }
    return run(RunConfig().model_copy(update=parts))


def responses(title: str, variants: dict[str, Any], **options: Any) -> dict[str, Any]:
    """A figure of several controllers' ways back to the road."""
    lines = []
    for name, controller in variants.items():
        time, error = back_to_the_road(controller, **options)
        lines.append({"name": name, "x": time, "y": error})
    return {"title": title, "x": "time [s]", "y": "lateral error [m]", "lines": lines}
