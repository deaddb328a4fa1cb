"""The test suite ``standard`` and its part ``core``.

Known tracks and random roads of three generators, none of which any training or tuning uses; what
is wrong with car, sensors and road, one thing at a time and drawn together. What each scenario asks
of the tyres is computed (:mod:`steersman.bench.grip`): some need more than there is.
"""

from __future__ import annotations

from steersman.bench.courses import also, course, known_courses, sporty
from steersman.bench.disturbance import Disturbance, Mixed
from steersman.bench.first_stage import COMMON, first_disturbances
from steersman.bench.suite import CLEAN, Suite
from steersman.disturbances import Dropouts, FrictionPatch, PositionDrift, SensorBias
from steersman.paths.generated import ClothoidRoad, SplineRoad, SurveyedRoad
from steersman.speed import StopAndGo

GENERATORS = {"clothoid": ClothoidRoad, "spline": SplineRoad, "surveyed": SurveyedRoad}
"""Of the random roads, by the word that their courses begin with."""
ROADS = 6
"""Roads of each generator."""

_CORE_ROADS = 2
_STOPPING = ("circle_50_left", "figure_eight", *(f"{name}_0" for name in GENERATORS))
_STOPPED = (CLEAN, "delay_200ms", "noise_0.1m", "yaw_rate_bias", "drift", "beside", "side_wind")
_MIXED = Mixed(
    delay=0.15,
    waypoint_noise=0.15,
    mass=0.25,
    yaw_inertia=0.25,
    stiffness=0.25,
    v_y=0.1,
    yaw_rate=0.01,
    v_x_scale=0.05,
    drift=0.1,
)
_CORE = (*COMMON, "v_y_bias", "drift", "latency_100ms", "dropouts", "friction_0.7")


def disturbances() -> dict[str, Disturbance]:
    """Those of the first stage, and sensors and roads as they are outside."""
    wet, edge = (
        FrictionPatch(begin=20.0, length=25.0, every=60.0, left=left, right=right)
        for left, right in ((0.55, 0.55), (0.4, 1.0))
    )
    return {
        **first_disturbances(),
        **{f"friction_{mu}": Disturbance(friction=mu) for mu in (1.0, 0.7, 0.5)},
        "v_y_bias": Disturbance(disturbances=(SensorBias(v_y=0.1),)),
        "yaw_rate_bias": Disturbance(disturbances=(SensorBias(yaw_rate=0.01),)),
        "v_x_high": Disturbance(disturbances=(SensorBias(v_x_scale=0.05),)),
        "v_x_low": Disturbance(disturbances=(SensorBias(v_x_scale=-0.05),)),
        "drift": Disturbance(disturbances=(PositionDrift(deviation=0.2, time=10.0),)),
        "latency_50ms": Disturbance(latency=0.05),
        "latency_100ms": Disturbance(latency=0.1),
        "dropouts": Disturbance(disturbances=(Dropouts(share=0.1),)),
        "beside": Disturbance(start_offset=0.5),
        "turned": Disturbance(start_offset=-0.3, start_heading=0.1),
        "wet_patches": Disturbance(
            friction=1.0, used_grip=0.35, used_along=0.17, disturbances=(wet,)
        ),
        "icy_edge": Disturbance(
            friction=1.0, used_grip=0.35, used_along=0.17, disturbances=(edge,)
        ),
        "friction_0.7_fast": Disturbance(friction=0.7, used_grip=0.75),
        "friction_0.7_floored": Disturbance(friction=0.7, used_along=None),
        "friction_0.5_floored": Disturbance(friction=0.5, used_along=None),
        "friction_0.6_beyond": Disturbance(friction=0.6, used_grip=0.95),
        "friction_0.5_beyond": Disturbance(friction=0.5, used_grip=1.1),
    }


def standard() -> Suite:
    """The test suite."""
    roads = {
        f"{name}_{seed}": course(kind(seed=seed), 15.0, 25.0)
        for name, kind in GENERATORS.items()
        for seed in range(ROADS)
    }
    courses = {**known_courses(), **roads}
    for name in _STOPPING:
        courses[name] = also(
            courses[name], "stop_and_go", StopAndGo(speed=9.0, hold=8.0, a_lat_max=6.0), *_STOPPED
        )
    fast = {"circle_50_left": 40.0, "monza": 60.0, "clothoid_0": 40.0, "spline_0": 40.0}
    return Suite(
        courses=sporty(courses, fast, 20.0),
        disturbances=disturbances(),
        mixed={f"mixed_{i}": _MIXED for i in (1, 2, 3)},
    )


def core() -> Suite:
    """A part of it for every day: every track, two roads of each generator, few disturbances."""
    whole = standard()
    left_out = {f"{name}_{seed}" for name in GENERATORS for seed in range(_CORE_ROADS, ROADS)}
    courses = {
        name: one.model_copy(
            update={
                "only": {
                    speed: tuple(n for n in words if n in _CORE)
                    for speed, words in one.only.items()
                }
            }
        )
        for name, one in whole.courses.items()
        if name not in left_out
    }
    chosen = {name: whole.disturbances[name] for name in _CORE}
    return whole.model_copy(update={"courses": courses, "disturbances": chosen})
