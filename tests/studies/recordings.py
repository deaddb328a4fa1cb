"""Recordings of known cars: steps of steering and throttle, with the noise of real sensors."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from steersman.plants.simulator import SimulatorConfig
from steersman.studies.identify.log import Log
from steersman.types import Command, Pose
from steersman.vehicles import Vehicle

NOISE = {"v_x": 0.05, "yaw_rate": 0.005, "a_y": 0.1, "v_y": 0.03}
DT = 0.05


def recording(
    car: Vehicle,
    seconds: float,
    seed: int = 0,
    *,
    noise: float = 1.0,
    acceleration: float = 3.5,
    top: float = 20.0,
    throttles: tuple[float, ...] = (0.0, 0.4, 0.5, 0.6, 0.8),
    keep: tuple[str, ...] = ("steer_command", "throttle", "brake", "v_x", "yaw_rate", "a_y"),
) -> Log:
    """Steps of the steering each second, of the throttle each 1.5 s; braking now and then."""
    rng = np.random.default_rng(seed)
    plant = SimulatorConfig(dt=DT).make(car)
    state = plant.reset(Pose(0.0, 0.0, 0.0), 8.0, 0.0)
    rows, steer, throttle, brake = [], 0.0, 0.4, 0.0
    for k in range(round(seconds / DT)):
        if k % 30 == 0:
            throttle, brake = float(rng.choice(throttles)), 0.0
            if state.v_x > top:
                throttle, brake = 0.0, 0.3
        if state.v_x < 4.0:
            throttle, brake = 0.6, 0.0
        if k % 20 == 0:
            wanted = rng.uniform(-acceleration, acceleration)
            angle = math.atan(car.wheelbase * wanted / max(state.v_x, 8.0) ** 2)
            limit = 0.4 * min(1.0, 8.0 / max(state.v_x, 1.0))
            steer = float(np.clip(car.steer_for_wheel_angle(angle, state.v_x), -limit, limit))
        rows.append((state, steer, throttle, brake))
        state = plant.step(Command(steer, throttle, brake))
    own: dict[str, Any] = {
        "steer_command": np.array([row[1] for row in rows]),
        "throttle": np.array([row[2] for row in rows]),
        "brake": np.array([row[3] for row in rows]),
    }
    draw = np.random.default_rng(1000 + seed)
    for name in ("v_x", "v_y", "yaw_rate", "a_x", "a_y", "wheel_angle", "steer"):
        clean = np.array([getattr(row[0], name) for row in rows])
        own[name] = clean + noise * NOISE.get(name, 0.0) * draw.standard_normal(len(rows))
    times = np.array([row[0].time for row in rows])
    return Log("recording", times, {name: own[name] for name in keep})
