"""Observations that a delivered controller is tried on: usual ones, far ones, strange ones."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np

from steersman.paths.random_road import RandomRoad
from steersman.sensing import WaypointSensor, track
from steersman.types import Observation, VehicleState

# Whole steps along a road, and at random.
DRIVEN, DRAWN = 200, 100
_FEWEST = 4
# At full lock: how far off the path [m], at which speed [m/s]. At 1 m/s policies ask for more.
_ASIDE = (3.0, 5.0), (3.0, 1.0), (1.0, 1.0)
_STRANGE = (math.nan, math.inf, -math.inf, 1e-42, -1e-42, 0.0, 1e6, -1e6, 1e15, -1e15)


class Sampled(Protocol):
    """What observations are made for, such as the setting of a controller."""

    @property
    def waypoints(self) -> int:
        """In an observation."""

    @property
    def spacing(self) -> float:
        """Between them [m]."""

    @property
    def dt(self) -> float:
        """Control period [s]."""


class Row(NamedTuple):
    """One step."""

    restart: bool
    seen: Observation
    executed: float | None = None
    """Command that was executed in place of the answer; None: the answer."""
    missing: bool = False
    """The observation did not arrive."""

    @property
    def given(self) -> Observation | None:
        """What the controller gets."""
        return None if self.missing else self.seen


def observations(of: Sampled, rng: np.random.Generator) -> list[Row]:
    """Steps along a road, random ones, and strange ones; every number fits into float32."""
    return [*_driven(of, rng), *_drawn(of, rng, DRAWN), *_strange(of, rng)]


def with_gaps(rows: Sequence[Row]) -> list[Row]:
    """The same with observations that do not arrive: short gaps, long ones, and one at first."""
    lost = [*range(2), *range(40, 44), *range(80, 95), *range(110, 160)]
    return [row._replace(missing=i % 400 in lost) for i, row in enumerate(rows)]


def with_wishes(rows: Sequence[Row], seed: int = 2) -> list[Row]:
    """The same with speeds wished at the waypoints, which fit into float32."""
    rng = np.random.default_rng(seed)

    def wished(seen: Observation) -> Observation:
        speeds = rng.uniform(0.0, 30.0, len(seen.preview))
        return seen._replace(wished=speeds.astype(np.float32).astype(np.float64))

    return [row._replace(seen=wished(row.seen)) for row in rows]


def _driven(of: Sampled, rng: np.random.Generator) -> Iterator[Row]:
    """A car that sways along a road of corners and is overruled now and then."""
    road = RandomRoad(seed=1)
    count = max(of.waypoints, _FEWEST)
    sensor = WaypointSensor(count=count, spacing=of.spacing)
    travel = min(12.0 * of.dt, 1.0)
    for i in range(DRIVEN):
        swing = math.sin(0.15 * i)
        at = road.at(5.0 + travel * i)
        state = VehicleState(
            i * of.dt, at.x - 0.2 * swing * math.sin(at.psi),
            at.y + 0.2 * swing * math.cos(at.psi), at.psi + 0.03 * math.cos(0.15 * i),
            12.0 + swing, 0.1 * swing, 12.0 * at.curvature, 0.0, 0.0, 3.0 * at.curvature,
            0.0, 0.0, 0.0,
        )  # fmt: skip
        place = track(state, road, 5.0 + travel * i)
        seen = sensor.observe(None, state, place, road, rng)
        overruled = single(0.1 * swing) if i % 50 == 49 else None  # noqa: PLR2004
        yield Row(i == 0, rounded(seen, of.waypoints), overruled)


def _drawn(of: Sampled, rng: np.random.Generator, count: int) -> Iterator[Row]:
    """Random observations of a car off its path, some of them far."""
    for i in range(count):
        size = 10.0 if i % 10 == 9 else 1.0  # noqa: PLR2004
        yield Row(i % 40 == 0, drawn(of, rng, size))


def drawn(of: Sampled, rng: np.random.Generator, size: float = 1.0) -> Observation:
    """A random observation of usual numbers times ``size``."""
    d, heading, v_y, rate, steer, kappa = size * rng.normal(0.0, [0.5, 0.1, 0.3, 0.3, 0.2, 0.03])
    ahead = np.arange(of.waypoints) * of.spacing
    preview = np.stack([ahead, 0.5 * kappa * ahead**2 - heading * ahead - d], axis=1)
    preview += 0.05 * size * rng.normal(size=preview.shape)
    v_x = size * rng.uniform(0.0, 25.0)
    seen = Observation(0.0, d, heading, v_x, v_y, rate, steer, kappa, preview, of.spacing)
    return rounded(seen, of.waypoints)


def straight(waypoints: int, spacing: float) -> Observation:
    """A car at 10 m/s on a straight road."""
    ahead = np.arange(waypoints) * spacing
    preview = np.stack([ahead, np.zeros(waypoints)], axis=1)
    return Observation(0.0, 0.0, 0.0, 10.0, 0.0, 0.0, 0.0, 0.0, preview, spacing)


def _strange(of: Sampled, rng: np.random.Generator) -> Iterator[Row]:
    """Beyond full lock; then each number in turn is not finite, tiny or absurd; a sound one."""
    numbers = 7 + 2 * of.waypoints
    for side in (-1.0, 1.0):
        yield Row(True, drawn(of, rng)._replace(steer=single(1.05 * side)))
        yield Row(False, drawn(of, rng))
        for offset, speed in _ASIDE:
            yield Row(True, _aside(of, side, offset, speed))
    for i, value in enumerate(np.resize(_STRANGE, max(len(_STRANGE) * 2, numbers))):
        seen = with_value(drawn(of, rng), i % numbers, single(value))
        yield Row(i == 0, seen)
    yield Row(False, drawn(of, rng))


def _aside(of: Sampled, side: float, offset: float, speed: float) -> Observation:
    """Full lock to ``side`` with the path off on that side, which asks for still more."""
    ahead = np.arange(of.waypoints) * of.spacing
    preview = np.stack([ahead, side * (offset + 0.5 * ahead)], axis=1)
    numbers = 0.0, -offset * side, -0.5 * side, speed, 0.0, 0.0, side, 0.0
    return rounded(Observation(*numbers, preview, of.spacing), of.waypoints)


def with_value(seen: Observation, index: int, value: float) -> Observation:
    """The observation with another value at a place: seven numbers, then the waypoints."""
    if index < 7:  # noqa: PLR2004
        changed: dict[str, Any] = {seen._fields[1 + index]: value}
        return seen._replace(**changed)
    preview = seen.preview.copy()
    preview.ravel()[index - 7] = value
    return seen._replace(preview=preview)


def single(value: Any) -> float:
    """The nearest float32."""
    return float(np.float32(value))


def rounded(seen: Observation, waypoints: int) -> Observation:
    """The observation in float32, with no more waypoints than the policy reads."""
    preview = seen.preview[:waypoints].astype(np.float32).astype(np.float64)
    numbers: dict[str, Any] = {
        name: single(value) for name, value in zip(seen._fields[1:8], seen[1:8], strict=True)
    }
    return seen._replace(**numbers, preview=preview)
