"""What every sensor has to fulfil."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from steersman.contracts import Contract
from steersman.contracts.scenes import PosedRoad, beside
from steersman.sensing import WaypointSensor, track
from steersman.types import FloatArray, Observation


def _seen(sensor: WaypointSensor, road: PosedRoad, seed: int, side: float = 1.0) -> Observation:
    rng = np.random.default_rng(seed)
    car = beside(road, 30.0, d=0.2 * side, heading=0.05 * side, yaw_rate=0.1 * side)
    return sensor.observe(sensor.init(rng), car, track(car, road, 30.0), road, rng)


def _same(one: Observation, other: Observation, tolerance: float = 0.0) -> bool:
    rows = [np.hstack([np.ravel(value) for value in _measured(seen)]) for seen in (one, other)]
    return rows[0].shape == rows[1].shape and np.allclose(rows[0], rows[1], 0.0, tolerance)


def _measured(seen: Observation) -> list[FloatArray]:
    """What a sensor measures: all but a car ahead, which is told."""
    return [np.asarray(value) for name, value in seen._asdict().items() if name != "ahead"]


def observations_are_finite(sensor: WaypointSensor) -> Iterator[str]:
    """Numbers and waypoints, in their shape (n, 2)."""
    seen = _seen(sensor, PosedRoad(), 0)
    for name, value in zip(seen._fields, _measured(seen), strict=False):
        if not np.all(np.isfinite(value)):
            yield f"{name} is not finite"
    if seen.preview.ndim != 2 or seen.preview.shape[1] != 2:  # noqa: PLR2004 - x and y
        yield f"preview has the shape {seen.preview.shape}, expected (n, 2)"


def errors_depend_on_the_generator_alone(sensor: WaypointSensor) -> Iterator[str]:
    """The same seed gives the same observation."""
    if not _same(_seen(sensor, PosedRoad(), 4), _seen(sensor, PosedRoad(), 4)):
        yield "one seed gives two observations"


def place_and_direction_do_not_matter(sensor: WaypointSensor) -> Iterator[str]:
    """The same road elsewhere is seen equally."""
    here = _seen(sensor, PosedRoad(), 4)
    there = _seen(sensor, PosedRoad(x=-350.0, y=120.0, psi=2.4), 4)
    if not _same(here, there, 1e-9):
        yield "sees the same road elsewhere otherwise"


check: Contract[WaypointSensor] = Contract(
    observations_are_finite,
    errors_depend_on_the_generator_alone,
    place_and_direction_do_not_matter,
)
