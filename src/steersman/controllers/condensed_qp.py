"""Linear MPC of the single-track model, condensed to a small QP and solved by DAQP.

State [y, beta, psi, psi_dot] at one speed v0 (Rajamani, Vehicle Dynamics and Control, 2nd ed.,
sec. 2.3, with beta = v_y / v), discretised exactly for a steering that is held over a control
period (zero-order hold). Everything is expressed in the vehicle's frame at the present moment,
so y and psi start at zero; x is predicted as v i dt, which steering does not change, so only the
lateral position enters the optimisation.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.linalg import toeplitz

from steersman.controllers.single_track import single_track, zero_order_hold
from steersman.kernels import condensed_qp as kernel
from steersman.types import FloatArray, Observation
from steersman.vehicles import Vehicle


def predict(a: FloatArray, b: FloatArray, horizon: int) -> tuple[FloatArray, FloatArray]:
    """Predict y over the horizon: free response (N, 4) to the state, forced (N, N) to steering."""
    free, impulse, power = np.zeros((horizon, 4)), np.zeros(horizon), np.eye(4)
    for i in range(horizon):
        impulse[i] = (power @ b)[0, 0]
        power = a @ power
        free[i] = power[0]
    return free, toeplitz(impulse, np.zeros(horizon))


class QpSolver:
    """DAQP with a QP set up; a copy is set up anew, since its workspace cannot be copied."""

    def __init__(self, *terms: Any) -> None:
        """Set up ``terms``, as ``daqp.Model.setup`` takes them."""
        import daqp

        self._terms = tuple(np.copy(term) for term in terms)
        model = daqp.Model()
        model.setup(*terms)
        self.update, self.solve = model.update, model.solve

    def __reduce__(self) -> tuple[type[QpSolver], tuple[Any, ...]]:
        return type(self), self._terms


@dataclass(frozen=True, eq=False)
class MpcProblem:
    """The constant part of the QP, and the solver's workspace.

    The solver starts cold at every call, so a plan depends on its observation alone and one
    problem may serve several vehicles in turn.
    """

    horizon: int
    dt: float
    free: FloatArray
    forced: FloatArray
    weight: FloatArray
    hessian: FloatArray
    max_angle: float
    max_step: float | None
    corridor: float | None
    _model: QpSolver
    _upper: FloatArray
    _lower: FloatArray
    _sense: Any
    _f: FloatArray
    _ref: FloatArray

    def solve(self, observation: Observation, last_angle: float) -> FloatArray | None:
        """The optimal wheel angles over the horizon [rad]; None if DAQP does not say "solved".

        ``last_angle`` is the present wheel angle, from which a rate limit counts.
        """
        o = observation
        v = max(o.v_x, 0.5)
        kernel.gradient(
            o.preview,
            o.spacing,
            v * self.dt,
            o.v_y / v,
            o.yaw_rate,
            self.free,
            self.weight,
            self._ref,
            self._f,
        )
        if self.max_step is None and self.corridor is None:
            self._model.update(f=self._f, sense=self._sense)
        else:
            self._limits(last_angle)
            self._model.update(f=self._f, bupper=self._upper, blower=self._lower, sense=self._sense)
        plan: FloatArray
        plan, _, flag, _ = self._model.solve()
        if flag not in (1, 2) or not kernel.all_finite(plan):
            return None
        return plan

    def turn(self, observation: Observation) -> FloatArray:
        """The wheel angles [rad] of the shortest turn towards the road's direction."""
        return np.full(self.horizon, -math.copysign(self.max_angle, observation.heading_error))

    def _limits(self, last_angle: float) -> None:
        n, row = self.horizon, self.horizon
        if self.max_step is not None:
            self._upper[row : row + n], self._lower[row : row + n] = self.max_step, -self.max_step
            self._upper[row] += last_angle
            self._lower[row] += last_angle
            row += n
        if self.corridor is not None:
            # self._ref holds the free response minus the reference.
            self._upper[row : row + n] = self.corridor - self._ref
            self._lower[row : row + n] = -self.corridor - self._ref


def build_problem(  # noqa: PLR0913 - one argument for each term of the optimisation
    vehicle: Vehicle,
    dt: float,
    *,
    v0: float,
    horizon: int,
    q: float,
    p: float,
    r: float,
    rate_limit: bool = False,
    corridor: float | None = None,
) -> MpcProblem:
    """Condense the optimisation at speed ``v0`` for a vehicle's nominal parameters.

    Args:
        vehicle: nominal parameters.
        dt: control period [s].
        v0: speed of the model [m/s].
        horizon: steps N.
        q: weight of the squared lateral position error at each step [1/m^2].
        p: additional weight at the last step [1/m^2].
        r: weight of the squared wheel angle [1/rad^2].
        rate_limit: keep the vehicle's steering rate.
        corridor: half width that the prediction should keep, as a soft constraint [m].
    """
    free, forced = predict(*zero_order_hold(*single_track(vehicle, v0), dt), horizon)
    weights = np.full(horizon, q)
    weights[-1] += p
    hessian = forced.T @ (weights[:, None] * forced) + r * np.eye(horizon)
    rows = []
    max_angle = vehicle.max_wheel_angle
    if rate_limit:
        rows.append(np.eye(horizon) - np.eye(horizon, k=-1))
    if corridor is not None:
        rows.append(forced)
    matrix = np.vstack(rows) if rows else np.zeros((0, horizon))
    count = horizon + len(matrix)
    upper = np.full(count, max_angle)
    sense = np.zeros(count, dtype=np.int32)
    if corridor is not None:
        sense[-horizon:] = 8
    # Soft constraints need their own memory in the workspace, so DAQP has to know them now.
    model = QpSolver(hessian, np.zeros(horizon), matrix, upper, -upper, sense)
    return MpcProblem(
        horizon,
        dt,
        np.ascontiguousarray(free[:, [1, 3]]),
        forced,
        np.ascontiguousarray(forced.T * weights),
        hessian,
        max_angle,
        vehicle.steer_rate_up * vehicle.max_wheel_angle * dt if rate_limit else None,
        corridor,
        model,
        upper,
        -upper,
        sense,
        np.zeros(horizon),
        np.zeros(horizon),
    )
