"""Closed loops that several figures show."""

from __future__ import annotations

from typing import Any

import numpy as np

from steersman.config import resolve
from steersman.episode import Episode
from steersman.paths.base import PathComponent
from steersman.paths.basic import Straight
from steersman.plants.simulator import SimulatorConfig
from steersman.rollout import rollout
from steersman.sensing import WaypointSensor, track
from steersman.speed import ConstantSpeed, SpeedComponent
from steersman.types import Command, FloatArray, Pose
from steersman.vehicles import CarlaModel3

CAR = CarlaModel3()
ROAD = Straight(distance=1000.0)


def back_to_the_road(
    controller: Any, speed: float = 10.0, offset: float = 0.5, seconds: float = 4.0
) -> tuple[FloatArray, FloatArray]:
    """Time [s] and lateral error [m] of a car that starts beside a straight road."""
    driver: Any = resolve("controller", controller)
    pedals, sensor, rng = ConstantSpeed(speed=speed), WaypointSensor(), np.random.default_rng(0)
    plant = SimulatorConfig().make(CAR)
    plant.enter(ROAD)
    state = plant.reset(Pose(0.0, offset, 0.0), speed, 0.0)
    told, pushed = driver.init(CAR, plant.dt), pedals.init(ROAD, plant.dt, state)
    times, errors = [], []
    while state.time < seconds:
        place = track(state, ROAD, state.x)
        observation = sensor.observe(None, state, place, ROAD, rng)
        decision, told = driver.step(told, observation)
        throttle, brake, pushed = pedals.step(pushed, state, place.s)
        times.append(state.time)
        errors.append(place.lateral_error)
        state = plant.step(Command(decision.steer, throttle, brake))
    return np.array(times), np.array(errors)


def drive(
    controller: Any,
    path: PathComponent,
    speed: float | SpeedComponent = 10.0,
    *,
    seconds: float | None = None,
    delay: float = 0.0,
    sensor: WaypointSensor | None = None,
) -> Episode:
    """A run from the path's start."""
    driver: Any = resolve("controller", controller)
    source = speed if isinstance(speed, SpeedComponent) else ConstantSpeed(speed=speed)
    plant = SimulatorConfig(steering_delay=delay).make(CAR)
    return rollout(plant, driver, path, source, sensor or WaypointSensor(), duration=seconds)


def responses(title: str, variants: dict[str, Any], **options: Any) -> dict[str, Any]:
    """A figure of several controllers' ways back to the road."""
    lines = []
    for name, controller in variants.items():
        time, error = back_to_the_road(controller, **options)
        lines.append({"name": name, "x": time, "y": error})
    return {"title": title, "x": "time [s]", "y": "lateral error [m]", "lines": lines}
