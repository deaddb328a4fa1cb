"""Prediction through the delay against the simulator, and the search for the delay."""

from __future__ import annotations

import math

import numpy as np
import pytest

from steersman.kernels import mpc_delay as kernel
from steersman.kernels.grip import NO_LIMIT
from steersman.kernels.vehicle import wheel_tangents
from steersman.plants.simulator import SimulatorConfig
from steersman.types import Command, Pose
from steersman.vehicles import CarlaModel3V1

CAR = CarlaModel3V1()
TABLE = CAR.table
DT, SPACING = 0.05, 2.0
STRAIGHT = np.stack([SPACING * np.arange(15), np.zeros(15)], axis=1)
NONE = np.zeros(2)


def through(delay: float, commands: list[float], motion: list[float], v: float) -> np.ndarray:
    out = np.array(motion)
    work = np.empty((2, kernel.N_MOTION))
    kernel.through_delay(
        TABLE, v, STRAIGHT, SPACING, 0.0, NONE, NO_LIMIT, np.array(commands), delay, DT, out, work
    )
    return out


@pytest.mark.parametrize("delay", [0.03, 0.1, 0.13, 0.2])
def test_motion_during_the_delay_is_the_simulators(delay: float) -> None:
    """Commands that were given act in their order, each for a period, and only then."""
    v, commands = 12.0, [0.02, -0.01, 0.015, 0.03, -0.02, 0.01]  # newest first
    plant = SimulatorConfig(steering_delay=delay).make(CAR)
    plant.reset(Pose(0.0, 0.0, 0.0), v, 0.0)
    for command in reversed(commands):
        now = plant.step(Command(command, 0.3, 0.0))
    ahead = plant
    start = [now.y, now.psi, now.v_y, now.yaw_rate, now.steer, 0.0]
    speed = now.v_x
    found = through(delay, commands, start, speed)
    # The simulator goes on under commands that cannot act before the delay is over.
    whole, part = divmod(round(delay / 0.01), 5)
    fine = SimulatorConfig(dt=0.01, steering_delay=0.0).make(CAR)
    fine._state[:] = ahead._state
    acting = [commands[whole]] * part + [c for c in reversed(commands[:whole]) for _ in range(5)]
    for command in acting:
        now = fine.step(Command(command, 0.3, 0.0))
    expected = [now.y, now.psi, now.v_y, now.yaw_rate, now.steer]
    assert found[:5] == pytest.approx(expected, rel=0.03, abs=2e-4)
    assert found[kernel.STEER] == pytest.approx(now.steer, abs=1e-12)
    assert found[kernel.WAY] == pytest.approx(speed * delay, rel=0.01)


def test_errors_follow_the_road() -> None:
    """On a bend a car that goes straight leaves it by v^2 t^2 kappa / 2."""
    kappa, v, t = 0.01, 10.0, 0.2
    bend = np.stack([np.sin(kappa * STRAIGHT[:, 0]), 1.0 - np.cos(kappa * STRAIGHT[:, 0])], axis=1)
    motion, work = np.zeros(kernel.N_MOTION), np.empty((2, kernel.N_MOTION))
    kernel.through_delay(
        TABLE, v, bend / kappa, SPACING, kappa, NONE, NO_LIMIT, np.zeros(6), t, DT, motion, work
    )
    assert motion[kernel.E1] == pytest.approx(-0.5 * kappa * (v * t) ** 2, rel=0.01)
    assert motion[kernel.E2] == pytest.approx(-kappa * v * t, rel=0.01)


def test_disturbances_accelerate() -> None:
    motion, work = np.zeros(kernel.N_MOTION), np.empty((2, kernel.N_MOTION))
    kernel.hold(
        TABLE,
        20.0,
        STRAIGHT,
        SPACING,
        0.0,
        np.array([0.3, 0.1]),
        NO_LIMIT,
        0.0,
        0.005,
        motion,
        work,
    )
    assert motion[[kernel.VY, kernel.RATE]] == pytest.approx([0.0015, 0.0005], rel=0.05)


@pytest.mark.parametrize("delay", [0.0, 0.01, 0.05, 0.13, 0.3])
def test_the_delay_that_was_is_found(delay: float) -> None:
    plant, rng = SimulatorConfig(steering_delay=delay).make(CAR), np.random.default_rng(0)
    before = plant.reset(Pose(0.0, 0.0, 0.0), 10.0, 0.0).steer
    commands, scores, steer, best = np.zeros(12), np.zeros(51), 0.0, 0
    for _ in range(30):
        steer += rng.normal(0.0, 0.1)
        commands = np.concatenate([[steer], commands[:-1]])
        now = plant.step(Command(steer, 0.3, 0.0)).steer
        best = kernel.score_delays(TABLE.rows[0], commands, DT, 0.01, before, now, 0.97, scores)
        before = now
    assert best == round(delay / 0.01)
    assert scores[best] < 1e-20


def test_clip_keeps_both_limits() -> None:
    rng = np.random.default_rng(1)
    plan, steady = rng.normal(0.0, 0.3, 20), rng.normal(0.0, 0.1, 20)
    assert not kernel.within(plan, steady, 0.05, 0.2, 0.07)
    kernel.clip(plan, steady, 0.05, 0.2, 0.07)
    angles = np.concatenate([[0.05], plan + steady])
    assert abs(angles).max() <= 0.2 + 1e-12
    assert abs(np.diff(angles)).max() <= 0.07 + 1e-12
    assert kernel.within(plan, steady, 0.05, 0.2 + 1e-9, 0.07 + 1e-9)


def test_wheel_angle_is_the_vehicles() -> None:
    for steer in (-0.8, 0.0, 0.3):
        expected = math.atan(wheel_tangents(TABLE, 0, steer, 9.0)[2])
        assert kernel.wheel_angle(TABLE, steer, 9.0) == expected


def test_compiled_equals_python() -> None:
    rng = np.random.default_rng(2)
    commands = rng.normal(0.0, 0.05, 8)
    motions = []
    for function in (kernel.through_delay, kernel.through_delay.py_func):
        motion = np.array([0.1, 0.02, 0.1, -0.05, 0.01, 0.0])
        function(
            TABLE, 9.0, STRAIGHT, SPACING, 0.01, NONE, NO_LIMIT, commands, 0.12, DT, motion,
            np.empty((2, kernel.N_MOTION)),
        )  # fmt: skip
        motions.append(motion)
    assert motions[0] == pytest.approx(motions[1], abs=1e-12)
    a, b, gain, ahead = (
        rng.normal(0.0, 0.3, (4, 4)),
        *rng.normal(0.0, 0.3, (2, 5)),
        rng.normal(0.0, 0.3, 6),
    )
    plans = []
    for function in (kernel.free_plan, kernel.free_plan.py_func):
        plan = np.empty(6)
        function(
            a, b[:4], 0.3, gain, ahead, np.arange(7.0) ** 2, np.ones(4), 0.1, plan,
            np.empty((2, 4)),
        )  # fmt: skip
        plans.append(plan)
    assert plans[0] == pytest.approx(plans[1], abs=1e-10)
