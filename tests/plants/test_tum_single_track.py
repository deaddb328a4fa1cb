"""TUM-CONTROL's plant against its formulas, written down again here, at any control period."""

from __future__ import annotations

import math

import numpy as np
import pytest

from steersman.kernels import tum_single_track as kernel
from steersman.plants.tum_single_track import TumSingleTrack
from steersman.types import Command, FloatArray, Pose
from steersman.vehicles import VwT7

MASS, INERTIA, L_F, L_R = 2520.0, 13600.0, 1.484, 1.644
FRONT, REAR = (10.0, 1.3, 15591.427, 0.97), (10.0, 1.6, 24629.523, 0.97)
START = Pose(0.0, 0.0, 0.0)


def magic(b: float, c: float, d: float, e: float, a: float) -> float:
    return d * math.sin(c * math.atan(b * a - e * (b * a - math.atan(b * a))))


def formulas(q: FloatArray, delta: float, accel: float) -> FloatArray:
    """The time derivative as published, drive and brakes given as an acceleration."""
    _, _, psi, v, w, r = q.tolist()
    kmh = 3.6 * math.hypot(v, w)
    rolling = 0.009 + 0.002 * kmh / 100.0 + 0.0003 * (kmh / 100.0) ** 4
    z_f, z_r = (MASS * 9.81 * arm / (L_F + L_R) for arm in (L_R, L_F))
    x_f, x_r = -rolling * z_f, MASS * accel - rolling * z_r
    g_f, g_r = (
        min(max(x / math.hypot(z, tyre[1] * z), -0.98), 0.98)
        for x, z, tyre in ((x_f, z_f, FRONT), (x_r, z_r, REAR))
    )
    y_f = magic(*FRONT, delta - math.atan((w + L_F * r) / v)) * math.cos(math.asin(g_f))
    y_r = magic(*REAR, math.atan((L_R * r - w) / v)) * math.cos(math.asin(g_r))
    air = 0.5 * 1.225 * 2.9 * 0.35 * v * v
    c, s = math.cos(delta), math.sin(delta)
    return np.array([
        v * math.cos(psi) - w * math.sin(psi),
        v * math.sin(psi) + w * math.cos(psi),
        r,
        (x_r - air - y_f * s + x_f * c) / MASS + w * r,
        (y_r + y_f * c + x_f * s) / MASS - v * r,
        (L_F * (y_f * c + x_f * s) - L_R * y_r) / INERTIA,
    ])  # fmt: skip


def test_its_derivative_is_the_published_one() -> None:
    rng, car = np.random.default_rng(0), VwT7()
    tyres = TumSingleTrack().motion(car).tyres  # type: ignore[attr-defined]
    for _ in range(300):
        q = np.array([*rng.normal(0.0, 9.0, 3), rng.uniform(5.0, 40.0), *rng.normal(0.0, 0.7, 2)])
        steer, throttle, out = rng.uniform(-0.5, 0.5), rng.uniform(), np.zeros(6)
        kernel.derivative(car.table, 0, tyres, q, np.array([steer, throttle, 0.0]), out)
        expected = formulas(q, steer * 0.610865, 2.5 * throttle)
        # Peaks are 1.2 and 2.1 times the loads to 3e-6 of the published numbers.
        np.testing.assert_allclose(out, expected, rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize("dt", [0.013, 0.02, 0.05, 0.1])
def test_its_motion_does_not_depend_on_the_control_period(dt: float) -> None:
    """A step of steering, held: the same place after 1.3 s, to the integration's error."""

    def end(plant: TumSingleTrack, steps: int) -> FloatArray:
        made = plant.make(VwT7())
        made.reset(START, 20.0, 0.0)
        for _ in range(steps):
            state = made.step(Command(0.05, 0.3, 0.0))
        return np.array(state)[1:7]

    plant = TumSingleTrack(dt=dt)
    assert plant.h * plant.substeps() == pytest.approx(dt, rel=1e-12)
    assert plant.h <= 0.01
    fine = TumSingleTrack(dt=1.3, integration_step=1e-3)
    steps = round(1.3 / dt)
    expected = end(fine.model_copy(update={"dt": steps * dt}), 1)
    np.testing.assert_allclose(end(plant, steps), expected, rtol=0.0, atol=2e-3)
