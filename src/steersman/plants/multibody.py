"""The second opinion: a car with 29 states, whose body rolls and pitches and whose wheels spin.

The published figures of a BMW 320i are the defaults of what a planar vehicle does not hold.

Source: M. Althoff and G. Wuersching, CommonRoad: Vehicle Models (2020a), multi-body model, tables
of vehicle parameters (vehicle 2) and of tyre parameters, which are those of the ADAMS handbook.
"""

from __future__ import annotations

import numpy as np

from steersman.config import Settings, param, register
from steersman.kernels import multibody as equations
from steersman.kernels import multibody_figures as kernel
from steersman.kernels import multibody_step as steps
from steersman.kernels.vehicle import VehicleTable
from steersman.plants.physics import CompiledComponent, Motion
from steersman.types import FloatArray
from steersman.vehicles import Vehicle


class AxleFigures(Settings):
    """Suspension of an axle; the defaults are the front axle of a BMW 320i."""

    mass: float = param(63.7921826056784, "kg", "Unsprung mass.", gt=0)
    inertia: float = param(
        30.673279563178017, "kg m^2", "Moment of inertia about the x axis.", gt=0
    )
    track: float = param(
        0.0,
        "m",
        "Distance between its wheels; 0: the vehicle's; published: 1.387, rear 1.364.",
        ge=0,
    )
    spring: float = param(24453.137879749014, "N/m", "Stiffness at each wheel.", gt=0)
    damper: float = param(1786.2441002440723, "N s/m", "Damping at each wheel.", ge=0)
    torsion: float = param(
        -6914.881688272133, "N m/rad", "Additional roll stiffness; negative: less of it."
    )
    roll_axis: float = param(0.0, "m", "Height of the roll axis above ground.")
    camber: float = param(-0.39370078740157477, "rad/m", "Camber per travel of the spring.")
    camber2: float = param(0.0, "rad/m^2", "Camber per squared travel.")


_REAR_AXLE = AxleFigures(
    inertia=29.670408143156248,
    spring=19635.504745231297,
    damper=1649.0833034887382,
    torsion=-2643.6009520155308,
    camber=-0.905511811023622,
)


class MagicFormula(Settings):
    """Coefficients of a tyre with Pacejka's names, at the friction of a vehicle of ``pdy1``.

    Another friction of the vehicle scales both friction coefficients; the slope of the lateral
    force (``pky1``) follows from the vehicle's cornering stiffnesses.
    """

    pcx1: float = param(1.6411, "-", "Shape of the longitudinal force.", gt=0)
    pdx1: float = param(1.1739, "-", "Longitudinal friction.", gt=0)
    pdx3: float = param(0.0, "1/rad^2", "Its loss by camber.")
    pex1: float = param(0.46403, "-", "Curvature of the longitudinal force.")
    pkx1: float = param(22.303, "-", "Slope of the longitudinal force over slip and load.", gt=0)
    phx1: float = param(0.0012297, "-", "Shift of the longitudinal slip.")
    pvx1: float = param(-8.8098e-06, "1/N", "Shift of the longitudinal force per load.")
    rbx1: float = param(13.276, "1/rad", "Loss of longitudinal force by slip angle: slope.")
    rbx2: float = param(-13.778, "-", "The slope's change with slip.")
    rcx1: float = param(1.2568, "-", "Shape of that loss.")
    rex1: float = param(0.65225, "-", "Curvature of that loss.")
    rhx1: float = param(0.0050722, "rad", "Shift of that loss.")
    pcy1: float = param(1.3507, "-", "Shape of the lateral force.", gt=0)
    pdy1: float = param(1.0489, "-", "Lateral friction.", gt=0)
    pdy3: float = param(-2.8821, "1/rad^2", "Its loss by camber.")
    pey1: float = param(-0.0074722, "-", "Curvature of the lateral force.")
    phy1: float = param(0.0026747, "rad", "Shift of the slip angle.")
    phy3: float = param(0.031415, "-", "Shift of the slip angle per camber.")
    pvy1: float = param(0.037318, "-", "Shift of the lateral force over load.")
    pvy3: float = param(-0.32931, "1/rad", "The same per camber.")
    rby1: float = param(7.1433, "-", "Loss of lateral force by slip: slope.")
    rby2: float = param(9.1916, "1/rad", "The slope's change with slip angle.")
    rby3: float = param(-0.027856, "rad", "Slip angle at which the slope is largest.")
    rcy1: float = param(1.0719, "-", "Shape of that loss.")
    rey1: float = param(-0.27572, "-", "Curvature of that loss.")
    rhy1: float = param(5.7448e-06, "-", "Shift of that loss.")
    rvy1: float = param(-0.027825, "-", "Lateral force by slip, over friction and load.")
    rvy3: float = param(-0.27568, "1/rad", "The same per camber.")
    rvy4: float = param(12.12, "1/rad", "Its change with slip angle.")
    rvy5: float = param(1.9, "-", "Its shape over slip.")
    rvy6: float = param(-10.704, "-", "Its slope over slip.")


