"""Drives and what is kept of them; the paper's table (circle) and its figure of robustness."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path as FilePath
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

import steersman as sm
from ddpg_mpc_pid.plan import FULL_METHOD, METHODS, Plan
from ddpg_mpc_pid.results import (
    CircleTest,
    DriveFigures,
    ErrorSeries,
    PaperFigures,
    RobustnessResult,
    SeedDrives,
    StudyDrive,
    WaypointErrors,
)
from ddpg_mpc_pid.trainings import policies

MPC_PID = {"kind": "mpc_pid"}
SCHEDULED = {"kind": "mpc_pid", "scheduled": True}
CIRCLE = {"kind": "circle", "radius": 50.0}
# Throttle of the drives with waypoint errors, and points of their drawn errors.
SHIFTED = 0.5
_POINTS = 300


def policy(file: Any) -> dict[str, Any]:
    """The controller that drives a policy."""
    return {"kind": "policy", "file": str(file)}


def throttle(at: float) -> dict[str, Any]:
    """Constant throttle."""
    return {"kind": "constant_throttle", "throttle": at}


def drive(controller: Mapping[str, Any], **words: Any) -> sm.Episode:
    """The episode of a run; what was driven until then, if the controller failed."""
    return sm.attempt({"controller": dict(controller), **words}).of_controller()


def kept(episode: sm.Episode) -> StudyDrive:
    """The few figures of a drive that the tables show."""
    m = sm.summarise(episode)
    return StudyDrive(
        ale_mm=_mm(m["mean_abs_lateral_error_m"]),
        steady_ale_mm=_mm(m["steady"]["mean_abs_lateral_error_m"]),
        max_mm=_mm(m["max_abs_lateral_error_m"]),
        aoe_deg=m["mean_abs_heading_error_deg"],
        steady_aoe_deg=m["steady"]["mean_abs_heading_error_deg"],
        course_deg=m["mean_abs_course_error_deg"],
        steer_std=m["steer_std"],
        steady_steer_std=m["steady"]["steer_std"],
        speed=m["mean_speed_m_s"],
        steady_speed=m["steady"]["mean_speed_m_s"],
        seconds=m["duration_s"],
        distance=m["distance_m"],
        end=episode.end,
        completed=episode.completed,
    )


def _mm(value: float | None) -> float | None:
    return None if value is None else 1e3 * value


def _badness(row: StudyDrive) -> tuple[bool, float]:
    """Runs that ended early last, the others by their error."""
    return not row.completed, row.ale_mm or math.inf


def over_seeds(rows: Sequence[StudyDrive]) -> SeedDrives:
    """Median and worst of every figure over the seeds, and how many drives were completed."""
    if not rows:
        return SeedDrives(seeds=0, completed=0)
    median = {}
    for name in DriveFigures.model_fields:
        values = [value for row in rows if (value := getattr(row, name)) is not None]
        median[name] = float(np.median(values)) if values else None
    return SeedDrives(
        seeds=len(rows),
        completed=sum(row.completed for row in rows),
        median=DriveFigures(**median),
        worst=max(rows, key=_badness),
    )


def median_seed(rows: Mapping[int, StudyDrive]) -> int:
    """The seed whose mean error is the (lower) median; runs that ended early come last."""
    order = sorted(rows, key=lambda seed: _badness(rows[seed]))
    return order[(len(order) - 1) // 2]


def thinned(values: ArrayLike, points: int, digits: int) -> list[float]:
    """Every n-th value, about so many, rounded to so many decimals."""
    series = np.asarray(values)
    step = max(math.ceil(len(series) / points), 1)
    return [round(float(v), digits) for v in series[::step]]


def steady_heading_error(speed: float, radius: float = 50.0) -> float | None:
    """|heading error| [deg] of the steady turn without any lateral error; None if there is none.

    The course error is zero there, so the heading error is the side-slip.
    """
    motion = sm.VehicleMotion(sm.RunConfig().vehicle)
    if not motion.steady_turn(speed, 1.0 / radius):
        return None
    forward, left = motion.velocity
    return math.degrees(abs(math.atan2(left, forward)))


def circle_tests() -> dict[str, tuple[dict[str, Any], PaperFigures]]:
    """The paper's throttles, then equal speeds: the demand, and the paper's figures."""
    throttles, speeds = {}, {}
    for throttle_, *figures, speed in sm.PAPER_CIRCLE:
        paper = PaperFigures(**dict(zip(PaperFigures.model_fields, figures, strict=True)))
        throttles[f"throttle {throttle_}"] = (throttle(throttle_), paper)
        speeds[f"{speed} m/s"] = ({"kind": "constant_speed", "speed": speed}, paper)
    return throttles | speeds


def circle(plan: Plan, runs: FilePath, test: str) -> CircleTest:
    """Every method's policies and MPC-PID in one of the tests."""
    demand, paper = circle_tests()[test]
    drivers: dict[str, list[dict[str, Any]]] = {
        METHODS[name].label: [policy(file) for file in files.values()]
        for name, files in policies(plan, runs, plan.methods).items()
    }
    drivers |= {"MPC-PID": [MPC_PID], "MPC-PID, a model for each speed": [SCHEDULED]}
    words = {"path": CIRCLE, "speed": demand, "duration": plan.circle_seconds}
    rows = {}
    for driver, controllers in drivers.items():
        found = over_seeds([kept(drive(controller, **words)) for controller in controllers])
        reached = found.median.steady_speed
        least = steady_heading_error(reached) if reached else None
        rows[driver] = found.model_copy(update={"least_aoe_deg": least})
    return CircleTest(test=test, paper=paper, drivers=rows)


class ErrorDrives(sm.StoredResult):
    """The full method's agents and MPC-PID with one range of waypoint errors."""

    agent: SeedDrives
    mpc_pid: StudyDrive
    series: ErrorSeries | None
    """Of the median seed."""


def waypoint_errors(plan: Plan, runs: FilePath, redraw: bool, reach: float) -> ErrorDrives:
    """On the circle, waypoints shifted anew at every step or, without ``redraw``, once."""
    words = {
        "path": CIRCLE,
        "speed": throttle(SHIFTED),
        "duration": plan.circle_seconds,
        "sensor": {"kind": "waypoints", "error_range": reach, "redraw": redraw},
    }
    agents = policies(plan, runs, [FULL_METHOD])[FULL_METHOD]
    episodes = {seed: drive(policy(file), **words) for seed, file in agents.items()}
    rows = {seed: kept(episode) for seed, episode in episodes.items()}
    series = None
    if rows:
        episode = episodes[median_seed(rows)]
        series = ErrorSeries(
            range=reach,
            time=thinned(episode["time"], _POINTS, 2),
            lateral_mm=thinned(1e3 * episode["lateral_error"], _POINTS, 1),
            heading_deg=thinned(np.degrees(episode["heading_error"]), _POINTS, 2),
        )
    agent, mpc_pid = over_seeds(list(rows.values())), kept(drive(MPC_PID, **words))
    return ErrorDrives(agent=agent, mpc_pid=mpc_pid, series=series)


def robustness(
    plan: Plan, every_step: Sequence[ErrorDrives], once: Sequence[ErrorDrives]
) -> RobustnessResult:
    """The paper's figure of robustness, from the drives with each range."""
    every, single = (
        WaypointErrors(agent=[one.agent for one in found], mpc_pid=[one.mpc_pid for one in found])
        for found in (every_step, once)
    )
    return RobustnessResult(
        throttle=SHIFTED,
        ranges=list(plan.error_ranges),
        every_step=every,
        once=single,
        series=[one.series for one in every_step if one.series is not None],
    )
