"""Figures of the vehicle: tyres, actuators, pedals, steady turns, a step of the steering."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from steersman.controllers.single_track import (
    single_track,
    steady_side_slip,
    steady_wheel_angle,
    zero_order_hold,
)
from steersman.kernels import vehicle as kernel
from steersman.kernels.actuator import slew_lagged
from steersman.kernels.steady_turn import steady_turn
from steersman.kernels.tyre import axle_tyres, side_force, tyre_stiffness
from steersman.plants.simulator import SimulatorConfig
from steersman.types import Command, FloatArray, Pose
from steersman.vehicles import Bmw320i, CarlaModel3, Vehicle

RADIUS = 50.0


def tyre_force() -> dict[str, Any]:
    """Fiala's cubic at three loads, and with a braked wheel."""
    car = CarlaModel3()
    static = car.mass * kernel.GRAVITY * car.l_r / car.wheelbase / 2.0
    angles = np.linspace(0.0, 35.0, 141)
    lines = []
    for name, load, share in (
        ("half the static load", 0.5, 0.0),
        ("static load of a front wheel", 1.0, 0.0),
        ("twice the static load", 2.0, 0.0),
        ("static load, 80 % of the grip spent on braking", 1.0, 0.8),
    ):
        limit = car.stiffness_load_limit or 0.0
        tyres = axle_tyres(car.c_f / 2.0 / static, static, limit)
        stiffness = tyre_stiffness(tyres, load * static)
        grip = car.friction * static * load
        left = grip * math.sqrt(1.0 - share**2)
        forces = [-side_force(stiffness, math.tan(math.radians(a)), left) for a in angles]
        lines.append({"name": name, "x": angles, "y": np.array(forces) / 1e3})
    title = f"Fiala's tyre, CARLA Model 3, friction {car.friction:g}"
    return {"title": title, "x": "slip angle [deg]", "y": "|side force| [kN]", "lines": lines}


def actuator() -> dict[str, Any]:
    """A command that reverses, and where the steering is."""
    car = CarlaModel3()
    times = np.arange(0.0, 1.6, 0.01)
    commands = np.where(times < 0.6, 0.5, -0.5)
    commands[times < 0.1] = 0.0
    lines: list[dict[str, Any]] = []
    for name, lag in (("position", 0.0), ("position with a lag of 0.1 s", 0.1)):
        position, positions = 0.0, []
        for command in commands:
            positions.append(position)
            position = slew_lagged(
                position, command, car.steer_rate_up, car.steer_rate_down, lag, 0.01
            )
        lines.append({"name": name, "x": times, "y": positions})
    lines.append({"name": "command", "x": times, "y": commands})
    title = "Steering: 2.5 /s away from the centre, 5 /s towards it"
    return {"title": title, "x": "time [s]", "y": "normalised steering [-]", "lines": lines}


def steering_curve() -> dict[str, Any]:
    """Wheel angles over the command at three speeds."""
    table = CarlaModel3().table
    steers = np.linspace(-1.0, 1.0, 81)
    lines = []
    for name, speed, wheel in (
        ("left wheel, standstill", 0.0, 0),
        ("right wheel, standstill", 0.0, 1),
        ("single track, standstill", 0.0, 2),
        ("single track, 33 m/s", 33.0, 2),
    ):
        angles = [math.atan(kernel.wheel_tangents(table, 0, u, speed)[wheel]) for u in steers]
        lines.append({"name": name, "x": steers, "y": np.degrees(angles)})
    title = "Steering law of CARLA's Model 3"
    return {"title": title, "x": "normalised steering [-]", "y": "angle [deg]", "lines": lines}


def throttle_map() -> dict[str, Any]:
    """Net acceleration on a straight."""
    table = CarlaModel3().table
    speeds = np.linspace(0.0, 38.7, 100)
    lines = []
    for throttle in (1.0, 0.8, 0.6, 0.5, 0.4, 0.0):
        values = [kernel.map_acceleration(table, throttle, v) for v in speeds]
        lines.append({"name": f"throttle {throttle}", "x": speeds, "y": values})
    title = "Net acceleration on a straight"
    return {"title": title, "x": "speed [m/s]", "y": "acceleration [m/s^2]", "lines": lines}


