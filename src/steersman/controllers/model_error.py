"""How wrong the model is that a controller computes with."""

from __future__ import annotations

from steersman.config import Settings, param
from steersman.vehicles import Vehicle


class ModelError(Settings):
    """Factors on the vehicle's true parameters that give the controller's nominal ones."""

    mass: float = param(1.0, "-", "Nominal mass over true mass.", gt=0)
    yaw_inertia: float = param(1.0, "-", "Nominal yaw inertia over the true one.", gt=0)
    c_f: float = param(1.0, "-", "Nominal front cornering stiffness over the true one.", gt=0)
    c_r: float = param(1.0, "-", "Nominal rear cornering stiffness over the true one.", gt=0)

    def nominal(self, vehicle: Vehicle) -> Vehicle:
        """The nominal vehicle, whose parameters the controller computes with."""
        wrong = {name: getattr(vehicle, name) * f for name, f in self if f != 1.0}
        return vehicle.replace(**wrong) if wrong else vehicle


class TyreModelError(ModelError):
    """The same for controllers whose model has tyres with a limit."""

    friction: float = param(1.0, "-", "Nominal friction over the true one.", gt=0)
