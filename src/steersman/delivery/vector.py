"""The test vector: whole steps and network inputs, with the outputs of the policy's controller."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from steersman.controllers.base import ControllerComponent, within_limits
from steersman.controllers.policy import PolicyState
from steersman.delivery import c_text
from steersman.delivery.c_source import Parts, common
from steersman.delivery.c_text import fill
from steersman.delivery.graph import TOLERANCE, exact, random_features
from steersman.delivery.observations import Row, observations, single
from steersman.types import FloatArray, Observation, Status
from steersman.vehicles import CarlaModel3, Vehicle

# Inputs of the network.
NETWORK = 100


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
    state = state._replace(run=lambda x: exact(p.network, x)[0])
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
    return observations(p.card, rng)


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
