"""A small car: figures made up for the example."""

from __future__ import annotations

from steersman.config import param, register
from steersman.vehicles import Vehicle


@register("vehicle", "kei_car")
class KeiCar(Vehicle):
    """A light, short car on ordinary tyres. What is not given here is the Model 3's."""

    mass: float = param(850.0, "kg", "Mass.", gt=0)
    yaw_inertia: float = param(1000.0, "kg m^2", "Moment of inertia about the z axis.", gt=0)
    l_f: float = param(1.05, "m", "Centre of mass to front axle.", gt=0)
    l_r: float = param(1.45, "m", "Centre of mass to rear axle.", gt=0)
    track_width: float = param(1.3, "m", "Distance between left and right wheels.", gt=0)
    c_f: float = param(60_000.0, "N/rad", "Cornering stiffness of the front axle.", gt=0)
    c_r: float = param(60_000.0, "N/rad", "Cornering stiffness of the rear axle.", gt=0)
    friction: float = param(1.0, "-", "Tyre friction coefficient.", gt=0)
