"""The suite ``tuning``, on which gains are tuned, and suites on a user's car and road.

It holds every class of disturbance of the test suite at other values, on roads of a generator that
neither tests nor trainings use. Each disturbance is met once, on one of six roads, and each of them
has two drives near its grip; a seventh is driven at up to 60 m/s, an eighth as fast as 0.7 of the
grip allows all along. A trial drives the whole suite.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from steersman.bench.courses import Speeds, changing, constant
from steersman.bench.disturbance import Disturbance, Mixed
from steersman.bench.suite import CLEAN, Course, Suite
from steersman.controllers.model_error import ModelError
from steersman.disturbances import Dropouts, FrictionPatch, PositionDrift, SensorBias
from steersman.kernels.vehicle import GRAVITY
from steersman.paths.base import PathComponent
from steersman.paths.generated import HarmonicRoad
from steersman.speed import SpeedComponent, SpeedProfile, SpeedTracking, StopAndGo
from steersman.vehicles import Vehicle

_ROADS, _LENGTH = 6, 400.0
# Share of a user's car's grip that speeds ask for in bends, and time on a user's road [s].
_USED_GRIP, _SECONDS = 0.6, 40.0
_MIXED = Mixed(
    delay=0.12,
    waypoint_noise=0.12,
    mass=0.18,
    yaw_inertia=0.18,
    stiffness=0.22,
    v_y=0.06,
    yaw_rate=0.006,
    v_x_scale=0.03,
    drift=0.08,
)


def disturbances() -> dict[str, Disturbance]:
    """Every class of the test suite, one thing at a time, at other values."""
    soft, stiff = 0.75, 1.25
    wet, edge = (
        FrictionPatch(begin=15.0, length=20.0, every=50.0, left=left, right=right)
        for left, right in ((0.65, 0.65), (1.0, 0.5))
    )
    return {
        "delay_80ms": Disturbance(delay=0.08),
        "delay_160ms": Disturbance(delay=0.16),
        "noise_0.06m": Disturbance(waypoint_noise=0.06),
        "noise_0.2m": Disturbance(waypoint_noise=0.2),
        "heavy": Disturbance(mass=1.15, yaw_inertia=1.15),
        "light": Disturbance(mass=0.85, yaw_inertia=0.85),
        "stiff": Disturbance(c_f=stiff, c_r=stiff),
        "soft": Disturbance(c_f=soft, c_r=soft),
        "understeer": Disturbance(c_f=soft, c_r=stiff),
        "oversteer": Disturbance(c_f=stiff, c_r=soft),
        "slow_actuator": Disturbance(steer_rate=0.35),
        "bias_0.7deg": Disturbance(steer_bias=math.radians(-0.7)),
        "friction_0.8": Disturbance(friction=0.8, used_grip=0.65, used_along=0.25),
        "friction_0.55": Disturbance(friction=0.55, used_grip=0.65, used_along=0.35),
        "friction_0.8_floored": Disturbance(friction=0.8, used_grip=0.65, used_along=None),
        "friction_0.9_fast": Disturbance(friction=0.9, used_grip=0.8, used_along=0.25),
        "side_wind": Disturbance(wind=15.0),
        "pose_noise": Disturbance(position_noise=0.04, heading_noise=math.radians(0.4)),
        "speed_noise": Disturbance(speed_noise=0.15, yaw_rate_noise=0.008),
        "model_soft": Disturbance(
            model=ModelError(mass=stiff, yaw_inertia=stiff, c_f=soft, c_r=soft)
        ),
        "model_stiff": Disturbance(
            model=ModelError(mass=soft, yaw_inertia=soft, c_f=stiff, c_r=stiff)
        ),
        "v_y_bias": Disturbance(disturbances=(SensorBias(v_y=-0.07),)),
        "yaw_rate_bias": Disturbance(disturbances=(SensorBias(yaw_rate=-0.007),)),
        "v_x_high": Disturbance(disturbances=(SensorBias(v_x_scale=0.035),)),
        "v_x_low": Disturbance(disturbances=(SensorBias(v_x_scale=-0.035),)),
        "drift": Disturbance(disturbances=(PositionDrift(deviation=0.15, time=6.0),)),
        "latency_150ms": Disturbance(latency=0.15),
        "dropouts": Disturbance(disturbances=(Dropouts(share=0.06),)),
        "beside": Disturbance(start_offset=-0.4),
        "turned": Disturbance(start_offset=0.25, start_heading=-0.07),
        "wet_patches": Disturbance(
            friction=0.95, used_grip=0.4, used_along=0.2, disturbances=(wet,)
        ),
        "icy_edge": Disturbance(friction=0.95, used_grip=0.4, used_along=0.2, disturbances=(edge,)),
    }


# Wide roads for speeds at which a car is far less damped; one of them is driven as fast as 0.7 of
# the grip allows. Their sensors are exact: a controller without an estimator that had to hold noise
# there would be slow everywhere.
_MOTORWAY, _RACE = "harmonic_fast", "harmonic_race"
# Little grip is left: an axle uses up to 87 % of its own.
_FAST = {
    "friction_0.75_fast": Disturbance(friction=0.75, used_grip=0.76, used_along=0.35),
    "friction_0.65_fast": Disturbance(friction=0.65, used_grip=0.7, used_along=0.35),
}


def tuning() -> Suite:
    """Gains are tuned here."""
    known, mixed = disturbances(), {"mixed_1": _MIXED, "mixed_2": _MIXED}
    names = [*known, *mixed]
    courses = {}
    for k in range(_ROADS):
        # Half of what a road meets comes at each speed.
        steady, more = names[k :: 2 * _ROADS], names[k + _ROADS :: 2 * _ROADS]
        speeds: Speeds = {"steady": constant(14.0), "changing": changing(23.0)}
        only = {"steady": (CLEAN, *steady), "changing": (CLEAN, *more)}
        only["changing"] += tuple(_FAST)
        if k < len(_STOPPING):
            speeds["stop_and_go"] = StopAndGo(speed=7.0, hold=6.0, a_lat_max=5.0)
            only["stop_and_go"] = _STOPPING[k]
        road = HarmonicRoad(seed=k, distance=_LENGTH)
        courses[f"harmonic_{k}"] = Course(path=road, speeds=speeds, only=only)
    courses[_MOTORWAY] = Course(
        path=HarmonicRoad(seed=_ROADS, distance=1000.0, min_radius=70.0, shortest=120.0),
        speeds={"fast": constant(40.0, 8.0), "sporty": constant(60.0, 22.0)},
        only={
            "fast": (CLEAN, "delay_80ms", "v_y_bias"),
            "sporty": (CLEAN, "oversteer", "heavy"),
        },
    )
    courses[_RACE] = Course(
        path=HarmonicRoad(seed=_ROADS + 1, distance=1000.0, min_radius=45.0, shortest=90.0),
        speeds={"race": SpeedProfile(a_lat_max=20.6, deceleration=3.3, acceleration=2.5)},
        only={"race": (CLEAN, "oversteer", "heavy")},
    )
    single = {CLEAN: Disturbance(), **known, **_FAST}
    return Suite(courses=courses, disturbances=single, mixed=mixed)


_STOPPING = ((CLEAN, "yaw_rate_bias"), ("delay_160ms", "beside"))


def on_car(found: Suite, vehicle: Vehicle) -> Suite:
    """The suite with this car alone, at speeds that leave part of its grip unused."""
    cap = _USED_GRIP * vehicle.friction * GRAVITY
    courses = {
        name: one.model_copy(update={"speeds": _capped(one.speeds, cap)})
        for name, one in found.courses.items()
    }
    return found.model_copy(update={"courses": courses, "vehicles": {vehicle.kind: vehicle}})


def _capped(speeds: Mapping[str, SpeedComponent], cap: float) -> Speeds:
    return {
        name: one.model_copy(update={"a_lat_max": min(cap, one.a_lat_max or cap)})
        if isinstance(one, SpeedTracking)
        else one
        for name, one in speeds.items()
    }


def on_road(found: Suite, road: PathComponent) -> Suite:
    """The suite on this road alone: each course begins at another place of it, 40 s at most.

    The courses for high speeds stay out: their speeds are those of their own roads.
    """
    fast = _MOTORWAY, _RACE
    known = {name: one for name, one in found.courses.items() if name not in fast}
    count = len(known)
    changes = {"path": road, "laps": None, "duration": _SECONDS}
    courses = {
        name: one.model_copy(update={**changes, "start": k / count * road.length})
        for k, (name, one) in enumerate(known.items())
    }
    return found.model_copy(update={"courses": courses})
