"""What every source of throttle and brake has to fulfil."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from steersman.contracts import Contract
from steersman.contracts.scenes import DT, PosedRoad, drive, same
from steersman.controllers.pid import Pid
from steersman.kernels.speed import pedals
from steersman.profiles import stack_profiles
from steersman.speed import SpeedComponent


def pedals_are_in_their_range(speed: SpeedComponent) -> Iterator[str]:
    """Throttle and brake are in [0, 1] at any speed, and never pressed together."""
    path = PosedRoad()
    start = speed.start_speed(path, 0.0)
    if not 0.0 <= start < np.inf:
        yield f"starts at {start} m/s"
    table, integral = stack_profiles([speed.profile()], [path]), 0.0
    for i, v in enumerate((0.0, 5.0, start, 40.0, 80.0) * 4):
        now = table, 0, path.table, 0, i * DT, 2.0 * i, v
        throttle, brake, integral = pedals(*now, integral, DT)
        if not (0.0 <= throttle <= 1.0 and 0.0 <= brake <= 1.0):
            yield f"throttle {throttle}, brake {brake} at {v:g} m/s"
        if throttle > 0.0 and brake > 0.0:
            yield f"presses both pedals at {v:g} m/s"


def a_drive_repeats(speed: SpeedComponent) -> Iterator[str]:
    """Two drives with one seed are equal to the bit."""
    one, again = (drive(Pid(), PosedRoad(), speed=speed, duration=3.0) for _ in range(2))
    if not same(one, again):
        yield "two drives with one seed differ"


def a_drawn_profile_repeats(speed: SpeedComponent) -> Iterator[str]:
    """The profile that a training draws depends on the generator alone."""
    one, again = (tuple(speed.draw(np.random.default_rng(3), 20.0)) for _ in range(2))
    if repr(one) != repr(again):
        yield "one generator gives two profiles"


check: Contract[SpeedComponent] = Contract(
    pedals_are_in_their_range,
    a_drive_repeats,
    a_drawn_profile_repeats,
)
