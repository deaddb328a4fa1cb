"""MPC alone: the MPC of MPC-PID, against stacked least squares on the same model."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm

from steersman.controllers.condensed_qp import MpcProblem
from steersman.controllers.mpc_pid import Mpc, MpcPid
from steersman.controllers.single_track import single_track
from steersman.paths.analytic import Circle, Straight
from steersman.speed import ConstantSpeed
from steersman.types import Status

from ..loops import CAR, DT, Posed, answers, beside, drive, observe, scenes


@pytest.mark.parametrize("settings", [{}, {"rate_limit": True}, {"scheduled": True}])
def test_is_mpc_pid_without_pid(settings: dict[str, bool]) -> None:
    alone, both = Mpc(**settings), MpcPid(c_mpc=1.0, c_pid=0.0, **settings)
    for path in (Posed(), Posed(side=-1.0)):
        assert answers(alone, scenes(path)) == answers(both, scenes(path))


def test_without_active_limits_it_is_least_squares() -> None:
    """Rows sqrt(q) (y_i - y_ref,i) and sqrt(r) delta_i, with y simulated step by step."""
    n, v, d = 20, 30.0 / 3.6, 0.1
    controller = Mpc(horizon=n, q=2.0, p=3.0, r=0.1)
    car = beside(Straight(), 5.0, d=d, velocity=(v, 0.2), yaw_rate=0.05)
    steer = controller.step(controller.init(CAR, DT), observe(Straight(), car, 5.0))[0].steer
    a, b = single_track(CAR, v)
    block = np.zeros((5, 5))
    block[:4, :4], block[:4, 4:] = a, b
    exact = expm(block * DT)

    def lateral(start: list[float], inputs: np.ndarray) -> np.ndarray:
        state, out = np.array([*start, 0.0]), []
        for u in inputs:
            state[4] = u
            state = exact @ state
            out.append(state[0])
        return np.array(out)

    weights = np.sqrt(np.array([2.0] * (n - 1) + [5.0]))
    columns = [lateral([0.0] * 4, unit) for unit in np.eye(n)]
    rest = lateral([0.0, 0.2 / v, 0.0, 0.05], np.zeros(n)) + d
    rows = np.vstack([weights[:, None] * np.stack(columns, axis=1), np.sqrt(0.1) * np.eye(n)])
    plan = np.linalg.lstsq(rows, np.concatenate([-weights * rest, np.zeros(n)]))[0]
    assert abs(plan).max() < CAR.max_wheel_angle
    assert steer == pytest.approx(CAR.steer_for_wheel_angle(plan[0], v), abs=1e-9)


def test_failing_from_the_start_steers_straight(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(MpcProblem, "solve", lambda *_: None)
    decision = answers(Mpc(), scenes(Posed(), count=1))[0]
    assert decision[:2] == (0.0, Status.FALLBACK)


@pytest.mark.parametrize("v", [8.0, 15.0])
def test_scheduled_holds_the_circle_at_other_speeds(v: float) -> None:
    episode = drive(Mpc(scheduled=True), Circle(), speed=ConstantSpeed(speed=v), duration=10.0)
    assert episode.completed
    assert abs(episode["lateral_error"]).max() < 0.1
