"""What every vehicle has to fulfil."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from steersman.contracts import Contract
from steersman.contracts.scenes import drive
from steersman.controllers.pid import Pid
from steersman.episode import DURATION
from steersman.paths.analytic import Circle, Straight
from steersman.speed import ConstantSpeed
from steersman.vehicles import Vehicle


def figures_are_numbers(vehicle: Vehicle) -> Iterator[str]:
    """The table that the kernels read holds no NaN."""
    for name, value in vehicle.table._asdict().items():
        if np.any(np.isnan(value)):
            yield f"{name} holds NaN"


def a_straight_stays_straight(vehicle: Vehicle) -> Iterator[str]:
    """Without steering the car does not leave its line."""
    episode = drive(Pid(), Straight(), vehicle=vehicle, duration=3.0)
    worst = float(np.abs(episode["lateral_error"]).max())
    if episode.end != DURATION or worst > 1e-3:  # noqa: PLR2004 - a millimetre
        yield f"drives {1e3 * worst:.3g} mm off a straight and ends by {episode.end}"


def left_and_right_are_alike(vehicle: Vehicle) -> Iterator[str]:
    """A circle to the left mirrors one to the right; with a bias of the steering it cannot."""
    if getattr(vehicle, "steer_bias", 0.0):
        return
    slow = ConstantSpeed(speed=6.0)
    left, right = (
        drive(Pid(), Circle(direction=side), vehicle=vehicle, speed=slow, duration=4.0)
        for side in ("left", "right")
    )
    if len(left) != len(right) or not np.allclose(left["yaw_rate"], -right["yaw_rate"], atol=1e-6):
        yield "a circle to the left is no mirror image of one to the right"
    elif not left["yaw_rate"][-1] > 0.0:
        yield "does not turn left on a circle to the left"


def pedals_work(vehicle: Vehicle) -> Iterator[str]:
    """The car reaches and holds a speed of 8 m/s."""
    episode = drive(
        Pid(), Straight(), vehicle=vehicle, speed=ConstantSpeed(speed=8.0), duration=10.0
    )
    if abs(float(episode["v_x"][-1]) - 8.0) > 1.0:
        yield f"drives {episode['v_x'][-1]:.3g} m/s where 8 m/s are wanted"


check: Contract[Vehicle] = Contract(
    figures_are_numbers,
    a_straight_stays_straight,
    left_and_right_are_alike,
    pedals_work,
)
