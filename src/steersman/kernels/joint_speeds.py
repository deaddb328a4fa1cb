"""The speeds of a plan of steering and speed: those it has, those wished, and what grip allows."""

from __future__ import annotations

from steersman.kernels import bend_speed
from steersman.kernels.compiled import kernel
from steersman.types import FloatArray


@kernel
def speeds_of(plan: FloatArray, start: float, dt: float, out: FloatArray) -> None:
    """Speeds (N + 1,) [m/s] of a plan (2 N,) from the speed ``start`` on; none is negative."""
    out[0] = start
    for k in range(out.shape[0] - 1):
        out[k + 1] = max(out[k] + dt * plan[2 * k + 1], 0.0)


@kernel
def wished_speeds(
    view: FloatArray,
    spacing: float,
    start: float,
    speeds: FloatArray,
    dt: float,
    faster: float,
    out: FloatArray,
) -> None:
    """Speeds (N,) [m/s] that a plan wishes at the ends of its periods of ``dt`` [s]; out.

    They are those in ``view`` (n,) [m/s], ``spacing`` [m] apart, at the places that the last plan's
    ``speeds`` (N + 1,) [m/s] reach from the place ``start`` [m] on, and ``faster`` [m/s] more.
    """
    total, j, last = 0.0, 0, view.shape[0] - 1
    for k in range(out.shape[0]):
        total += speeds[k]
        place = start + total * dt
        while j < last and place >= (j + 1) * spacing:
            j += 1
        slope = (view[min(j + 1, last)] - view[j]) / ((j + 1) * spacing - j * spacing)
        out[k] = slope * max(place - j * spacing, 0.0) + view[j] + faster


@kernel
def bound_speeds(  # noqa: PLR0917 - numba takes no keyword-only arguments
    road: FloatArray,
    view: FloatArray,
    spacing: float,
    start: float,
    speeds: FloatArray,
    dt: float,
    grip: float,
    used: float,
    braking: float,
    shares: tuple[float, float],
    low: FloatArray,
    high: FloatArray,
    caps: FloatArray,
) -> None:
    """What grip allows of a plan's accelerations and speeds.

    Args:
        road: (N + 1,) curvature in each period [1/m].
        view: curvatures of the road in view, ``spacing`` [m] apart [1/m].
        spacing: distance of two.
        start: place along the view at which the plan begins [m].
        speeds: (N + 1,) of the last plan [m/s].
        dt: control period [s].
        grip: friction times gravity [m/s^2].
        used: share of it for bends.
        braking: share of it for braking before them, and for speeding up.
        shares: of the grip, for driving and for braking.
        low: (2 N,) least inputs, of which the accelerations are filled [m/s^2]; out.
        high: (2 N,) largest ones; out.
        caps: (N,) largest speeds at the periods' ends [m/s], or what the hardest braking reaches
            where that is more; the last one brakes in time for all bends in view; out.
    """
    slowest, way = speeds[0], start
    for k in range(caps.shape[0]):
        least, most = bend_speed.for_pedals(grip, braking * grip, shares, speeds[k], road[k])
        low[2 * k + 1], high[2 * k + 1] = least, most
        slowest = max(slowest + least * dt, 0.0)
        way += 0.5 * (speeds[k] + speeds[k + 1]) * dt
        cap = bend_speed.bend_speed(used * grip, road[k + 1])
        if k == caps.shape[0] - 1:
            far = bend_speed.approach_speed(view, spacing, way, used * grip, braking * grip)
            cap = min(cap, far)
        caps[k] = max(cap, slowest)