_PARTS = ("front", "rear", "tyre")
_AXLES = (kernel.FRONT, kernel.REAR)
_REST = range(kernel.WHEELS, kernel.N_STATE)


class MultiBodyMotion(Motion):
    """The compiled equations and their scratch."""

    more = kernel.N_STATE - 6
    free = (
        *(kernel.ROLL, kernel.PITCH, kernel.HEAVE),
        *(axle + i for axle in _AXLES for i in (kernel.A_ROLL, kernel.A_VY, kernel.A_HEIGHT)),
        *_REST,
    )
    still = (
        *(kernel.ROLL_RATE, kernel.PITCH_RATE, kernel.HEAVE_RATE),
        *(
            axle + i
            for axle in _AXLES
            for i in (kernel.A_ROLL_RATE, kernel.A_VY, kernel.A_HEIGHT_RATE)
        ),
        *_REST,
    )

    def __init__(self, body: kernel.Body) -> None:
        """Of a car with that suspension, these wheels and tyres."""
        self.body = body
        self._out, self._work = np.zeros(kernel.N_STATE), np.zeros((4, kernel.N_STATE))

    def slope(self, table: VehicleTable, state: FloatArray, inputs: FloatArray) -> FloatArray:
        """Time derivative; the wheel angle in the state is set to that of the steering."""
        equations.derivative_of(table, 0, self.body, state, inputs, self._out)
        return self._out.copy()

    def advance(
        self,
        table: VehicleTable,
        state: FloatArray,
        inputs: FloatArray,
        command: FloatArray,
        h: float,
    ) -> None:
        """By the W-method of :mod:`steersman.kernels.multibody_step`, in steps of its own."""
        steps.advance(table, 0, self.body, state, inputs, command, h, self._work)

    def settle(self, table: VehicleTable, state: FloatArray, inputs: FloatArray) -> None:
        """At rest in its springs, with axles that follow the body and wheels that roll."""
        steps.settle(table, 0, self.body, inputs, state)

    def rolled_over(self, table: VehicleTable, state: FloatArray) -> bool:
        """Whether both wheels of a side have lifted."""
        return bool(steps.has_lifted(table, 0, self.body, state))


@register("plant", "multibody")
class MultiBody(CompiledComponent):
    """The 29-state model of CommonRoad: rolling, pitching body on springs, spinning wheels.

    From the vehicle it takes mass, yaw inertia, axles, height, cornering stiffnesses, friction,
    steering, pedals and drag; what a planar vehicle does not hold are the fields here.
    """

    front: AxleFigures = param(AxleFigures(), "-", "Suspension of the front axle.")
    rear: AxleFigures = param(_REAR_AXLE, "-", "Suspension of the rear axle.")
    tyre: MagicFormula = param(MagicFormula(), "-", "Tyres.")
    roll_inertia: float = param(
        207.26524557936952, "kg m^2", "Of the sprung mass about its x axis.", gt=0
    )
    pitch_inertia: float = param(
        1565.8178787125541, "kg m^2", "Of the sprung mass about its y axis.", gt=0
    )
    cross_inertia: float = param(0.0, "kg m^2", "Its product of inertia x z.")
    joint_stiffness: float = param(
        175186.65943700788, "N/m", "Lateral, between an axle and the body.", gt=0
    )
    joint_damping: float = param(
        10215.732056044453, "N s/m", "Lateral, between an axle and the body.", ge=0
    )
    tyre_stiffness: float = param(158294.1398119115, "N/m", "Vertical, of a tyre.", gt=0)
    tyre_shift: float = param(
        1.6430724599974725e-05, "m/N", "Lateral shift of a tyre's contact per lateral force.", ge=0
    )
    radius: float = param(0.344, "m", "Of a wheel.", gt=0)
    wheel_inertia: float = param(1.7, "kg m^2", "Of a wheel about its axis.", gt=0)
    creep: float = param(
        0.5, "m/s", "Speed below which the car rolls without slip; published: 0.1.", ge=0.1
    )

    def source(self) -> str:
        """The model is part of the package."""
        return "multi-body model"

    def body(self, vehicle: Vehicle) -> kernel.Body:
        """Suspension, wheels and tyres as the kernels read them, under that vehicle's body."""
        own = (name for name in kernel.Body._fields if name in type(self).model_fields)
        plain = {name: getattr(self, name) for name in own if name not in _PARTS}
        return kernel.Body(
            **plain,
            height=vehicle.height,
            front=kernel.Axle(**self.front.model_dump()),
            rear=kernel.Axle(**self.rear.model_dump()),
            tyre=kernel.Tyre(**self.tyre.model_dump()),
        )

    def motion(self, vehicle: Vehicle) -> MultiBodyMotion:
        """The equations with these figures."""
        return MultiBodyMotion(self.body(vehicle))
