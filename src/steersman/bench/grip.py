"""How much of the tyres' grip a run needs, and the class that follows from it."""

from __future__ import annotations

from typing import Literal, TypeAlias

import numpy as np

from steersman.kernels import grip_demand as kernel
from steersman.profiles import stack_profiles
from steersman.rollout import RunConfig
from steersman.run_length import goal
from steersman.vehicles import Vehicle

GripClass: TypeAlias = Literal["within 60 %", "60 to 90 %", "beyond"]
BEYOND: GripClass = "beyond"
_USUAL, _MOST = 0.6, 0.9
# Distance between places at which the road's friction is read [m].
_STEP = 0.5


def demanded_grip(run: RunConfig) -> float:
    """The largest share of grip that path and speeds of the run need [-].

    Of the axle that needs more, lateral and longitudinal together, see
    :mod:`steersman.kernels.grip_demand`, on a road whose disturbances may change its friction on
    the way. Where it differs between left and right, the car has the mean of both.
    """
    path, start = run.path, run.start.s
    places = np.arange(0.0, path.length, _STEP).tolist()
    grip = np.ones(len(places))
    for one in run.disturbances:
        grip *= [sum(one.friction(s)) / 2.0 for s in places]
    distance, seconds = goal(path, start, run.duration, run.laps)
    return float(
        kernel.largest_share(
            run.vehicle.table,
            stack_profiles([run.speed.profile()], [path]),
            path.table,
            grip,
            _STEP,
            start,
            run.speed.start_speed(path, start),
            run.plant.dt,
            seconds,
            distance,
        )
    )


def burden(car: Vehicle) -> float:
    """The most that an axle drives or brakes of the car, over what it carries of the weight [-].

    1 would be a car that uses the grip of both axles alike; one with rear drive has about 2.
    """
    on_front = car.l_r / (car.l_f + car.l_r)
    shares = (car.drive_front, car.brake_front)
    return max(max(one / on_front, (1.0 - one) / (1.0 - on_front)) for one in shares)


def grip_class(share: float) -> GripClass:
    """The class of a share: what a controller can be asked to hold, and what only less speed can.

    >>> [grip_class(share) for share in (0.6, 0.61, 0.91)]
    ['within 60 %', '60 to 90 %', 'beyond']
    """
    if share <= _USUAL:
        return "within 60 %"
    return "60 to 90 %" if share <= _MOST else BEYOND
