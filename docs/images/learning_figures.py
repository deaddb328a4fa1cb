"""Figures of paths, sensing, speed, rewards and schedules."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from closed_loops import CAR

from steersman.config import resolve
from steersman.kernels import reward as kernel
from steersman.kernels import speed as speeds
from steersman.learning.schedules import Cyclical, HoldThenDecay, Linear
from steersman.learning.task import PaperTask, PreciseTask, TaskComponent
from steersman.profiles import stack_profiles
from steersman.sensing import WaypointSensor, track
from steersman.speed import ConstantSpeed
from steersman.types import Pose


def waypoints() -> dict[str, Any]:
    """Shifted waypoints, and the road that they tell."""
    from steersman.paths.analytic import Circle
    from steersman.plants.simulator import SimulatorConfig

    path, rng = Circle(), np.random.default_rng(4)
    plant = SimulatorConfig().make(CAR)
    at = path.at(10.0)
    state = plant.reset(Pose(at.x, at.y, at.psi), 8.0, at.curvature)
    place = track(state, path, 10.0)
    true = WaypointSensor().observe(None, state, place, path, rng)
    sensor = WaypointSensor(error_range=0.3)
    seen = sensor.observe(None, state, place, path, rng)
    u = np.linspace(0.0, 28.0, 57)
    # The road as lateral error, heading error and curvature of the observation tell it.
    d, heading = -seen.lateral_error, -seen.heading_error
    told = d + math.tan(heading) * u + 0.5 * seen.curvature * u * u
    lines = [
        {"name": "the road's waypoints", "x": true.preview[:, 0], "y": true.preview[:, 1]},
        {
            "name": "shifted by up to 0.3 m",
            "x": seen.preview[:, 0],
            "y": seen.preview[:, 1],
            "dots": 3.5,
        },
        {"name": "the road that the errors tell", "x": u, "y": told},
    ]
    title = "Waypoint errors on the circle of 50 m, in the vehicle's frame"
    return {"title": title, "x": "x, ahead [m]", "y": "y, left [m]", "lines": lines}


def curvatures() -> dict[str, Any]:
    """Curvature over arc length of roads of the library."""
    lines = []
    for name, fields in (
        ("figure_eight", {"kind": "figure_eight"}),
        ("double_lane_change", {"kind": "double_lane_change"}),
        ("random_road, seed 3", {"kind": "random_road", "seed": 3}),
    ):
        path: Any = resolve("path", fields)
        where = np.arange(0.0, min(path.length, 300.0), 0.5)
        values = [path.at(s).curvature for s in where]
        lines.append({"name": name, "x": where, "y": values})
    title = "Curvature of roads, left positive"
    return {"title": title, "x": "arc length [m]", "y": "curvature [1/m]", "lines": lines}


def fine_error() -> dict[str, Any]:
    """A feature that stays sensitive near zero."""
    d = np.linspace(-0.5, 0.5, 201)
    lines = [
        {"name": "d [m]", "x": d, "y": d},
        {"name": "d / (d_0 + |d|), d_0 = 50 mm", "x": d, "y": d / (0.05 + np.abs(d))},
    ]
    title = "Lateral error as two features"
    return {"title": title, "x": "lateral error [m]", "y": "feature", "lines": lines}


def speed_cap() -> dict[str, Any]:
    """The speed that the bends ahead allow."""
    path: Any = resolve("path", "training_circuit")
    lines = []
    for limit in (3.0, 6.0):
        table = stack_profiles([ConstantSpeed(speed=25.0, a_lat_max=limit).profile()], [path])
        where = np.arange(0.0, path.length, 3.0)
        values = [speeds.target_speed(table, 0, path.table, 0, 0.0, s) for s in where]
        lines.append({"name": f"a_lat_max = {limit:.0f} m/s^2", "x": where, "y": values})
    title = "Speed on the training circuit: 25 m/s, capped by the road ahead"
    return {"title": title, "x": "arc length [m]", "y": "target [m/s]", "lines": lines}


def _judged(task: TaskComponent, speed: float, error: float, course: float = 0.0) -> Any:
    """Reward, r_track, c_track and c_diff of a step 0.1 off the demonstrated steering."""
    step, out = np.zeros(kernel.N_JUDGED), np.empty(4)
    step[kernel.SPEED], step[kernel.LATERAL_ERROR] = speed, error
    step[kernel.COURSE_ERROR], step[kernel.DEMONSTRATED_STEER] = course, 0.1
    kernel.judge(task.table(), step, out)
    return out


def track_rewards() -> dict[str, Any]:
    """Both tracking rewards over the error."""
    d = np.linspace(0.0, 0.5, 201)
    lines = []
    for name, task, scale in (
        ("paper, over v", PaperTask(), 10.0),
        ("precise", PreciseTask(), 1.0),
    ):
        values = [_judged(task, 10.0, e)[kernel.R_TRACK] / scale for e in d]
        lines.append({"name": name, "x": d, "y": values})
    title = "Tracking reward at 10 m/s along the road"
    return {"title": title, "x": "|lateral error| [m]", "y": "r_track", "lines": lines}


def adaptive() -> dict[str, Any]:
    """What the adaptive coefficients do."""
    d = np.linspace(0.0, 1.5, 151)
    lines = []
    for speed in (1.0, 5.0, 15.0):
        shares = [_judged(PaperTask(), speed, e, course=0.3)[kernel.C_TRACK] for e in d]
        lines.append({"name": f"to the letter, {speed:.0f} m/s", "x": d, "y": shares})
    normalised = PaperTask(normalise=True)
    shares = [_judged(normalised, 5.0, e, course=0.3)[kernel.C_TRACK] for e in d]
    lines.append({"name": "normalised, 5 m/s", "x": d, "y": shares})
    title = "c_track, course error 0.3 rad, steering 0.1 off the demonstration"
    return {"title": title, "x": "|lateral error| [m]", "y": "c_track", "lines": lines}


def learning_rates() -> dict[str, Any]:
    """Schedules over a training of 200 000 steps."""
    total = 200_000
    steps = np.arange(0, total + 1, 16 * 25)
    cyclical = Cyclical()
    bounds = [cyclical.value(math.floor(s / 32) * 32, total) for s in steps]
    lows = [cyclical.value(math.floor(s / 32) * 32 + 16, total) for s in steps]
    lines = [
        {"name": "cyclical: upper bound of its triangles", "x": steps, "y": bounds},
        {"name": "cyclical: lower bound", "x": steps, "y": lows},
        {
            "name": "hold_then_decay",
            "x": steps,
            "y": [HoldThenDecay().value(s, total) for s in steps],
        },
        {
            "name": "linear, 1e-3 to 0",
            "x": steps,
            "y": [Linear(start=1e-3).value(s, total) for s in steps],
        },
    ]
    title = "Learning rate over 200 000 environment steps"
    return {"title": title, "x": "environment step", "y": "rate", "lines": lines}


FIGURES = {
    "waypoints": waypoints,
    "curvatures": curvatures,
    "fine_error": fine_error,
    "speed_cap": speed_cap,
    "track_rewards": track_rewards,
    "adaptive": adaptive,
    "learning_rates": learning_rates,
}
