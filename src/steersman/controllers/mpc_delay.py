"""MPC with a model of speed, steering delay and steering rate, and an estimate of its errors.

Regulator with preview of the road: Tomizuka, Optimal continuous finite preview problem, IEEE
Trans. Automatic Control 20, 1975. Terminal cost: Rawlings, Mayne and Diehl, Model Predictive
Control, 2nd ed., 2017, sec. 2.5. Offset-free by a disturbance model: Pannocchia and Rawlings,
Disturbance models for offset-free model-predictive control, AIChE Journal 49, 2003.
docs/controllers.md has the equations.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import ClassVar, NamedTuple

import numpy as np

from steersman.config import param, register
from steersman.controllers.base import ControllerComponent
from steersman.controllers.mpc_delay_plan import (
    SLOWEST,
    Model,
    PlanProblem,
    Weights,
    build_tables,
    pose,
    solve,
)
from steersman.controllers.road_filter import NOTHING_SEEN, RoadState, first_look, fuse
from steersman.kernels import mpc_delay as kernel
from steersman.types import FloatArray, Observation, Status
from steersman.vehicles import Vehicle

# Delays that the estimate tries: 0, 10, ... 500 ms [s].
_RESOLUTION, _LONGEST = 0.01, 0.5
# Delays [s] that differ by less are the same, but for rounding.
_SAME = 1e-9
# Time over which the errors of the tried delays fade [s].
_MEMORY = 2.0
# Another delay has to explain the steering this much better than the present one.
_BETTER = 0.5
# Time constant of the acceleration's estimate [s].
_SURGE_TIME = 0.15
# Bound of the estimates, beyond what a car can do [m/s^2], [rad/s^2].
_MOST = 10.0


class Seen(NamedTuple):
    """The observation of one period ago."""

    v_x: float
    v_y: float
    yaw_rate: float
    steer: float


class MpcDelayState(NamedTuple):
    """What the controller carries from step to step."""

    vehicle: Vehicle
    dt: float
    tables: Model
    commands: FloatArray
    """Normalised steering commands, newest first."""
    scores: FloatArray
    """Squared errors of the steering that each tried delay predicts, fading over time."""
    begun: bool = False
    """Whether there was a first step, which fills what follows."""
    angle: float = 0.0
    """Last commanded wheel angle [rad]."""
    kappa: float = 0.0
    """Curvature at which it was to act [1/m]."""
    seen: Seen = Seen(0.0, 0.0, 0.0, 0.0)
    acceleration: float = 0.0
    """Estimated from v_x [m/s^2]."""
    disturbance: tuple[float, float] = (0.0, 0.0)
    """Side [m/s^2] and yaw acceleration [rad/s^2] missing in the model."""
    delay: float = 0.0
    """Steering delay that the prediction uses [s]."""
    road: RoadState = NOTHING_SEEN
    """State of the road filter, if there is one."""


@register("controller", "mpc_delay")
class MpcDelay(ControllerComponent):
    """Predicts the car through the steering delay, then plans along the road's curvature.

    Error dynamics of the present speed; the plan is the infinite-horizon optimum while no limit is
    active, and DAQP's while one is. If DAQP does not solve, that optimum is forced into the limits
    and marked as a fallback.
    """

    search: ClassVar[Mapping[str, tuple[float, float, bool]]] = {
        "q_lateral_rate": (1e-4, 3.0, True),
        "q_heading": (1e-3, 30.0, True),
        "r": (1e-3, 30.0, True),
        "r_change": (0.1, 1e3, True),
        "disturbance_time": (0.03, 3.0, True),
    }

    delay: float | None = param(
        None,
        "s",
        "Time until a steering command acts; null: found (up to 0.5 s) from the measured steering.",
        ge=0,
        le=1.0,
    )
    horizon: int = param(20, "-", "Steps of the plan, one control period each.", ge=2, le=200)
    q_lateral: float = param(1.0, "1/m^2", "Weight of the squared lateral error.", gt=0)
    q_lateral_rate: float = param(0.01, "s^2/m^2", "Weight of its squared rate.", ge=0)
    q_heading: float = param(
        0.1, "1/rad^2", "Weight of the squared heading error less the steady turn's.", ge=0
    )
    q_yaw_rate: float = param(0.0, "s^2/rad^2", "Weight of its squared rate.", ge=0)
    r: float = param(
        0.1, "1/rad^2", "Weight of the squared wheel angle less the steady turn's.", gt=0
    )
    r_change: float = param(10.0, "1/rad^2", "Weight of its squared change over a period.", gt=0)
    disturbance_time: float | None = param(
        0.3,
        "s",
        "Time constant of the estimate of accelerations missing in the model; null: none.",
        gt=0,
    )
    filter_road: bool = param(
        True, "-", "Filter errors and waypoints over time, as far as they are noisy."
    )

    def weights(self) -> Weights:
        """All weights of the cost."""
        rates = self.q_lateral_rate, self.q_heading, self.q_yaw_rate
        return Weights(self.q_lateral, *rates, self.r, self.r_change)

    def init(self, vehicle: Vehicle, dt: float) -> MpcDelayState:
        """Tables for the vehicle's nominal parameters."""
        tables = build_tables(vehicle, dt, self.horizon, self.weights())
        delay = 0.0 if self.delay is None else self.delay
        commands = np.zeros(int(max(delay, _LONGEST) / dt + _SAME) + 2)
        scores = np.zeros(round(_LONGEST / _RESOLUTION) + 1)
        return MpcDelayState(vehicle, dt, tables, commands, scores, delay=delay)

    def decide(
        self, state: MpcDelayState, observation: Observation
    ) -> tuple[float, Status, MpcDelayState]:
        """Normalised steering, unclipped."""
        o, state = self._observe(state, observation)
        table, dt, delay = state.vehicle.table, state.dt, state.delay
        disturbance, motion = np.array(state.disturbance), pose(o)
        kernel.through_delay(
            table,
            max(o.v_x + 0.5 * state.acceleration * delay, SLOWEST),
            o.preview,
            o.spacing,
            o.curvature,
            disturbance,
            state.commands,
            delay,
            dt,
            motion,
            np.empty((2, kernel.N_MOTION)),
        )
        if not np.isfinite(motion).all():
            return math.nan, Status.FALLBACK, state
        v = max(o.v_x + state.acceleration * delay, SLOWEST)  # when the command will act
        road = np.empty(self.horizon + 1)
        kernel.road_ahead(o.preview, o.spacing, o.curvature, motion[kernel.WAY], v * dt, road)
        problem = PlanProblem.at(state.vehicle, dt, state.tables, v, road, motion, disturbance)
        angle, status = solve(problem, self.weights(), state.angle, state.kappa)
        steer = state.vehicle.steer_for_wheel_angle(angle, v)
        commands = np.empty_like(state.commands)
        commands[0], commands[1:] = min(max(steer, -1.0), 1.0), state.commands[:-1]
        return (
            steer,
            status,
            state._replace(commands=commands, angle=angle, kappa=float(road[0])),
        )

    def executed(self, state: MpcDelayState, steer: float) -> MpcDelayState:
        """The executed steering replaces the last command; the next change counts from there."""
        if not state.begun or steer == state.commands[0]:
            return state
        commands = state.commands.copy()
        commands[0] = steer
        v = max(state.seen.v_x + state.acceleration * state.delay, SLOWEST)  # as in decide
        angle = kernel.wheel_angle(state.vehicle.table, steer, v)
        return state._replace(commands=commands, angle=angle)

    def _observe(self, state: MpcDelayState, o: Observation) -> tuple[Observation, MpcDelayState]:
        """The observation, filtered, and the state with its estimates brought up to date."""
        seen = Seen(o.v_x, o.v_y, o.yaw_rate, o.steer)
        if not state.begun:
            return o, self._begin(state, o, seen)
        if self.delay is None:
            state = _judge_delays(state, seen)
        blend = state.dt / (_SURGE_TIME + state.dt)
        surge = (seen.v_x - state.seen.v_x) / state.dt
        acceleration = _bounded(state.acceleration + blend * (surge - state.acceleration))
        if self.disturbance_time is not None:
            gain = 1.0 / (self.disturbance_time + state.dt)
            side, yaw = _surprise(state, o)
            before = state.disturbance
            lacks = _bounded(before[0] + gain * side), _bounded(before[1] + gain * yaw)
            state = state._replace(disturbance=lacks)
        if self.filter_road:
            if state.road.points.shape != o.preview.shape:
                state = state._replace(road=first_look(o))
            else:
                o, road = fuse(state.road, o, state.dt)
                state = state._replace(road=road)
        return o, state._replace(seen=seen, acceleration=acceleration)

    def _begin(self, state: MpcDelayState, o: Observation, seen: Seen) -> MpcDelayState:
        """The state as if the present steering had been the command for a long time."""
        return state._replace(
            commands=np.full_like(state.commands, o.steer),
            begun=True,
            angle=kernel.wheel_angle(state.vehicle.table, o.steer, max(o.v_x, SLOWEST)),
            kappa=o.curvature,
            seen=seen,
            road=first_look(o) if self.filter_road else NOTHING_SEEN,
        )


