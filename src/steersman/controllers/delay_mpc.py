"""What both MPCs with a model of the delay share: estimates, prediction through it, commands."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Mapping
from typing import ClassVar, NamedTuple

import numpy as np

from steersman.config import param
from steersman.controllers.base import ControllerComponent
from steersman.controllers.grip_use import Belief
from steersman.controllers.model_error import TyreModelError
from steersman.controllers.motion_estimate import (
    SLOWEST,
    MotionEstimate,
    commanded,
    first_seen,
    unmoved,
    watched,
)
from steersman.controllers.mpc_delay_plan import Tables, Weights, build_tables, pose
from steersman.controllers.nmpc_plan import Ahead, iterated, problem
from steersman.controllers.plausible import ACROSS, nearer
from steersman.kernels import grip
from steersman.kernels import mpc_delay as kernel
from steersman.kernels.vehicle import L_F
from steersman.types import FloatArray, Observation, Status
from steersman.vehicles import Vehicle

NO_PLAN: FloatArray = np.zeros(0)


class SpeedState(NamedTuple):
    """What a plan of the speed carries from step to step."""

    belief: Belief
    limit: float = math.nan
    """The largest speed for the next control period [m/s]."""


class DelayMpcState(NamedTuple):
    """What the controller carries from step to step."""

    motion: MotionEstimate
    tables: Tables
    angle: float = 0.0
    """Last commanded wheel angle [rad]."""
    kappa: float = 0.0
    """Curvature at which it was to act [1/m]."""
    plan: FloatArray = NO_PLAN
    """Wheel angles of the last plan, if the next one starts from it [rad]."""
    speed: SpeedState | None = None
    """Where the speed is planned, too."""


class DelayMpc(ControllerComponent):
    """Predicts the car through the steering delay; subclasses plan from there.

    A car that drives the road the wrong way turns round at full lock, marked as a fallback.
    """

    answers: ClassVar[dict[str, str]] = {
        "filter_road": "taken out in 0.2.0, since it trusted the odometry: leave it out; a noisy"
        " sensor belongs behind the estimator, estimated/mpc_delay or estimated/nmpc"
    }
    search: ClassVar[Mapping[str, tuple[float, float, bool]]] = {
        "q_lateral_rate": (1e-4, 3.0, True),
        "q_heading": (1e-3, 30.0, True),
        "r": (1e-3, 30.0, True),
        "r_change": (0.1, 1e3, True),
        "disturbance_time": (0.1, 3.0, True),
    }

    delay: float | None = param(
        None,
        "s",
        "Time until a steering command acts; null: found (up to 0.5 s) from the measured steering.",
        ge=0,
        le=1.0,
    )
    # Longer plans of a car that oversteers at speed are badly conditioned: 20 steps lose it.
    horizon: int = param(12, "-", "Steps of the plan, one control period each.", ge=2, le=200)
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
    estimate_friction: bool = param(
        True, "-", "Find the friction from the car's motion; else it is the nominal one."
    )
    model_error: TyreModelError = param(
        TyreModelError(), "-", "How wrong the model's parameters are."
    )

    @abstractmethod
    def plan(
        self, state: DelayMpcState, ahead: Ahead, observation: Observation
    ) -> tuple[float, Status, DelayMpcState]:
        """The next wheel angle [rad], and the state with what the next plan starts from."""

    def weights(self) -> Weights:
        """All weights of the cost."""
        rates = self.q_lateral_rate, self.q_heading, self.q_yaw_rate
        return Weights(self.q_lateral, *rates, self.r, self.r_change)

    def init(self, vehicle: Vehicle, dt: float) -> DelayMpcState:
        """Tables for the vehicle's nominal parameters, complete."""
        state = self.redesign(vehicle, dt)
        state.tables.fill()
        return state

    def redesign(self, vehicle: Vehicle, dt: float) -> DelayMpcState:
        """The same with tables that are built where the car drives."""
        nominal = self.model_error.nominal(vehicle)
        tables = build_tables(nominal, dt, self.horizon, self.weights())
        motion = unmoved(nominal, dt, self.delay)
        return DelayMpcState(motion, tables, speed=self.begun(vehicle))

    def begun(self, vehicle: Vehicle) -> SpeedState | None:
        """What a plan of the speed carries before the first step; None: the speed is given."""
        return None

    def decide(
        self, state: DelayMpcState, observation: Observation
    ) -> tuple[float, Status, DelayMpcState]:
        """Normalised steering, unclipped."""
        o = observation
        state = self._watched(state, o)
        known = state.motion
        delay, motion = known.delay, pose(nearer(o, self.horizon * known.dt))
        kernel.through_delay(
            known.vehicle.table,
            known.speed_in(0.5 * delay),
            o.preview,
            o.spacing,
            o.curvature,
            np.array(known.disturbance),
            known.grips,
            known.commands,
            delay,
            known.dt,
            motion,
            np.empty((2, kernel.N_MOTION)),
        )
        if not np.isfinite(motion).all():
            return math.nan, Status.FALLBACK, state
        v = known.speed_in(delay)
        if abs(o.heading_error) > ACROSS:
            angle = -math.copysign(kernel.wheel_angle(known.vehicle.table, 1.0, v), o.heading_error)
            status, state = Status.FALLBACK, state._replace(plan=NO_PLAN)
        else:
            angle, status, state = self.plan(state, Ahead(motion, v), o)
        steer = known.vehicle.steer_for_wheel_angle(angle, v)
        return steer, status, state._replace(motion=commanded(known, steer), angle=angle)

    def executed(self, state: DelayMpcState, steer: float) -> DelayMpcState:
        """The executed steering replaces the last command; the next change counts from there."""
        motion = state.motion
        if not motion.begun or steer == motion.commands[0]:
            return state
        commands = motion.commands.copy()
        commands[0] = steer
        angle = kernel.wheel_angle(motion.vehicle.table, steer, motion.speed_in(motion.delay))
        return state._replace(motion=motion._replace(commands=commands), angle=angle)

    def _watched(self, state: DelayMpcState, o: Observation) -> DelayMpcState:
        """The state with its estimates brought up to date."""
        motion = state.motion
        if not motion.begun:
            angle = kernel.wheel_angle(motion.vehicle.table, o.steer, max(o.v_x, SLOWEST))
            return state._replace(motion=first_seen(motion, o), angle=angle, kappa=o.curvature)
        motion = watched(
            motion,
            o,
            find_delay=self.delay is None,
            disturbance_time=self.disturbance_time,
            find_friction=self.estimate_friction,
        )
        return state._replace(motion=motion)


def replanned(
    state: DelayMpcState, weights: Weights, ahead: Ahead, observation: Observation, iterations: int
) -> tuple[float, Status, DelayMpcState]:
    """The next wheel angle [rad], planned with tyres up to their grip, and the state after it."""
    known = state.motion
    row, front = known.vehicle.table.rows[0], float(known.grips[0])
    points = float(ahead.motion[kernel.VY] + row[L_F] * ahead.motion[kernel.RATE]) / ahead.v
    last = grip.linear_for_angle(row, front, points, state.angle)
    nlp, limits = problem(
        known, state.tables, weights, ahead, observation, last=last, kappa=state.kappa
    )
    plan, solved = iterated(nlp, limits, state.plan, iterations)
    angle = grip.angle_for_linear(row, front, points, float(plan[0]))
    status = Status.SOLVED if solved else Status.FALLBACK
    return angle, status, state._replace(kappa=float(nlp.road[0]), plan=plan)
