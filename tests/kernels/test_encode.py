"""The encoding kernels: what is remembered, in which order, and how far."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from steersman.encoding import EncodingComponent, ExtendedEncoding, WaypointEncoding
from steersman.kernels import encode as kernel
from steersman.kernels import observe
from steersman.kernels.encode import EncodingTable
from steersman.types import FloatArray

WAYPOINTS = 15


def table_of(encoding: EncodingComponent, action: str = "rate") -> EncodingTable:
    return encoding.layout(2.0, 0.05, action).table


HISTORY = table_of(ExtendedEncoding(waypoints=0, roads=0, history=3))
RESIDUAL = table_of(ExtendedEncoding(waypoints=0, roads=0, history=3), "residual")
# The first feature that remembers something is the integral.
INTEGRAL = kernel.CELLS


def row(d: float = 0.0, steer: float = 0.0, heading: float = 0.0, kappa: float = 0.0) -> FloatArray:
    """An observation of a road of constant curvature, from a car beside it (small angles)."""
    out = np.zeros(observe.O_PREVIEW + 2 * WAYPOINTS)
    out[observe.O_D], out[observe.O_HEADING], out[observe.O_KAPPA] = d, heading, kappa
    out[observe.O_VX], out[observe.O_VY], out[observe.O_RATE] = 12.0, -0.2, 0.1
    out[observe.O_STEER] = steer
    u = 2.0 * np.arange(WAYPOINTS)
    out[observe.O_PREVIEW :: 2] = u
    out[observe.O_PREVIEW + 1 :: 2] = -d - heading * u + 0.5 * kappa * u * u
    return out


def features(table: EncodingTable, seen: FloatArray, memory: FloatArray) -> FloatArray:
    out = np.zeros(kernel.feature_count(table))
    kernel.encode(table, seen, memory, out)
    return out


@pytest.mark.parametrize(
    "table",
    [
        table_of(WaypointEncoding()),
        table_of(ExtendedEncoding(waypoints=3, history=4), "direct"),
        table_of(ExtendedEncoding(errors=False, integral=False, command=False)),
    ],
)
@given(st.lists(st.tuples(st.floats(-1.0, 1.0), st.floats(-1.0, 1.0)), min_size=1, max_size=8))
def test_compiled_equals_python(table: EncodingTable, steps: list[tuple[float, float]]) -> None:
    memory = np.zeros((2, kernel.memory_size(table)))
    outs = np.zeros((2, kernel.feature_count(table)))
    scale = np.linspace(0.5, 300.0, outs.shape[1])
    runs = (
        (kernel.encode, kernel.remember, kernel.normalise),
        (kernel.encode.py_func, kernel.remember.py_func, kernel.normalise.py_func),
    )
    for d, command in steps:
        for i, (encode, remember, normalise) in enumerate(runs):
            encode(table, row(d, 0.1, 0.3 * command, 0.02), memory[i], outs[i])
            remember(table, row(d), memory[i], command)
            normalise(outs[i], scale)
        np.testing.assert_allclose(outs[0], outs[1], rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(memory[0], memory[1], rtol=1e-12, atol=1e-12)
        assert np.abs(outs).max() <= kernel.FEATURE_LIMIT


@given(st.floats(-1.0, 1.0), st.floats(-1.0, 1.0))
def test_the_bases_command_is_told_relative_to_the_last(base: float, last: float) -> None:
    table = RESIDUAL
    memory = np.zeros(kernel.memory_size(table))
    plain = features(HISTORY, row(0.2), memory)
    kernel.remember(table, row(0.2), memory, last)
    out, again = features(table, row(0.2), memory), features(table, row(0.2), memory)
    assert len(out) == len(plain) + 1
    assert out[-1] == 0.0
    kernel.tell_base(table, row(0.2), memory, base, out)
    kernel.tell_base.py_func(table, row(0.2), memory, base, again)
    assert out[-1] == again[-1] == base - last
    assert out[-2] == features(HISTORY, row(0.2), memory)[-1]


def test_waypoints_and_state_come_first() -> None:
    table = table_of(WaypointEncoding(waypoints=4))
    seen = row(0.3, steer=0.2)
    out = features(table, seen, np.zeros(kernel.memory_size(table)))
    assert out[:8] == pytest.approx(seen[observe.O_PREVIEW :][:8])
    assert out[8:] == pytest.approx([12.0, -0.2, 0.1, 0.2])


@given(st.floats(-0.05, 0.05), st.floats(-1.0, 1.0), st.floats(-0.1, 0.1))
def test_road_curvatures_hold_nothing_of_the_cars_error(
    kappa: float, d: float, heading: float
) -> None:
    table = table_of(ExtendedEncoding(roads=7))
    out = features(table, row(d, 0.0, heading, kappa), np.zeros(kernel.memory_size(table)))
    assert out[:7] == pytest.approx(np.full(7, kappa), abs=1e-12)


def test_fine_errors() -> None:
    table = table_of(ExtendedEncoding(roads=0, fine_error=0.05, fine_heading=0.02))
    memory = np.zeros(kernel.memory_size(table))
    out = features(table, row(d=-0.05, heading=0.02), memory)
    assert out[4:8] == pytest.approx([-0.05, 0.02, -0.5, 0.5])


def test_history_is_newest_first() -> None:
    memory = np.zeros(kernel.memory_size(HISTORY))
    # Before the first step there is no past: the present stands for it.
    first = features(HISTORY, row(d=0.4, steer=0.2), memory)
    assert first[-7:] == pytest.approx([0.2, 0.4, 0.4, 0.4, 0.2, 0.2, 0.2])
    commands = [0.1, 0.3, -0.2, 0.5]
    for k, command in enumerate(commands):
        kernel.remember(HISTORY, row(d=0.01 * k), memory, command)
        out = features(HISTORY, row(d=0.01 * (k + 1)), memory)
    # last_command, then errors one, two, three steps ago, then the commands before the last.
    assert out[-7:] == pytest.approx([0.5, 0.03, 0.02, 0.01, -0.2, 0.3, 0.1])
    assert out[4] == pytest.approx(0.04)


@given(st.floats(-2.0, 2.0))
def test_integral_is_bounded(d: float) -> None:
    memory = np.zeros(kernel.memory_size(HISTORY))
    total = 0.0
    features(HISTORY, row(d), memory)
    assert memory[INTEGRAL] == 0.0
    for _ in range(200):
        features(HISTORY, row(d), memory)
        total = min(max(total + 0.05 * np.clip(d, -0.5, 0.5), -0.25), 0.25)
        assert memory[INTEGRAL] == pytest.approx(total)
    # It comes back at once when the error changes sign.
    before = abs(memory[INTEGRAL])
    features(HISTORY, row(-d), memory)
    assert abs(memory[INTEGRAL]) <= before


def test_a_cleared_memory_starts_anew() -> None:
    memory = np.zeros(kernel.memory_size(HISTORY))
    for _ in range(5):
        features(HISTORY, row(0.5), memory)
        kernel.remember(HISTORY, row(0.5), memory, 0.9)
    memory[:] = 0.0
    fresh = features(HISTORY, row(0.1, steer=0.3), memory)
    assert fresh[-7:] == pytest.approx([0.3, 0.1, 0.1, 0.1, 0.3, 0.3, 0.3])
    assert memory[INTEGRAL] == 0.0
