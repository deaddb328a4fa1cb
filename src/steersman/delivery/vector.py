"""The test vector: whole steps and network inputs, with the outputs of the policy's controller."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from steersman.controllers.base import ControllerComponent, within_limits
from steersman.controllers.policy import PolicyState
from steersman.delivery import c_text
from steersman.delivery.c_source import Parts, common, fill
from steersman.delivery.graph import TOLERANCE, exact, random_features
from steersman.paths.random_road import RandomRoad
from steersman.sensing import WaypointSensor, track
from steersman.types import FloatArray, Observation, Status, VehicleState
from steersman.vehicles import CarlaModel3, Vehicle

# Whole steps along a road, at random, and out of the ordinary; inputs of the network.
DRIVEN, DRAWN, NETWORK = 200, 100, 100
_FEWEST = 4
_STRANGE = (math.nan, math.inf, -math.inf, 1e-42, -1e-42, 0.0, 1e6, -1e6, 1e15, -1e15)


class Row(NamedTuple):
    """One step."""

    restart: bool
    seen: Observation
    base: float
    """Command of the corrected controller."""
    executed: float | None
    """Command that was executed instead of the policy's; None: the policy's."""


class Answer(NamedTuple):
    """The controller's output for a row."""

    steer: float
    status: Status


class GivenCommand(ControllerComponent):
    """In place of the corrected controller: its command is its state."""

    def init(self, vehicle: Vehicle, dt: float) -> float:
        """Straight on."""
        return 0.0

    def decide(self, state: float, observation: Observation) -> tuple[float, Status, float]:
        """The state."""
        return state, Status.SOLVED, state


def reference(p: Parts) -> PolicyState:
    """The controller's first state, with the network in float64 and the base's command as given."""
    state = p.policy.init(CarlaModel3(), p.card.dt)
    state = state._replace(run=lambda x: float(exact(p.network, x)[0, 0]))
    return state if state.base is None else state._replace(base=GivenCommand(), base_state=0.0)


def answers(p: Parts, rows: list[Row]) -> list[Answer]:
    """The outputs of the policy's controller for ``rows``."""
    start = state = reference(p)
    out = []
    for row in rows:
        state = start if row.restart else state
        if state.base is not None:
            state = state._replace(base_state=row.base)
        if state.base is not None and not math.isfinite(row.base):
            # No controller of this package returns that; in C it is one more input.
            out.append(Answer(within_limits(row.seen.steer), Status.FALLBACK))
        else:
            decision, state = p.policy.step(state, row.seen)
            out.append(Answer(decision.steer, decision.status))
        if row.executed is not None:
            state = p.policy.executed(state, row.executed)
    return out


def rows(p: Parts) -> list[Row]:
    """Steps along a road, random ones, and strange ones; every number fits into float32."""
    rng = np.random.default_rng(0)
    return [*_driven(p, rng), *_drawn(p, rng, DRAWN), *_strange(p, rng)]


def _driven(p: Parts, rng: np.random.Generator) -> Iterator[Row]:
    """A car that sways along a road of corners and is overruled now and then."""
    road = RandomRoad(seed=1)
    count = max(p.card.waypoints, _FEWEST)
    sensor = WaypointSensor(count=count, spacing=p.card.spacing)
    travel = min(12.0 * p.card.dt, 1.0)
    for i in range(DRIVEN):
        swing = math.sin(0.15 * i)
        at = road.at(5.0 + travel * i)
        state = VehicleState(
            i * p.card.dt, at.x - 0.2 * swing * math.sin(at.psi),
            at.y + 0.2 * swing * math.cos(at.psi), at.psi + 0.03 * math.cos(0.15 * i),
            12.0 + swing, 0.1 * swing, 12.0 * at.curvature, 0.0, 0.0, 3.0 * at.curvature,
            0.0, 0.0, 0.0,
        )  # fmt: skip
        place = track(state, road, 5.0 + travel * i)
        seen = sensor.observe(None, state, place, road, rng)
        base = single(2.0 * at.curvature - 0.05 * place.lateral_error)
        overruled = single(0.1 * swing) if i % 50 == 49 else None  # noqa: PLR2004
        yield Row(i == 0, rounded(seen, p.card.waypoints), base, overruled)


