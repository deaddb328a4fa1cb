"""MPC-PID, the baseline and demonstrator: a linear MPC's plan plus PID feedback."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar, NamedTuple

from steersman.config import Settings, param, register
from steersman.controllers.base import ControllerComponent
from steersman.controllers.mpc import MpcProblem, build_problem
from steersman.controllers.pid import PidGains, PidState
from steersman.types import FloatArray, Observation, Status
from steersman.vehicles import Vehicle


class ModelError(Settings):
    """Factors on the vehicle's true parameters that give the controller's nominal ones."""

    mass: float = param(1.0, "-", "Nominal mass over true mass.", gt=0)
    yaw_inertia: float = param(1.0, "-", "Nominal yaw inertia over the true one.", gt=0)
    c_f: float = param(1.0, "-", "Nominal front cornering stiffness over the true one.", gt=0)
    c_r: float = param(1.0, "-", "Nominal rear cornering stiffness over the true one.", gt=0)

    def nominal(self, vehicle: Vehicle) -> Vehicle:
        """The vehicle as the controller believes it to be."""
        return vehicle.replace(
            mass=vehicle.mass * self.mass,
            yaw_inertia=vehicle.yaw_inertia * self.yaw_inertia,
            c_f=vehicle.c_f * self.c_f,
            c_r=vehicle.c_r * self.c_r,
        )


class MpcPidState(NamedTuple):
    """What MPC-PID carries from step to step."""

    vehicle: Vehicle
    problems: tuple[MpcProblem, ...]
    """One for the tuned speed, or one for each speed of the grid."""
    pid: PidState
    plan: FloatArray | None
    """Last plan of wheel angles that DAQP solved [rad], and how many steps ago that was."""
    age: int
    angle: float
    """Wheel angle the MPC asked for last [rad]."""


# Speeds of the scheduled models [m/s].
_GRID_STEP = 2.0
_GRID = tuple(_GRID_STEP * (i + 1) for i in range(20))


@register("controller", "mpc_pid")
class MpcPid(ControllerComponent):
    """u = c_mpc u_MPC + c_pid u_PID: a linear MPC at one tuned speed, corrected by a PID.

    If DAQP does not solve, the last plan shifted by one step per failure stands in for u_MPC;
    when that is used up, the PID drives alone. Either is marked as a fallback.
    """

    # Defaults are those that `steersman tune controller=mpc_pid` found on the training circuit
    # at 30 km/h (results/tune/mpc_pid), rounded. q stays: only ratios of weights matter.
    search: ClassVar[Mapping[str, tuple[float, float, bool]]] = {
        "p": (1e-2, 100.0, True),
        "r": (1e-2, 1e3, True),
        "c_mpc": (0.3, 1.5, False),
        "gains.k_p": (1e-3, 1.0, True),
        "gains.k_i": (1e-4, 1.0, True),
        "gains.k_d": (1e-4, 0.5, True),
        "gains.filter_time": (1e-3, 0.5, True),
    }

    horizon: int = param(20, "-", "Steps of the MPC, one control period each.", ge=2, le=200)
    v0: float = param(30.0 / 3.6, "m/s", "Speed of the linear model.", gt=0)
    q: float = param(1.0, "1/m^2", "Weight of the squared lateral error.", gt=0)
    p: float = param(35.6, "1/m^2", "Additional weight at the end of the horizon.", ge=0)
    r: float = param(0.0325, "1/rad^2", "Weight of the squared wheel angle.", gt=0)
    c_mpc: float = param(1.03, "-", "Weight of the MPC in the output.")
    c_pid: float = param(1.0, "-", "Weight of the PID in the output.")
    gains: PidGains = param(
        PidGains(k_p=0.163, k_i=0.00678, k_d=0.000128, filter_time=0.00353),
        "-",
        "Gains of the PID on the lateral error.",
    )
    rate_limit: bool = param(False, "-", "Keep the steering rate limit in the plan.")
    corridor: float | None = param(
        None, "m", "Soft limit of the predicted lateral error; null: none.", gt=0
    )
    model_error: ModelError = param(ModelError(), "-", "How wrong the model's parameters are.")
    scheduled: bool = param(
        False,
        "-",
        "Beyond the paper: models at 2, 4, ... 40 m/s; above v0 the PID fades as (v0/v)^2.",
    )

    def init(self, vehicle: Vehicle, dt: float) -> MpcPidState:
        """Build the QP for the vehicle's nominal parameters."""
        nominal = self.model_error.nominal(vehicle)
        speeds = _GRID if self.scheduled else (self.v0,)
        problems = tuple(self._problem(nominal, dt, v) for v in speeds)
        return MpcPidState(nominal, problems, PidState(), None, 0, 0.0)

    def _problem(self, vehicle: Vehicle, dt: float, v: float) -> MpcProblem:
        return build_problem(
            vehicle,
            dt,
            v0=v,
            horizon=self.horizon,
            q=self.q,
            p=self.p,
            r=self.r,
            rate_limit=self.rate_limit,
            corridor=self.corridor,
        )

    def decide(
        self, state: MpcPidState, observation: Observation
    ) -> tuple[float, Status, MpcPidState]:
        """Normalised steering, unclipped."""
        vehicle, problems, pid, plan, age, angle = state
        v, problem, c_pid = observation.v_x, problems[0], self.c_pid
        if self.scheduled:
            problem = problems[min(max(round(v / _GRID_STEP) - 1, 0), len(problems) - 1)]
            c_pid *= min(1.0, self.v0 / max(v, 1.0)) ** 2
        feedback, pid = self.gains.update(pid, observation.lateral_error, problem.dt)
        solved = problem.solve(observation, angle)
        if solved is not None:
            plan, age, status = solved, 0, Status.SOLVED
        else:
            age, status = age + 1, Status.FALLBACK
        usable = plan is not None and age < problem.horizon
        angle = float(plan[age]) if plan is not None and usable else 0.0
        planned = vehicle.steer_for_wheel_angle(angle, v)
        steer = self.c_mpc * planned + c_pid * feedback
        return steer, status, MpcPidState(vehicle, problems, pid, plan, age, angle)
