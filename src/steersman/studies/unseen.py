"""What the runs of a tuning do not show: gains say nothing about what was never driven."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from steersman.disturbances import Dropouts, FrictionPatch, PositionDrift, SensorBias
from steersman.kernels.vehicle import GRAVITY
from steersman.plants.base import ComputedComponent
from steersman.rollout import RunConfig
from steersman.speed import ConstantSpeed, StopAndGo

# Grip below which a road counts as slippery [m/s^2].
_SLIPPERY = 0.9 * GRAVITY


def _has(*kinds: type) -> Callable[[RunConfig], bool]:
    return lambda run: any(isinstance(one, kinds) for one in run.disturbances)


CLASSES: dict[str, Callable[[RunConfig], bool]] = {
    "steering delay": lambda run: run.plant.steering_delay > 0.0,
    "waypoint noise": lambda run: run.sensor.error_range > 0.0,
    "other car than the controller's model": lambda run: run.nominal is not None,
    "slippery road": lambda run: run.vehicle.friction * GRAVITY < _SLIPPERY,
    "change of friction on the way": _has(FrictionPatch),
    "noise of pose and speed": lambda run: any(run.sensor.deviations),
    "bias of speeds and yaw rate": _has(SensorBias),
    "drift of position": _has(PositionDrift),
    "latency": lambda run: run.sensor.latency > 0.0,
    "drop-out": _has(Dropouts),
    "side wind": lambda run: isinstance(run.plant, ComputedComponent) and run.plant.wind.speed > 0,
    "changing speed": lambda run: not isinstance(run.speed, ConstantSpeed),
    "stop": lambda run: isinstance(run.speed, StopAndGo),
    "start beside the road": lambda run: run.start.offset != 0.0,
}
"""Classes of disturbances, and whether a run has one of them."""


def unseen(runs: Sequence[RunConfig]) -> list[str]:
    """The classes that none of the runs has."""
    return [words for words, has in CLASSES.items() if not any(map(has, runs))]


def warning(runs: Sequence[RunConfig]) -> str | None:
    """A sentence about what the runs do not show; None if they show all of it."""
    missing = unseen(runs)
    if not missing:
        return None
    return (
        f"the runs hold no {', no '.join(missing)}: gains that are good here may leave the road "
        "there; suite=tuning holds all of it"
    )
