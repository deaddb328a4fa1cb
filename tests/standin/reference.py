"""The embedded simulator's states, for comparison with what the client sees."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from steersman.kernels import vehicle as kernel
from steersman.types import FloatArray
from steersman.vehicles import Vehicle

# Centre of mass of the Model 3 ahead of its origin [m].
OFFSET = 0.45
# Rounding of a float32 at a few hundred metres [m], and of degrees [rad].
NEAR, TURNED = 1e-4, 2e-5


def commands(n: int) -> FloatArray:
    """Steering, throttle and brake that stir up everything, as float32 carries them."""
    t = 0.05 * np.arange(n)
    steer = 0.3 * np.sin(1.3 * t) * np.minimum(t, 1.0)
    throttle = np.where(t % 7.0 < 5.0, 0.55 + 0.2 * np.sin(0.7 * t), 0.0)
    brake = np.where(t % 7.0 > 6.0, 0.3, 0.0)
    return np.stack([steer, throttle, brake], axis=1).astype(np.float32).astype(np.float64)


def start(x: float, y: float, yaw: float, offset: float = OFFSET) -> FloatArray:
    """State row of a car at rest whose origin is there, in CARLA's axes."""
    state, psi = np.zeros(kernel.N_STATE), -math.radians(yaw)
    state[[kernel.X, kernel.Y, kernel.PSI]] = (
        x + offset * math.cos(psi),
        -y + offset * math.sin(psi),
        psi,
    )
    return state


def embedded(
    vehicle: Vehicle, state: FloatArray, table: FloatArray, substeps: int, dt: float
) -> FloatArray:
    """States of the embedded simulator after each command, (n, N_STATE)."""
    work, states = np.zeros((3, kernel.N_MOTION)), []
    for command in table:
        kernel.advance(vehicle.table, 0, state, command, dt / substeps, substeps, work)
        states.append(state.copy())
    return np.array(states)


def drive(world: Any, car: Any, table: FloatArray) -> list[Any]:
    """Snapshots of the car after each command."""
    import carla

    seen = []
    for steer, throttle, brake in table.tolist():
        car.apply_control(carla.VehicleControl(throttle=throttle, steer=-steer, brake=brake))
        frame = world.tick()
        snapshot = world.get_snapshot()
        assert snapshot.frame == frame
        seen.append(snapshot.find(car.id))
    return seen


def assert_same(seen: list[Any], states: FloatArray, offset: float = OFFSET) -> None:
    """All that a snapshot says of a vehicle agrees with the simulator's states."""
    for actor, row in zip(seen, states.tolist(), strict=True):
        x, y, psi, v_x, v_y, rate, _, _, _, _, _, a_x, a_y, _ = row
        c, s = math.cos(psi), math.sin(psi)
        where, turn = actor.get_transform().location, actor.get_transform().rotation
        v, a = actor.get_velocity(), actor.get_acceleration()
        assert (where.x, where.y) == pytest.approx((x - offset * c, offset * s - y), abs=NEAR)
        assert (where.z, turn.pitch, turn.roll, v.z, a.z) == (0.0,) * 5
        assert abs(math.remainder(math.radians(turn.yaw) + psi, math.tau)) < TURNED
        assert (v.x, v.y) == pytest.approx((c * v_x - s * v_y, -s * v_x - c * v_y), abs=NEAR)
        assert (a.x, a.y) == pytest.approx((c * a_x - s * a_y, -s * a_x - c * a_y), abs=NEAR)
        assert math.radians(actor.get_angular_velocity().z) == pytest.approx(-rate, abs=NEAR)
