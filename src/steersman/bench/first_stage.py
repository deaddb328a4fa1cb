"""The test suite of the first stage, ``standard_1``, and its part ``core_1``.

Every scenario is as it was when the first stage's figures were made, with the car of that time.
Its random roads come from the generator that trainings use, at seeds that they do not draw.
"""

from __future__ import annotations

import math

from steersman.bench.courses import course, known_courses, sporty
from steersman.bench.disturbance import Disturbance, Mixed
from steersman.bench.suite import CLEAN, Suite
from steersman.controllers.model_error import ModelError
from steersman.paths.random_road import RandomRoad
from steersman.vehicles import CarlaModel3V1

# Roads that no training and no validation has seen: those draw seeds below 2000.
HELD_OUT = range(2000, 2020)

COMMON = (
    *(CLEAN, "delay_100ms", "delay_200ms", "noise_0.1m"),
    *("heavy", "light", "stiff", "soft", "understeer", "oversteer"),
)
"""The commonest disturbances: delay, noise, and a car that is not that of the model."""


def first_disturbances() -> dict[str, Disturbance]:
    """What can be wrong, one thing at a time."""
    return {
        CLEAN: Disturbance(),
        "delay_50ms": Disturbance(delay=0.05),
        "delay_100ms": Disturbance(delay=0.1),
        "delay_200ms": Disturbance(delay=0.2),
        "noise_0.1m": Disturbance(waypoint_noise=0.1),
        "noise_0.3m": Disturbance(waypoint_noise=0.3),
        "heavy": Disturbance(mass=1.2, yaw_inertia=1.2),
        "light": Disturbance(mass=0.8, yaw_inertia=0.8),
        "stiff": Disturbance(c_f=1.3, c_r=1.3),
        "soft": Disturbance(c_f=0.7, c_r=0.7),
        "understeer": Disturbance(c_f=0.7, c_r=1.3),
        "oversteer": Disturbance(c_f=1.3, c_r=0.7),
        "slow_actuator": Disturbance(steer_rate=0.25),
        "bias_1deg": Disturbance(steer_bias=math.radians(1.0)),
        **{f"friction_{mu}": Disturbance(friction=mu, used_along=None) for mu in (1.0, 0.7, 0.5)},
        "side_wind": Disturbance(wind=20.0),
        "pose_noise": Disturbance(position_noise=0.05, heading_noise=math.radians(0.5)),
        "speed_noise": Disturbance(speed_noise=0.2, yaw_rate_noise=0.01),
        **{f"model_{name}": Disturbance(model=model) for name, model in _wrong_models().items()},
    }


def _wrong_models() -> dict[str, ModelError]:
    """Every parameter wrong by 30 %, in the ways that add up and in those that turn the car."""
    soft, stiff = 0.7, 1.3
    return {
        "soft": ModelError(mass=stiff, yaw_inertia=stiff, c_f=soft, c_r=soft),
        "stiff": ModelError(mass=soft, yaw_inertia=soft, c_f=stiff, c_r=stiff),
        "understeer": ModelError(c_f=soft, c_r=stiff),
        "oversteer": ModelError(c_f=stiff, c_r=soft),
    }


def standard_1() -> Suite:
    """The test suite of the first stage."""
    roads = {
        f"road_{seed}": course(RandomRoad(seed=seed, distance=600.0), 15.0, 25.0)
        for seed in HELD_OUT
    }
    fast = {"circle_50_left": 21.0, "monza": 28.0, "road_2000": 25.0}
    return Suite(
        courses=sporty({**known_courses(), **roads}, fast, 10.0),
        disturbances=first_disturbances(),
        mixed={f"mixed_{i}": Mixed() for i in (1, 2, 3)},
        # The first stage counted every drive.
        graded=False,
        # The name is part of what scenarios draw from.
        vehicles={"carla_model3": CarlaModel3V1()},
    )


def core_1() -> Suite:
    """A quarter of it: every track, four roads, and the commonest disturbances."""
    whole = standard_1()
    left_out = {f"road_{seed}" for seed in HELD_OUT[4:]}
    return whole.model_copy(
        update={
            "courses": {n: one for n, one in whole.courses.items() if n not in left_out},
            "disturbances": {name: whole.disturbances[name] for name in COMMON},
        }
    )
