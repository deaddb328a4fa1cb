"""States and figures of the multi-body car.

Axes: x forward, y left, z down; yaw and yaw rate positive to the left, roll positive with the
left side down, pitch positive with the nose up. That is the mirror image of the axes of SAE, in
which the equations are usually given. Of an axle's two wheels the first is the right one.
"""

from __future__ import annotations

from typing import NamedTuple

from steersman.kernels import vehicle as planar
from steersman.kernels.compiled import kernel
from steersman.kernels.vehicle import GRAVITY, VX, YAW_RATE
from steersman.types import FloatArray

# State beyond x, y, psi, v_x, v_y and yaw rate: wheel angle; roll, pitch and heave of the sprung
# mass with their rates; of each axle roll and its rate, v_y, height and its rate; wheel speeds,
# front right, front left, rear right, rear left; stretch of each axle's joint.
(WHEEL_ANGLE, ROLL, ROLL_RATE, PITCH, PITCH_RATE, HEAVE, HEAVE_RATE) = range(6, 13)
FRONT, REAR, WHEELS, JOINTS = 13, 18, 23, 27
N_STATE = 29
# A wheel that moves more slowly along its plane counts as moving so fast [m/s].
SLOWEST_WHEEL = 0.1
# States that the slip of the wheels changes within milliseconds.
FAST = (VX, YAW_RATE, WHEELS, WHEELS + 1, WHEELS + 2, WHEELS + 3)
# Columns of an axle, from FRONT or REAR on.
A_ROLL, A_ROLL_RATE, A_VY, A_HEIGHT, A_HEIGHT_RATE = range(5)


class Tyre(NamedTuple):
    """Coefficients of the magic formula, with Pacejka's names; all in SI units."""

    pcx1: float
    pdx1: float
    pdx3: float
    pex1: float
    pkx1: float
    phx1: float
    pvx1: float
    rbx1: float
    rbx2: float
    rcx1: float
    rex1: float
    rhx1: float
    pcy1: float
    pdy1: float
    pdy3: float
    pey1: float
    phy1: float
    phy3: float
    pvy1: float
    pvy3: float
    rby1: float
    rby2: float
    rby3: float
    rcy1: float
    rey1: float
    rhy1: float
    rvy1: float
    rvy3: float
    rvy4: float
    rvy5: float
    rvy6: float


class Axle(NamedTuple):
    """The suspension of an axle."""

    mass: float
    """Unsprung mass [kg]."""
    inertia: float
    """Moment of inertia about the x axis [kg m^2]."""
    track: float
    """Distance between its wheels [m]; 0: the vehicle's."""
    spring: float
    """Stiffness at each wheel [N/m]."""
    damper: float
    """Damping at each wheel [N s/m]."""
    torsion: float
    """Additional roll stiffness [N m/rad]; negative: less than that of the springs."""
    roll_axis: float
    """Height of the roll axis above ground [m]."""
    camber: float
    """Camber per travel of the spring [rad/m]."""
    camber2: float
    """Camber per squared travel [rad/m^2]."""


class Body(NamedTuple):
    """What a planar vehicle's figures do not hold: suspension, wheels and tyres."""

    roll_inertia: float
    """Of the sprung mass about its x axis [kg m^2]."""
    pitch_inertia: float
    """Of the sprung mass about its y axis [kg m^2]."""
    cross_inertia: float
    """Product of inertia x z of the sprung mass [kg m^2]."""
    joint_stiffness: float
    """Lateral, between an axle and the sprung mass [N/m]."""
    joint_damping: float
    """Lateral, between an axle and the sprung mass [N s/m]."""
    tyre_stiffness: float
    """Vertical, of a tyre [N/m]."""
    tyre_shift: float
    """Lateral shift of a tyre's contact per lateral force [m/N]."""
    radius: float
    """Of a wheel [m]."""
    wheel_inertia: float
    """Of a wheel about its axis [kg m^2]."""
    height: float
    """Centre of the sprung mass above ground [m]."""
    creep: float
    """Speed below which the car rolls without slip [m/s]."""
    front: Axle
    rear: Axle
    tyre: Tyre


class AxlePlace(NamedTuple):
    """An axle's figures that a planar vehicle's hold, too."""

    x: float
    """Place ahead of the centre of mass [m]; negative: behind."""
    track: float
    """Distance between its wheels [m]."""
    rest: float
    """Force of each of its springs at rest [N]."""
    spin_inertia: float
    """Of one of its wheels about its axis, with what of the engine turns with it [kg m^2]."""
    cornering: float
    """Slope of lateral force over slip angle and load, pky1, negative [1/rad]."""


class Figures(NamedTuple):
    """The car's figures that a planar vehicle's hold, too; they may change while it drives."""

    mass: float
    """All of it [kg]."""
    sprung: float
    """Sprung mass [kg]."""
    yaw_inertia: float
    """Of the car about its z axis [kg m^2]."""
    grip_left: float
    """Friction under the left wheels over that for which the tyre's coefficients hold [-]."""
    grip_right: float
    """The same under the right wheels [-]."""
    drag: float
    """Drag force per squared speed [N s^2/m^2]."""
    side: float
    """Lateral force of the wind [N]."""
    moment: float
    """Yaw moment of the wind [N m]."""
    front: AxlePlace
    rear: AxlePlace


@kernel
def figures_of(body: Body, row: FloatArray) -> Figures:
    """Figures of a vehicle's row; what its mass is more than the axles' is sprung mass.

    Rotating masses beyond those of the wheels are the engine's, on the driven wheels.
    """
    mass, l_f, l_r = row[planar.MASS], row[planar.L_F], row[planar.L_R]
    front, rear = body.front, body.rear
    sprung, base, weight = mass - front.mass - rear.mass, l_f + l_r, mass * GRAVITY
    track_f = front.track if front.track > 0.0 else row[planar.TRACK]
    track_r = rear.track if rear.track > 0.0 else row[planar.TRACK]
    wheel, square = body.wheel_inertia, body.radius * body.radius
    engine = 0.5 * max(row[planar.ROTATING] * square - 4.0 * wheel, 0.0)
    at_front = row[planar.DRIVE_FRONT]
    grip = row[planar.MU] / body.tyre.pdy1
    rest = 0.5 * sprung * GRAVITY / base
    return Figures(
        mass,
        sprung,
        row[planar.INERTIA],
        grip * row[planar.GRIP_LEFT],
        grip * row[planar.GRIP_RIGHT],
        row[planar.DRAG],
        row[planar.SIDE_FORCE],
        row[planar.YAW_MOMENT],
        AxlePlace(
            l_f,
            track_f,
            rest * l_r,
            wheel + at_front * engine,
            -row[planar.C_F] * base / (weight * l_r),
        ),
        AxlePlace(
            -l_r,
            track_r,
            rest * l_f,
            wheel + (1.0 - at_front) * engine,
            -row[planar.C_R] * base / (weight * l_f),
        ),
    )
