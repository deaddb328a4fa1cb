"""Speed kernels: targets from profile and cap, and the split into throttle and brake."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from steersman.config import build, lookup
from steersman.kernels import speed as kernel
from steersman.paths.segments import stack
from steersman.profiles import Profile, stack_profiles
from steersman.speed import ConstantThrottle, Nedc

CIRCLE = build(lookup("path", "circle"), {"radius": 50.0})
CIRCUIT = build(lookup("path", "training_circuit"), {})
BANK = [CIRCUIT, CIRCLE]
FULL = Nedc(a_lat_max=4.0).profile()
PLAIN = Nedc().profile()

time = st.floats(0.0, 1200.0)
place = st.floats(-5.0, 1600.0)


@given(time, place)
def test_target_equals_python_and_respects_the_cap(now: float, s: float) -> None:
    table = stack_profiles([FULL], [CIRCUIT])
    found = kernel.target_speed(table, 0, CIRCUIT.table, 0, now, s)
    assert found == kernel.target_speed.py_func(table, 0, CIRCUIT.table, 0, now, s)
    profile = float(np.interp(now, FULL.times, FULL.speeds))
    limits = np.interp(s, np.arange(len(table.cap)), table.cap)
    assert found == pytest.approx(min(profile, limits), abs=1e-9)


@given(time, place)
def test_without_a_cap_the_road_does_not_matter(now: float, s: float) -> None:
    table = stack_profiles([PLAIN], [CIRCUIT])
    found = kernel.target_speed(table, 0, CIRCUIT.table, 0, now, s)
    assert found == pytest.approx(float(np.interp(now, PLAIN.times, PLAIN.speeds)), abs=1e-9)


def test_each_road_has_its_own_cap() -> None:
    profile = Profile(None, np.zeros(1), np.array([100.0]), 4.5, 2.0)
    both = stack_profiles([profile, profile], BANK)
    alone = stack_profiles([profile], [CIRCLE])
    bank = stack(path.table for path in BANK)
    for s in (0.0, 100.0, 313.0):
        found = kernel.target_speed(both, 1, bank, 1, 0.0, s)
        assert found == kernel.target_speed(alone, 0, CIRCLE.table, 0, 0.0, s)
        assert found == pytest.approx(15.0)  # sqrt(4.5 x 50)


@given(st.floats(0.0, 40.0), st.floats(0.0, 40.0), st.floats(-1.0, 1.0), st.floats(0.0, 2.0))
def test_never_throttle_and_brake_together(
    wanted: float, v: float, integral: float, k_i: float
) -> None:
    profile = Profile(None, np.zeros(1), np.array([wanted]), None, 2.0, 0.5, k_i)
    table = stack_profiles([profile], [CIRCLE])
    args = (table, 0, CIRCLE.table, 0, 3.0, 0.0, v, integral, 0.05)
    throttle, brake, kept = kernel.pedals(*args)
    assert (throttle, brake, kept) == kernel.pedals.py_func(*args)
    assert 0.0 <= throttle <= 1.0
    assert 0.0 <= brake <= 1.0
    assert throttle * brake == 0.0
    assert -1.0 <= kept <= 1.0


def test_integral_stops_at_the_pedals_and_comes_back() -> None:
    profile = Profile(None, np.zeros(1), np.array([30.0]), None, 2.0, 0.5, 0.3)
    table, integral = stack_profiles([profile], [CIRCLE]), 0.2
    for _ in range(200):
        throttle, _, integral = kernel.pedals(
            table, 0, CIRCLE.table, 0, 0.0, 0.0, 5.0, integral, 0.05
        )
        assert throttle == 1.0
    assert integral == 0.2  # the pedal was at its end from the first step
    *_, after = kernel.pedals(table, 0, CIRCLE.table, 0, 0.0, 0.0, 31.0, integral, 0.05)
    assert after == pytest.approx(0.2 - 0.3 * 0.05)


def test_constant_throttle() -> None:
    table = stack_profiles([ConstantThrottle(throttle=0.7).profile()], [CIRCLE])
    args = (table, 0, CIRCLE.table, 0, 3.0, 0.0, 12.0, 0.5, 0.05)
    assert kernel.pedals(*args) == kernel.pedals.py_func(*args) == (0.7, 0.0, 0.5)
