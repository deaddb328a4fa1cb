"""Dead reckoning: the present observation from the last one and the steering since.

The car is the nonlinear single track of ``mpc_delay`` with linear tyres, at the speed that was
measured last; the road is that of the last waypoints.
"""

from __future__ import annotations

import math

import numpy as np

from steersman.controllers.mpc_delay_plan import pose
from steersman.controllers.single_track import steady_wheel_angle
from steersman.kernels import mpc_delay as kernel
from steersman.kernels import road_smoother
from steersman.kernels.grip import NO_LIMIT
from steersman.kernels.observe import O_PREVIEW
from steersman.kernels.predict import seen_from
from steersman.kernels.preview import curvature_at
from steersman.sensing import to_observation
from steersman.types import FloatArray, Observation
from steersman.vehicles import Vehicle

# Rate at which the steering goes to the middle while there is no road [1/s].
STRAIGHTEN = 0.5
# A car that is slower is taken to stand, as the model has no meaning there [m/s].
_STANDING = 0.5
_NOTHING = np.zeros(2)


def quiet(seen: Observation) -> FloatArray:
    """Its waypoints, smoothed as far as their third differences are more than a road's [m].

    While no new observation arrives their errors stay the same, and a filter over time would take
    them for the road. Exact waypoints hardly change.
    """
    points = np.ascontiguousarray(seen.preview)
    noise = road_smoother.roughness(points)
    if not 0.0 < noise < math.inf:
        return points
    out, factor = np.empty_like(points), np.empty((len(points), len(points)))
    road_smoother.smooth_points(points, seen.spacing, noise, factor, out)
    return out if np.isfinite(out).all() else points


def moved_on(
    vehicle: Vehicle, seen: Observation, motion: FloatArray | None, steer: float, dt: float
) -> FloatArray:
    """Where the car is one period later: the kernel's motion since ``seen``.

    Args:
        vehicle: nominal parameters.
        seen: the last usable observation.
        motion: where it was until now; None: at ``seen``.
        steer: the steering executed meanwhile [normalised].
        dt: control period [s].
    """
    after = pose(seen) if motion is None else motion.copy()
    if abs(seen.v_x) > _STANDING:
        work = np.empty((2, kernel.N_MOTION))
        road = (seen.preview, seen.spacing, seen.curvature)
        kernel.hold(vehicle.table, seen.v_x, *road, _NOTHING, NO_LIMIT, steer, dt, after, work)
    return after


def reckoned(seen: Observation, motion: FloatArray, time: float) -> Observation | None:
    """The observation of a car with this motion since ``seen``; None beyond its waypoints."""
    way = float(motion[kernel.WAY])
    if not (np.isfinite(motion).all() and 0.0 <= way <= (len(seen.preview) - 1) * seen.spacing):
        return None
    road = seen.preview, seen.spacing
    row = np.empty(O_PREVIEW + seen.preview.size)
    seen_from(*road, seen.curvature, motion, seen.v_x, row)
    return to_observation(row, time, seen.spacing)


def warm_up_kernels(vehicle: Vehicle, dt: float) -> None:
    """Reckon once without effect, so that no kernel is compiled or loaded when it is needed."""
    ahead = np.array([[float(i), 1e-3 * i**3] for i in range(5)])
    seen = Observation(0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, ahead, 1.0)
    motion = moved_on(vehicle, seen._replace(preview=quiet(seen)), None, 0.0, dt)
    held(vehicle, reckoned(seen, motion, dt), 0.0, dt)


def held(vehicle: Vehicle, seen: Observation | None, last: float, dt: float) -> float:
    """Steering without a controller: the last one, changed as the road's bend changes in a period.

    Without a road it goes to the middle.
    """
    if seen is None:
        return math.copysign(max(abs(last) - STRAIGHTEN * dt, 0.0), last)
    v = seen.v_x
    ahead = curvature_at(seen.preview, seen.spacing, seen.curvature, max(v, 0.0) * dt)
    here, there = (
        vehicle.steer_for_wheel_angle(steady_wheel_angle(vehicle, v, kappa), v)
        for kappa in (seen.curvature, ahead)
    )
    return last + there - here
