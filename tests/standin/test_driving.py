"""Driving through the real client: the same commands give the embedded simulator's states."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from steersman.kernels import vehicle as kernel
from steersman.types import FloatArray
from steersman.vehicles import CarlaModel3, Vehicle

carla = pytest.importorskip("carla", reason="the wheel 'carla' is not installed")

OFFSET = 0.45
# Rounding of a float32 at a few hundred metres, and of degrees, with room for a sum of a few.
NEAR, TURNED = 1e-4, 2e-5


def spawn(world: Any, x: float = 10.0, y: float = 20.0, yaw: float = 0.0) -> Any:
    blueprint = world.get_blueprint_library().find("vehicle.tesla.model3")
    where = carla.Transform(carla.Location(x=x, y=y, z=0.5), carla.Rotation(yaw=yaw))
    return world.spawn_actor(blueprint, where)


def commands(n: int) -> FloatArray:
    """Steering, throttle and brake that stir up everything, as float32 carries them."""
    t = 0.05 * np.arange(n)
    steer = 0.3 * np.sin(1.3 * t) * np.minimum(t, 1.0)
    throttle = np.where(t % 7.0 < 5.0, 0.55 + 0.2 * np.sin(0.7 * t), 0.0)
    brake = np.where(t % 7.0 > 6.0, 0.3, 0.0)
    return np.stack([steer, throttle, brake], axis=1).astype(np.float32).astype(np.float64)


def embedded(
    vehicle: Vehicle, start: FloatArray, table: FloatArray, substeps: int = 5, dt: float = 0.05
) -> FloatArray:
    """States of the embedded simulator after each command, (n, N_STATE)."""
    state, work = start.copy(), np.zeros((3, kernel.N_MOTION))
    states = []
    for command in table:
        kernel.advance(vehicle.table, 0, state, command, dt / substeps, substeps, work)
        states.append(state.copy())
    return np.array(states)


def test_the_same_commands_give_the_same_states(world: Any) -> None:
    car = spawn(world, yaw=30.0)
    start = np.zeros(kernel.N_STATE)
    psi = -math.radians(30.0)
    start[[kernel.X, kernel.Y, kernel.PSI]] = (
        10.0 + OFFSET * math.cos(psi),
        -20.0 + OFFSET * math.sin(psi),
        psi,
    )
    table = commands(400)
    expected = embedded(CarlaModel3(), start, table)
    for (steer, throttle, brake), row in zip(table.tolist(), expected.tolist(), strict=True):
        car.apply_control(carla.VehicleControl(throttle=throttle, steer=-steer, brake=brake))
        frame = world.tick()
        snapshot = world.get_snapshot()
        assert snapshot.frame == frame
        seen = snapshot.find(car.id)
        x, y, psi, v_x, v_y, rate, _, _, _, _, _, a_x, a_y, _ = row
        c, s = math.cos(psi), math.sin(psi)
        at, turn = seen.get_transform().location, seen.get_transform().rotation
        assert at.x == pytest.approx(x - OFFSET * c, abs=NEAR)
        assert at.y == pytest.approx(-(y - OFFSET * s), abs=NEAR)
        assert (at.z, turn.pitch, turn.roll) == (0.0, 0.0, 0.0)
        assert math.remainder(math.radians(turn.yaw) + psi, math.tau) == pytest.approx(
            0.0, abs=TURNED
        )
        velocity, acceleration = seen.get_velocity(), seen.get_acceleration()
        assert velocity.x == pytest.approx(c * v_x - s * v_y, abs=NEAR)
        assert velocity.y == pytest.approx(-(s * v_x + c * v_y), abs=NEAR)
        assert acceleration.x == pytest.approx(c * a_x - s * a_y, abs=NEAR)
        assert acceleration.y == pytest.approx(-(s * a_x + c * a_y), abs=NEAR)
        assert math.radians(seen.get_angular_velocity().z) == pytest.approx(-rate, abs=NEAR)
    assert abs(expected[-1, kernel.PSI]) > 0.5
    assert np.hypot(*expected[-1, :2]) > 50.0