def _drawn(p: Parts, rng: np.random.Generator, count: int) -> Iterator[Row]:
    """Random observations of a car off its path, some of them far."""
    for i in range(count):
        size = 10.0 if i % 10 == 9 else 1.0  # noqa: PLR2004
        yield Row(i % 40 == 0, drawn(p, rng, size), single(rng.uniform(-1.0, 1.0)), None)


def drawn(p: Parts, rng: np.random.Generator, size: float = 1.0) -> Observation:
    """A random observation of usual numbers times ``size``."""
    d, heading, v_y, rate, steer, kappa = size * rng.normal(0.0, [0.5, 0.1, 0.3, 0.3, 0.2, 0.03])
    ahead = np.arange(p.card.waypoints) * p.card.spacing
    preview = np.stack([ahead, 0.5 * kappa * ahead**2 - heading * ahead - d], axis=1)
    preview += 0.05 * size * rng.normal(size=preview.shape)
    v_x = size * rng.uniform(0.0, 25.0)
    seen = Observation(0.0, d, heading, v_x, v_y, rate, steer, kappa, preview, p.card.spacing)
    return rounded(seen, p.card.waypoints)


def _strange(p: Parts, rng: np.random.Generator) -> Iterator[Row]:
    """Beyond full lock; then each number in turn is not finite, tiny or absurd; a sound one."""
    numbers = 7 + 2 * p.card.waypoints
    for side in (-1.0, 1.0):
        yield Row(True, drawn(p, rng)._replace(steer=single(1.05 * side)), 1.5 * side, None)
        yield Row(False, drawn(p, rng), side, None)
        yield Row(True, _aside(p, side), 1.5 * side, None)
    for i, value in enumerate(np.resize(_STRANGE, max(len(_STRANGE) * 2, numbers))):
        seen = with_value(drawn(p, rng), i % numbers, single(value))
        yield Row(i == 0, seen, single(rng.uniform(-1.0, 1.0)), None)
    yield Row(False, drawn(p, rng), 0.0, None)
    if p.card.base is not None:
        yield Row(False, drawn(p, rng), math.nan, None)
        yield Row(False, drawn(p, rng), 1.5, None)


def _aside(p: Parts, side: float) -> Observation:
    """Full lock to ``side`` with the path far off on that side, which asks for still more."""
    ahead = np.arange(p.card.waypoints) * p.card.spacing
    preview = np.stack([ahead, side * (3.0 + 0.5 * ahead)], axis=1)
    seen = Observation(
        0.0, -3.0 * side, -0.5 * side, 5.0, 0.0, 0.0, side, 0.0, preview, p.card.spacing
    )
    return rounded(seen, p.card.waypoints)


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


def vector_text(p: Parts) -> str:
    """The vector as C arrays."""
    given = random_features(p.network.scale, NETWORK)
    actions = exact(p.network, given)[:, 0]
    steps = rows(p)
    return fill(
        "vector.h.in",
        {
            **common(p),
            "tolerance": f"{TOLERANCE:g}f",
            "network_rows": "".join(map(_network_row, given, actions)),
            "steps": "".join(map(_step, steps, answers(p, steps))),
        },
    )


def _network_row(features: FloatArray, action: float) -> str:
    return f"    {{{c_text.braces([c_text.loose(x) for x in features])}, {_loose(action)}}},\n"


def _step(row: Row, answer: Answer) -> str:
    pairs = [c_text.braces([_loose(x), _loose(y)]) for x, y in row.seen.preview]
    seen = [_loose(x) for x in row.seen[1:8]] + [c_text.braces(pairs or ["{0.0f, 0.0f}"])]
    overruled = row.executed is not None
    values = [
        str(int(row.restart)), c_text.braces(seen), _loose(row.base), _loose(answer.steer),
        str(int(answer.status)), str(int(overruled)), _loose(row.executed or 0.0),
    ]  # fmt: skip
    return f"    {c_text.braces(values)},\n"


def _loose(value: float) -> str:
    return c_text.loose(single(value))


def program_text(p: Parts) -> str:
    """The program that runs the vector."""
    base = "" if p.card.base is None else "row->base, "
    return fill("test.c.in", {**common(p), "base_argument": base})
