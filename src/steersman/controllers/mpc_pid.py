"""The linear MPC alone, and MPC-PID, the baseline and demonstrator: its plan plus PID feedback."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar, NamedTuple

from steersman.config import param, register
from steersman.controllers.base import ControllerComponent, within_limits
from steersman.controllers.condensed_qp import MpcProblem, build_problem
from steersman.controllers.model_error import ModelError
from steersman.controllers.pid import PidGains, PidState
from steersman.controllers.plausible import ACROSS, nearer
from steersman.kernels.mpc_delay import wheel_angle
from steersman.types import FloatArray, Observation, Status
from steersman.vehicles import Vehicle

# Speeds of the scheduled models [m/s].
_GRID_STEP = 2.0
_GRID = tuple(_GRID_STEP * (i + 1) for i in range(20))


class MpcState(NamedTuple):
    """What MPC and MPC-PID carry from step to step."""

    vehicle: Vehicle
    problems: tuple[MpcProblem, ...]
    """One for the tuned speed, or one for each speed of the grid."""
    pid: PidState = PidState()
    plan: FloatArray | None = None
    """Last plan of wheel angles that was an optimum [rad]."""
    age: int = 0
    """How many steps ago that was."""
    angle: float = 0.0
    """The MPC's last wheel angle [rad]."""
    steer: float = 0.0
    """Normalised steering that was commanded with it."""
    v_x: float = 0.0
    """Speed at that moment [m/s]."""


@register("controller", "mpc")
class Mpc(ControllerComponent):
    """The linear MPC of MPC-PID without its PID.

    If the QP has no solution, the last plan shifted by one step per failure stands in; when that is
    used up, the wheels point straight ahead. A car that drives the road the wrong way or across it
    turns round at full lock. All of these are marked as a fallback.
    """

    search: ClassVar[Mapping[str, tuple[float, float, bool]]] = {
        "p": (1e-2, 100.0, True),
        "r": (1e-4, 1e3, True),
    }

    horizon: int = param(20, "-", "Steps of the MPC, one control period each.", ge=2, le=200)
    v0: float = param(30.0 / 3.6, "m/s", "Speed of the linear model.", gt=0, le=150)
    q: float = param(1.0, "1/m^2", "Weight of the squared lateral error.", gt=0)
    p: float = param(35.6, "1/m^2", "Additional weight at the end of the horizon.", ge=0)
    r: float = param(0.0325, "1/rad^2", "Weight of the squared wheel angle.", gt=0)
    rate_limit: bool = param(False, "-", "Keep the steering rate limit in the plan.")
    corridor: float | None = param(
        None, "m", "Soft limit of the predicted lateral error; null: none.", gt=0
    )
    model_error: ModelError = param(ModelError(), "-", "How wrong the model's parameters are.")
    scheduled: bool = param(False, "-", "Beyond the paper: models at 2, 4, ... 40 m/s.")

    def init(self, vehicle: Vehicle, dt: float) -> MpcState:
        """Build the QP for the vehicle's nominal parameters; there is no plan yet."""
        nominal = self.model_error.nominal(vehicle)
        speeds = _GRID if self.scheduled else (self.v0,)
        problems = [
            build_problem(
                nominal,
                dt,
                v0=v,
                horizon=self.horizon,
                q=self.q,
                p=self.p,
                r=self.r,
                rate_limit=self.rate_limit,
                corridor=self.corridor,
            )
            for v in speeds
        ]
        return MpcState(nominal, tuple(problems))

    def decide(self, state: MpcState, observation: Observation) -> tuple[float, Status, MpcState]:
        """Normalised steering, unclipped."""
        status, planned, state = self.next_plan(state, observation)
        return planned, status, state

    def next_plan(
        self, state: MpcState, observation: Observation
    ) -> tuple[Status, float, MpcState]:
        """Plan anew, or shift the last plan; normalised steering of the MPC, and the new state."""
        problem, o, plan, age = state.problems[0], observation, state.plan, state.age + 1
        if self.scheduled:
            near = round(o.v_x / _GRID_STEP) - 1
            problem = state.problems[min(max(near, 0), len(state.problems) - 1)]
        status = Status.FALLBACK
        if abs(o.heading_error) > ACROSS:
            plan, age = problem.turn(o), 0
        else:
            solved = problem.solve(nearer(o, problem.horizon * problem.dt), state.angle)
            if solved is not None:
                plan, age, status = solved, 0, Status.SOLVED
        angle = float(plan[age]) if plan is not None and age < len(plan) else 0.0
        vehicle, problems, pid = state[:3]
        steer = vehicle.steer_for_wheel_angle(angle, o.v_x)
        held = within_limits(steer)
        return status, steer, MpcState(vehicle, problems, pid, plan, age, angle, held, o.v_x)

    def executed(self, state: MpcState, steer: float) -> MpcState:
        """The rate limit counts from the executed steering; see :meth:`share`."""
        share = self.share()
        if not self.rate_limit or share == 0.0 or steer == state.steer:
            return state
        planned = state.vehicle.steer_for_wheel_angle(state.angle, state.v_x)
        planned = within_limits(planned + (steer - state.steer) / share)
        angle = wheel_angle(state.vehicle.table, planned, state.v_x)
        return state._replace(angle=angle, steer=steer)

    def share(self) -> float:
        """Factor on the MPC's steering in the command."""
        return 1.0


@register("controller", "mpc_pid")
class MpcPid(Mpc):
    """u = c_mpc u_MPC + c_pid u_PID: a linear MPC at one tuned speed, corrected by a PID.

    If the QP has no solution, the last plan shifted by one step per failure stands in for u_MPC;
    when that is used up, the PID steers alone; against the road the car turns round. All of these
    are marked as a fallback. When ``scheduled``, the PID fades above v0 as (v0 / v)^2.
    """

    # Defaults are those that `steersman tune controller=mpc_pid` found on the training circuit
    # at 30 km/h (results/tune/mpc_pid_home), rounded. q stays: only ratios of weights matter.
    search: ClassVar[Mapping[str, tuple[float, float, bool]]] = {
        "p": (1e-2, 100.0, True),
        "r": (1e-2, 1e3, True),
        "c_mpc": (0.3, 1.5, False),
        "gains.k_p": (1e-3, 1.0, True),
        "gains.k_i": (1e-4, 1.0, True),
        "gains.k_d": (1e-4, 0.5, True),
        "gains.filter_time": (1e-3, 0.5, True),
    }

    c_mpc: float = param(1.03, "-", "Weight of the MPC in the output.")
    c_pid: float = param(1.0, "-", "Weight of the PID in the output.")
    gains: PidGains = param(
        PidGains(k_p=0.163, k_i=0.00678, k_d=0.000128, filter_time=0.00353),
        "-",
        "Gains of the PID on the lateral error.",
    )

    def decide(self, state: MpcState, observation: Observation) -> tuple[float, Status, MpcState]:
        """Normalised steering, unclipped."""
        o, c_pid = observation, self.c_pid
        if self.scheduled:
            c_pid *= min(1.0, self.v0 / max(o.v_x, 1.0)) ** 2
        dt = state.problems[0].dt
        feedback, pid = self.gains.update(state.pid, o.lateral_error, o.v_x, dt)
        status, planned, state = self.next_plan(state, o)
        steer = self.c_mpc * planned + c_pid * feedback
        return steer, status, state._replace(pid=pid, steer=within_limits(steer))

    def share(self) -> float:
        """Factor on the MPC's steering in the command."""
        return self.c_mpc