def _bounded(value: float) -> float:
    return min(max(value, -_MOST), _MOST)


def _judge_delays(state: MpcDelayState, seen: Seen) -> MpcDelayState:
    """The delay that explains best how the measured steering followed the commands."""
    scores, dt = state.scores.copy(), state.dt
    row, keep = state.vehicle.table.rows[0], max(1.0 - dt / _MEMORY, 0.0)
    best = kernel.score_delays(
        row, state.commands, dt, _RESOLUTION, state.seen.steer, seen.steer, keep, scores
    )
    present = min(round(state.delay / _RESOLUTION), len(scores) - 1)
    better = scores[best] < _BETTER * scores[present]
    return state._replace(scores=scores, delay=best * _RESOLUTION if better else state.delay)


def _surprise(state: MpcDelayState, o: Observation) -> tuple[float, float]:
    """Side velocity and yaw rate observed, less those the model predicted one period ago."""
    seen = state.seen
    motion = np.array([0.0, 0.0, seen.v_y, seen.yaw_rate, seen.steer, 0.0])
    kernel.over_last_period(
        state.vehicle.table,
        max(0.5 * (seen.v_x + o.v_x), SLOWEST),
        o.preview,
        o.spacing,
        np.array(state.disturbance),
        state.commands,
        state.delay,
        state.dt,
        motion,
        np.empty((2, kernel.N_MOTION)),
    )
    return o.v_y - float(motion[kernel.VY]), o.yaw_rate - float(motion[kernel.RATE])
