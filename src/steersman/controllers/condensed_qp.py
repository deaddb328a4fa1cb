"""Linear MPC of the single-track model, condensed to a small QP.

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

from steersman.controllers.quadratic import within
from steersman.controllers.single_track import single_track, zero_order_hold
from steersman.kernels import active_set
from steersman.kernels import condensed_qp as kernel
from steersman.types import FloatArray, Observation
from steersman.vehicles import Vehicle


def predict(a: FloatArray, b: FloatArray, horizon: int) -> tuple[FloatArray, FloatArray]:
    """Predict y over the horizon: free response (N, 4) to the state, forced (N, N) to steering."""
    free, forced = np.zeros((horizon, 4)), np.zeros((horizon, horizon))
    kernel.respond(a, b, free, forced, np.empty((2, 4, 4)))
    return free, forced


# DAQP's kind of a soft constraint, and its exit flags for "solved".
_SOFT, _SOLVED = 8, (1, 2)


class QpSolver:
    """DAQP with a QP set up; a copy is set up anew, since its workspace cannot be copied."""

    def __init__(self, *terms: Any) -> None:
        """Set up ``terms``, as ``daqp.Model.setup`` takes them; the last one has the kinds."""
        import daqp

        self._terms = tuple(np.copy(term) for term in terms)
        self.model = daqp.Model()
        # Soft constraints need their own memory in the workspace, so DAQP has to know them now.
        self.model.setup(*terms)

    def __reduce__(self) -> tuple[type[QpSolver], tuple[Any, ...]]:
        return type(self), self._terms

    def optimum(
        self, linear: FloatArray, lower: FloatArray, upper: FloatArray
    ) -> FloatArray | None:
        """The solution with another linear term and other limits; None if DAQP finds none."""
        self.model.update(f=linear, bupper=upper, blower=lower, sense=self._terms[-1].copy())
        plan, _, flag, _ = self.model.solve()
        return plan if flag in _SOLVED and kernel.all_finite(plan) else None


@dataclass(frozen=True, eq=False)
class MpcProblem:
    """The constant part of the QP.

    The solver starts cold at every call, so a plan depends on its observation alone and one
    problem may serve several vehicles in turn.
    """

    horizon: int
    dt: float
    free: FloatArray
    forced: FloatArray
    weight: FloatArray
    """(N, N) what the linear term is of the free response less the reference."""
    gain: FloatArray
    """(N, N) and so the optimum without limits [rad/m].

    Neither sum nor number in it is large, so that a plan by it keeps the digits of its observation
    that the linear term, with the inverse of an ill-conditioned Hessian, loses in float.
    """
    hessian: FloatArray
    max_angle: float
    max_step: float | None
    corridor: float | None
    inverse: FloatArray
    """Of ``active_set.inverse_root`` of the Hessian."""
    rows: FloatArray
    lower: FloatArray
    upper: FloatArray
    soft: QpSolver | None
    """DAQP with soft limits, where there is a corridor."""

    def solve(self, observation: Observation, last_angle: float) -> FloatArray | None:
        """The optimal wheel angles over the horizon [rad]; None if there are none.

        ``last_angle`` is the present wheel angle, from which a rate limit counts.
        """
        plan, ref = self._times(self.weight if self.soft is not None else self.gain, observation)
        lower, upper = self.lower, self.upper
        if self.max_step is not None or self.corridor is not None:
            lower, upper = self._limits(last_angle, ref)
        if self.soft is not None:
            return self.soft.optimum(plan, lower, upper)
        return within(self.inverse, plan, self.rows, lower, upper)

    def terms(self, observation: Observation) -> tuple[FloatArray, FloatArray]:
        """The linear term (N,), and the free response minus the reference (N,) [m]."""
        return self._times(self.weight, observation)

    def _times(self, matrix: FloatArray, observation: Observation) -> tuple[FloatArray, FloatArray]:
        """A matrix times the free response minus the reference, and that itself."""
        o, v = observation, max(observation.v_x, 0.5)
        ref, out = np.empty(self.horizon), np.empty(self.horizon)
        kernel.gradient(
            o.preview, o.spacing, v * self.dt, o.v_y / v, o.yaw_rate, self.free, matrix, ref, out,
        )  # fmt: skip
        return out, ref

    def turn(self, observation: Observation) -> FloatArray:
        """The wheel angles [rad] of the shortest turn towards the road's direction."""
        return np.full(self.horizon, -math.copysign(self.max_angle, observation.heading_error))

    def _limits(self, last_angle: float, ref: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Lower and upper limits; ``ref`` holds the free response minus the reference."""
        n, row = self.horizon, self.horizon
        lower, upper = self.lower.copy(), self.upper.copy()
        if self.max_step is not None:
            upper[row : row + n], lower[row : row + n] = self.max_step, -self.max_step
            upper[row] += last_angle
            lower[row] += last_angle
            row += n
        if self.corridor is not None:
            upper[row : row + n] = self.corridor - ref
            lower[row : row + n] = -self.corridor - ref
        return lower, upper


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
    weight = forced.T * weights
    hessian = weight @ forced + r * np.eye(horizon)
    matrix = _changes(horizon, rate_limit)
    if corridor is not None:
        matrix = np.vstack([matrix, forced])
    lower, upper = _bounds(horizon + len(matrix), vehicle.max_wheel_angle)
    inverse = np.empty_like(hessian)
    if not active_set.inverse_root(hessian, inverse):
        raise np.linalg.LinAlgError("the Hessian is not positive definite")
    return MpcProblem(
        horizon,
        dt,
        np.ascontiguousarray(free[:, 1::2]),
        forced,
        np.ascontiguousarray(weight),
        -(inverse @ (inverse.T @ weight)),
        hessian,
        vehicle.max_wheel_angle,
        vehicle.steer_rate_up * vehicle.max_wheel_angle * dt if rate_limit else None,
        corridor,
        inverse,
        matrix,
        lower,
        upper,
        None if corridor is None else _soft(hessian, matrix, upper),
    )


def _changes(horizon: int, rate_limit: bool) -> FloatArray:
    """Rows (N, N) that give the changes of the wheel angle, or none (0, N)."""
    return (np.eye(horizon) - np.eye(horizon, k=-1))[: horizon if rate_limit else 0]


def _bounds(count: int, most: float) -> tuple[FloatArray, FloatArray]:
    """Lower and upper limits (count,) of so many numbers."""
    return np.full(count, -most), np.full(count, most)


def _soft(hessian: FloatArray, matrix: FloatArray, upper: FloatArray) -> QpSolver:
    """The program with its last N rows as soft limits."""
    n = len(hessian)
    sense = np.zeros(len(upper), dtype=np.int32)
    sense[-n:] = _SOFT
    return QpSolver(hessian, np.zeros(n), matrix, upper, -upper, sense)
