"""Recordings of known cars in the simulator: a drive by hand, and noise as sensors have it.

Identification is judged by comparing the figures it finds with the true ones.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from steersman.plants.simulator import SimulatorConfig
from steersman.studies.identify.recording import Log
from steersman.types import Command, Pose
from steersman.vehicles import Vehicle

# Standard deviations of the noise: a wheel speed, a gyroscope, an accelerometer on a car [SI].
NOISE = {"v_x": 0.05, "yaw_rate": 0.005, "a_y": 0.1, "v_y": 0.03}
RECORDED = ("steer_command", "throttle", "brake", "v_x", "yaw_rate", "a_y")
_DT = 0.05
# Steps of the steering and of the throttle last so many rows.
_STEERING, _THROTTLE = 20, 30
# Slower than this the throttle opens; steering aims at its acceleration at no less than that [m/s].
_SLOW, _QUICK = 4.0, 8.0
_BRAKE, _MOST_STEER = 0.3, 0.4


def recording(
    car: Vehicle,
    seconds: float,
    seed: int = 0,
    *,
    noise: float = 1.0,
    acceleration: float = 3.5,
    top: float = 20.0,
    throttles: tuple[float, ...] = (0.0, 0.4, 0.5, 0.6, 0.8),
    keep: tuple[str, ...] = RECORDED,
) -> Log:
    """Steps of the steering each second, of the throttle each 1.5 s; braking at the top speed.

    Args:
        car: the true vehicle.
        seconds: length.
        seed: of the steps and of the noise, which are drawn apart.
        noise: factor on ``NOISE``.
        acceleration: largest lateral acceleration that the steering aims at [m/s^2].
        top: speed from which it brakes [m/s].
        throttles: positions from which each step is drawn.
        keep: signals that are recorded.
    """
    rng = np.random.default_rng(seed)
    plant = SimulatorConfig(dt=_DT).make(car)
    state = plant.reset(Pose(0.0, 0.0, 0.0), 8.0, 0.0)
    rows, steer, throttle, brake = [], 0.0, 0.4, 0.0
    for k in range(round(seconds / _DT)):
        if k % _THROTTLE == 0:
            throttle, brake = float(rng.choice(throttles)), 0.0
            if state.v_x > top:
                throttle, brake = 0.0, _BRAKE
        if state.v_x < _SLOW:
            throttle, brake = 0.6, 0.0
        if k % _STEERING == 0:
            wanted = rng.uniform(-acceleration, acceleration)
            angle = math.atan(car.wheelbase * wanted / max(state.v_x, _QUICK) ** 2)
            limit = _MOST_STEER * min(1.0, _QUICK / max(state.v_x, 1.0))
            steer = float(np.clip(car.steer_for_wheel_angle(angle, state.v_x), -limit, limit))
        rows.append((state, steer, throttle, brake))
        state = plant.step(Command(steer, throttle, brake))
    own: dict[str, Any] = {
        "steer_command": np.array([row[1] for row in rows]),
        "throttle": np.array([row[2] for row in rows]),
        "brake": np.array([row[3] for row in rows]),
    }
    for name in ("v_x", "v_y", "yaw_rate", "a_x", "a_y", "wheel_angle", "steer"):
        own[name] = np.array([getattr(row[0], name) for row in rows])
    times = np.array([row[0].time for row in rows])
    clean = Log("recording", times, {name: own[name] for name in keep})
    return noisy(clean, 1000 + seed, noise)


def noisy(log: Log, seed: int, factor: float = 1.0) -> Log:
    """The recording with white noise on what sensors measure."""
    rng = np.random.default_rng(seed)
    signals = {
        name: values + factor * NOISE.get(name, 0.0) * rng.standard_normal(len(values))
        for name, values in log.signals.items()
    }
    return log._replace(signals=signals)
