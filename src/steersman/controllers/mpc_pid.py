"""MPC-PID, the baseline and demonstrator: a linear MPC's plan plus PID feedback."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar, NamedTuple

from steersman.config import param, register
from steersman.controllers.base import within_limits
from steersman.controllers.condensed_qp import MpcProblem
from steersman.controllers.linear_mpc import LinearMpc, ModelError, MpcState
from steersman.controllers.pid import PidGains, PidState
from steersman.types import FloatArray, Observation, Status
from steersman.vehicles import Vehicle

__all__ = ["ModelError", "MpcPid", "MpcPidState"]


class MpcPidState(NamedTuple):
    """What MPC-PID carries from step to step: the fields of MpcState, and the PID's state."""

    vehicle: Vehicle
    problems: tuple[MpcProblem, ...]
    pid: PidState
    plan: FloatArray | None
    age: int
    angle: float
    steer: float = 0.0
    v_x: float = 0.0


@register("controller", "mpc_pid")
class MpcPid(LinearMpc):
    """u = c_mpc u_MPC + c_pid u_PID: a linear MPC at one tuned speed, corrected by a PID.

    If DAQP does not solve, the last plan shifted by one step per failure stands in for u_MPC;
    when that is used up, the PID drives alone. Either is marked as a fallback. When
    ``scheduled``, the PID fades above v0 as (v0 / v)^2.
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

    def init(self, vehicle: Vehicle, dt: float) -> MpcPidState:
        """Build the QP for the vehicle's nominal parameters."""
        return _joined(self.first_plan(vehicle, dt), PidState())

    def decide(
        self, state: MpcPidState, observation: Observation
    ) -> tuple[float, Status, MpcPidState]:
        """Normalised steering, unclipped."""
        vehicle, problems, pid, plan, age, angle = state[:6]
        v, c_pid = observation.v_x, self.c_pid
        if self.scheduled:
            c_pid *= min(1.0, self.v0 / max(v, 1.0)) ** 2
        feedback, pid = self.gains.update(pid, observation.lateral_error, problems[0].dt)
        mpc = MpcState(vehicle, problems, plan, age, angle)
        status, mpc = self.next_plan(mpc, observation)
        planned = vehicle.steer_for_wheel_angle(mpc.angle, v)
        steer = self.c_mpc * planned + c_pid * feedback
        return steer, status, _joined(mpc._replace(steer=within_limits(steer), v_x=v), pid)

    def share(self) -> float:
        """Factor on the MPC's steering in the command."""
        return self.c_mpc


def _joined(mpc: MpcState, pid: PidState) -> MpcPidState:
    vehicle, problems, plan, age, angle, steer, v_x = mpc
    return MpcPidState(vehicle, problems, pid, plan, age, angle, steer, v_x)
