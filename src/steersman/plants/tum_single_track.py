"""The plant of TUM-CONTROL, an outside yardstick for controllers on race tracks."""

from __future__ import annotations

import numpy as np

from steersman.config import param, register
from steersman.kernels import tum_single_track as kernel
from steersman.kernels.vehicle import VehicleTable
from steersman.plants.physics import CompiledComponent, Motion
from steersman.types import FloatArray
from steersman.vehicles import Vehicle


class SingleTrackMotion(Motion):
    """The compiled equations, integrated by the explicit midpoint rule."""

    def __init__(self, tyres: kernel.SingleTrackTyres) -> None:
        """Of a car on these tyres."""
        self.tyres = tyres

    def slope(self, table: VehicleTable, state: FloatArray, inputs: FloatArray) -> FloatArray:
        """Time derivative."""
        out = np.empty(kernel.N_STATE)
        kernel.derivative(table, 0, self.tyres, state, inputs, out)
        return out


@register("plant", "tum_single_track")
class TumSingleTrack(CompiledComponent):
    """TUM-CONTROL's single-track model: Pacejka's tyres at static load, combined slip.

    From the vehicle it takes mass, yaw inertia, axles, cornering stiffnesses, friction, steering,
    pedals and drag. The fields here are those of TUM-CONTROL, whose car is ``vehicle=vw_t7``.
    """

    shape_front: float = param(1.3, "-", "Shape of the front axle's lateral force.", gt=1)
    shape_rear: float = param(1.6, "-", "Shape of the rear axle's lateral force.", gt=1)
    curvature_front: float = param(0.97, "-", "Curvature of the front axle's lateral force.", lt=1)
    curvature_rear: float = param(0.97, "-", "Curvature of the rear axle's lateral force.", lt=1)
    peak_front: float = param(1.2, "-", "Largest lateral force over friction and load.", gt=0)
    peak_rear: float = param(2.1, "-", "The same at the rear.", gt=0)
    rolling: float = param(0.009, "-", "Rolling resistance over load, at standstill.", ge=0)
    rolling1: float = param(0.002, "-", "Its growth with speed / (100 km/h).", ge=0)
    rolling4: float = param(0.0003, "-", "Its growth with the fourth power of that.", ge=0)

    def source(self) -> str:
        """The model is part of the package."""
        return "TUM-CONTROL's single-track model"

    def motion(self, vehicle: Vehicle) -> Motion:
        """The equations with these figures."""
        names = kernel.SingleTrackTyres._fields
        return SingleTrackMotion(
            kernel.SingleTrackTyres(**{name: getattr(self, name) for name in names})
        )