def steady_turns() -> dict[str, Any]:
    """Side-slip of the steady turn by three models."""
    lines: list[dict[str, Any]] = []
    for name, car, fastest in (("Model 3", CarlaModel3(), 26.0), ("BMW 320i", Bmw320i(), 20.0)):
        speeds = np.linspace(1.0, fastest, 51)
        linear = [math.degrees(steady_side_slip(car, v, 1.0 / RADIUS)) for v in speeds]
        full = [_four_wheel(car, v) for v in speeds]
        lines.append({"name": f"{name}, four wheels", "x": speeds, "y": full})
        lines.append({"name": f"{name}, linear single track", "x": speeds, "y": linear})
    kinematic = math.degrees(math.atan(CarlaModel3().l_r / RADIUS))
    lines.append({"name": "Model 3, kinematic", "x": [1.0, 26.0], "y": [kinematic] * 2})
    title = "Side-slip on the circle of 50 m"
    return {"title": title, "x": "speed [m/s]", "y": "side-slip [deg]", "lines": lines}


def _four_wheel(car: Vehicle, speed: float) -> float:
    """Side-slip [deg] by the simulator's own equations; NaN where there is no steady turn."""
    state = np.zeros(kernel.N_STATE)
    if not steady_turn(car.table, 0, state, speed, 1.0 / RADIUS):
        return math.nan
    return math.degrees(math.atan2(state[kernel.VY], state[kernel.VX]))


def understeer() -> dict[str, Any]:
    """Wheel angle of the steady turn."""
    lines: list[dict[str, Any]] = []
    for name, car, fastest in (("Model 3", CarlaModel3(), 26.0), ("BMW 320i", Bmw320i(), 20.0)):
        speeds = np.linspace(1.0, fastest, 51)
        linear = [math.degrees(steady_wheel_angle(car, v, 1.0 / RADIUS)) for v in speeds]
        angles = []
        for v in speeds:
            state = np.zeros(kernel.N_STATE)
            found = steady_turn(car.table, 0, state, v, 1.0 / RADIUS)
            angles.append(math.degrees(state[kernel.WHEEL]) if found else math.nan)
        lines.append({"name": f"{name}, four wheels", "x": speeds, "y": angles})
        lines.append({"name": f"{name}, linear single track", "x": speeds, "y": linear})
    title = "Wheel angle on the circle of 50 m"
    return {"title": title, "x": "speed [m/s]", "y": "wheel angle [deg]", "lines": lines}


def steering_step() -> dict[str, Any]:
    """Yaw rate after a step of the steering: simulator and linear model."""
    car = CarlaModel3()
    lines = []
    for speed in (8.0, 20.0):
        simulated, wheel = _simulated_step(car, speed)
        times = np.arange(len(simulated)) * 0.01
        linear = _linear_step(car, speed, wheel)
        lines.append({"name": f"simulator, {speed:.0f} m/s", "x": times, "y": simulated})
        lines.append({"name": f"linear model, {speed:.0f} m/s", "x": times, "y": linear})
    title = "Yaw rate after a step of the steering to 0.02"
    return {"title": title, "x": "time [s]", "y": "yaw rate [rad/s]", "lines": lines}


def _simulated_step(car: Vehicle, speed: float) -> tuple[FloatArray, FloatArray]:
    plant = SimulatorConfig(dt=0.01).make(car)
    state = plant.reset(Pose(0.0, 0.0, 0.0), speed, 0.0)
    throttle, rates, wheel = state.throttle, [], []
    for _ in range(120):
        rates.append(state.yaw_rate)
        state = plant.step(Command(0.02, throttle, 0.0))
        wheel.append(state.wheel_angle)
    return np.array(rates), np.array(wheel)


def _linear_step(car: Vehicle, speed: float, wheel: FloatArray) -> FloatArray:
    a, b = zero_order_hold(*single_track(car, speed), 0.01)
    x, rates = np.zeros(4), []
    for angle in wheel:
        rates.append(x[3])
        x = a @ x + b[:, 0] * angle
    return np.array(rates)


FIGURES = {
    "tyre_force": tyre_force,
    "actuator": actuator,
    "steering_curve": steering_curve,
    "throttle_map": throttle_map,
    "steady_turns": steady_turns,
    "understeer": understeer,
    "steering_step": steering_step,
}
