"""What grip leaves to pedals, by axle."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from steersman.kernels.bend_speed import for_pedals, pedal_shares
from steersman.kernels.grip_demand import axle_share
from steersman.kernels.vehicle import GRAVITY, MASS, ROLL_ARM
from steersman.vehicles import CarlaModel3
from steersman.vehicles.base import Vehicle

SHARES = st.floats(0.0, 1.0)
LENGTHS = st.floats(0.8, 2.5)


def car(l_f: float, l_r: float, drive: float, brake: float) -> Vehicle:
    words = {"l_f": l_f, "l_r": l_r, "drive_front": drive, "brake_front": brake}
    return CarlaModel3().model_copy(update=words)


@given(LENGTHS, LENGTHS, SHARES, SHARES, st.floats(0.05, 1.2))
def test_pedals_alone_bring_one_axle_to_its_grip_and_none_beyond(
    l_f: float, l_r: float, drive: float, brake: float, friction: float
) -> None:
    """Loads at rest: shifted by an acceleration, they would favour the driven or braked axle."""
    row = car(l_f, l_r, drive, brake).row()
    row[ROLL_ARM] = 0.0
    for share, sign in zip(pedal_shares(row), (1.0, -1.0), strict=True):
        pull = sign * share * friction * GRAVITY * row[MASS]
        assert axle_share(row, 0.0, pull, 0.0) == pytest.approx(friction, rel=1e-9)
        assert 0.0 < share <= 1.0


@given(
    st.floats(0.5, 10.0), st.tuples(*2 * (st.floats(0.3, 1.0),)), st.floats(0.0, 40.0),
    st.floats(-0.1, 0.1),
)  # fmt: skip
def test_a_car_in_a_bend_may_always_slow_down_and_speeds_up_within_the_grip_alone(
    grip: float, shares: tuple[float, float], v: float, kappa: float
) -> None:
    least, most = for_pedals(grip, 0.5 * grip, shares, v, kappa)
    assert -grip <= least <= -0.4 * grip
    across = min(v * v * abs(kappa), grip)
    assert 0.0 <= most <= min(math.sqrt(grip * grip - across * across), 0.5 * grip)
