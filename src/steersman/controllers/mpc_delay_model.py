"""The tables of the delay-aware MPC: model, steady turn, gains and costs for each speed."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from scipy.linalg import solve_discrete_are

from steersman.controllers.single_track import ErrorModel, discrete, error_model, steady_state
from steersman.types import FloatArray
from steersman.vehicles import Vehicle

# Speeds of the tables [m/s]; between them everything is linear, beyond them held.
SLOWEST, SPEED_STEP, N_SPEEDS = 1.0, 0.5, 79


class Weights(NamedTuple):
    """Of the squares of e1, e1', e2, e2', of the wheel angle's deviation and of its change."""

    lateral: float
    lateral_rate: float
    heading: float
    yaw_rate: float
    angle: float
    change: float


class Model(NamedTuple):
    """What the plan needs at one speed; in the tables each with a first axis of speeds."""

    a: FloatArray
    """(4, 4) errors over a period."""
    b: FloatArray
    """(4,) effect of the wheel angle."""
    steady: FloatArray
    """(2, 3) heading error and wheel angle of the steady turn for a curvature of 1/m, a side
    acceleration of 1 m/s^2 and a yaw acceleration of 1 rad/s^2 that the model lacks."""
    gain: FloatArray
    """(5,) change of the wheel angle for each deviation, the last one that of the angle."""
    ahead: FloatArray
    """(N,) change of the wheel angle for each difference of the curvature ahead."""
    terminal: FloatArray
    """(5, 5) cost from the end of the horizon on."""


def at_speed(tables: Model, v: float) -> Model:
    """The tables at speed ``v`` [m/s]."""
    at = min(max((v - SLOWEST) / SPEED_STEP, 0.0), N_SPEEDS - 1.001)
    i = int(at)
    w = at - i
    return Model(*((1.0 - w) * table[i] + w * table[i + 1] for table in tables))


@lru_cache(maxsize=64)
def build_tables(vehicle: Vehicle, dt: float, horizon: int, weights: Weights) -> Model:
    """The tables of a vehicle's nominal parameters for a control period ``dt`` [s]."""
    speeds = [SLOWEST + SPEED_STEP * i for i in range(N_SPEEDS)]
    columns = zip(*(build_model(vehicle, dt, horizon, weights, v) for v in speeds), strict=True)
    tables = Model(*(np.stack(column) for column in columns))
    for table in tables:
        table.setflags(write=False)
    return tables


def build_model(vehicle: Vehicle, dt: float, horizon: int, weights: Weights, v: float) -> Model:
    """Discretise at speed ``v`` [m/s], solve the Riccati equation, look ahead along the road.

    With z = [xi, u of the last period] and the change of u as input, z(k+1) = A z(k) + B change(k)
    + E (kappa(k) - kappa(k+1)); docs/controllers.md has the derivation of the gains.
    """
    continuous = error_model(vehicle, v)
    model = discrete(continuous, dt)
    steady = _steady(continuous)
    a, b, e = np.eye(5), np.ones(5), np.zeros(5)
    a[:4, :4], a[:4, 4], b[:4] = model.a, model.b, model.b
    e[2] = steady[0, 0]
    q = np.diag(weights[:5])
    p = solve_discrete_are(a, b[:, None], q, np.array([[weights.change]]))
    scale = weights.change + b @ p @ b
    gain = (b @ p @ a) / scale
    ahead, costate = np.empty(horizon), p @ e
    for j in range(horizon):
        ahead[j] = b @ costate / scale
        costate = (a - np.outer(b, gain)).T @ costate
    return Model(model.a, model.b, steady, gain, ahead, p)


def _steady(model: ErrorModel) -> FloatArray:
    out = np.empty((2, 3))
    sources = (model.g, np.array([0.0, 1.0, 0.0, 0.0]), np.array([0.0, 0.0, 0.0, 1.0]))
    for i, source in enumerate(sources):
        xi, angle = steady_state(model._replace(g=source))
        out[:, i] = xi[2], angle
    return out
