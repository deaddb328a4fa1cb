"""The linear MPC as a controller: what MPC alone and MPC-PID have in common, and MPC alone."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar, NamedTuple

from steersman.config import Settings, param, register
from steersman.controllers.base import ControllerComponent, within_limits
from steersman.controllers.condensed_qp import MpcProblem, build_problem
from steersman.kernels.mpc_delay import wheel_angle
from steersman.types import FloatArray, Observation, Status
from steersman.vehicles import Vehicle

# Speeds of the scheduled models [m/s].
_GRID_STEP = 2.0
_GRID = tuple(_GRID_STEP * (i + 1) for i in range(20))


class ModelError(Settings):
    """Factors on the vehicle's true parameters that give the controller's nominal ones."""

    mass: float = param(1.0, "-", "Nominal mass over true mass.", gt=0)
    yaw_inertia: float = param(1.0, "-", "Nominal yaw inertia over the true one.", gt=0)
    c_f: float = param(1.0, "-", "Nominal front cornering stiffness over the true one.", gt=0)
    c_r: float = param(1.0, "-", "Nominal rear cornering stiffness over the true one.", gt=0)

    def nominal(self, vehicle: Vehicle) -> Vehicle:
        """The nominal vehicle that the controller computes with."""
        return vehicle.replace(
            mass=vehicle.mass * self.mass,
            yaw_inertia=vehicle.yaw_inertia * self.yaw_inertia,
            c_f=vehicle.c_f * self.c_f,
            c_r=vehicle.c_r * self.c_r,
        )


class MpcState(NamedTuple):
    """What the linear MPC carries from step to step."""

    vehicle: Vehicle
    problems: tuple[MpcProblem, ...]
    """One for the tuned speed, or one for each speed of the grid."""
    plan: FloatArray | None
    """Last plan of wheel angles that DAQP solved [rad], and how many steps ago that was."""
    age: int
    angle: float
    """The MPC's last wheel angle [rad]."""
    steer: float = 0.0
    """Normalised steering that came of it."""
    v_x: float = 0.0
    """Speed at that moment [m/s]."""


class LinearMpc(ControllerComponent):
    """The fields of a linear MPC, and one step of it.

    If DAQP does not solve, the last plan shifted by one step per failure stands in; when that is
    used up, the wheels point straight ahead. Either is marked as a fallback.
    """

    horizon: int = param(20, "-", "Steps of the MPC, one control period each.", ge=2, le=200)
    v0: float = param(30.0 / 3.6, "m/s", "Speed of the linear model.", gt=0)
    q: float = param(1.0, "1/m^2", "Weight of the squared lateral error.", gt=0)
    p: float = param(35.6, "1/m^2", "Additional weight at the end of the horizon.", ge=0)
    r: float = param(0.0325, "1/rad^2", "Weight of the squared wheel angle.", gt=0)
    rate_limit: bool = param(False, "-", "Keep the steering rate limit in the plan.")
    corridor: float | None = param(
        None, "m", "Soft limit of the predicted lateral error; null: none.", gt=0
    )
    model_error: ModelError = param(ModelError(), "-", "How wrong the model's parameters are.")
    scheduled: bool = param(False, "-", "Beyond the paper: models at 2, 4, ... 40 m/s.")

    def first_plan(self, vehicle: Vehicle, dt: float) -> MpcState:
        """Build the QP for the vehicle's nominal parameters; there is no plan yet."""
        nominal = self.model_error.nominal(vehicle)
        speeds = _GRID if self.scheduled else (self.v0,)
        problems = tuple(self._problem(nominal, dt, v) for v in speeds)
        return MpcState(nominal, problems, None, 0, 0.0)

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

    def next_plan(self, state: MpcState, observation: Observation) -> tuple[Status, MpcState]:
        """Plan anew, or shift the last plan; the new state's ``angle`` is the MPC's wheel angle."""
        vehicle, problems, plan, age, angle = state[:5]
        problem = problems[0]
        if self.scheduled:
            near = round(observation.v_x / _GRID_STEP) - 1
            problem = problems[min(max(near, 0), len(problems) - 1)]
        solved = problem.solve(observation, angle)
        if solved is not None:
            plan, age, status = solved, 0, Status.SOLVED
        else:
            age, status = age + 1, Status.FALLBACK
        usable = plan is not None and age < problem.horizon
        angle = float(plan[age]) if plan is not None and usable else 0.0
        return status, MpcState(vehicle, problems, plan, age, angle)

    def executed(self, state: Any, steer: float) -> Any:
        """The rate limit counts from what was executed; see :meth:`share`."""
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


@register("controller", "mpc")
class Mpc(LinearMpc):
    """The linear MPC of MPC-PID without its PID."""

    search: ClassVar[Mapping[str, tuple[float, float, bool]]] = {
        "p": (1e-2, 100.0, True),
        "r": (1e-4, 1e3, True),
    }

    def init(self, vehicle: Vehicle, dt: float) -> MpcState:
        """State before the first step."""
        return self.first_plan(vehicle, dt)

    def decide(self, state: MpcState, observation: Observation) -> tuple[float, Status, MpcState]:
        """Normalised steering, unclipped."""
        status, state = self.next_plan(state, observation)
        steer = state.vehicle.steer_for_wheel_angle(state.angle, observation.v_x)
        return steer, status, state._replace(steer=within_limits(steer), v_x=observation.v_x)
