"""What a calibration drives, on a straight wide plane: steering at rest, throttles, steps."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

from steersman.kernels import vehicle as kernel
from steersman.protocols import Plant
from steersman.types import Command, Pose, VehicleState
from steersman.vehicles import Vehicle

Tell = Callable[[str], None]

# Steering at rest: time for lock and back at the slowest rate that is expected [s].
_LOCK = 4.0
# Throttle runs: longest [s], and the slowest and fastest at which they are of use [m/s].
_THROTTLE = 10.0
_SLOWEST, TOP = 1.5, 36.0
# Acceleration below which a throttle run has come to its plateau [m/s^2].
_PLATEAU = 0.02
# Brake runs: speed at their beginning [m/s], and pedals.
_BRAKE_FROM, _BRAKES = 20.0, (0.25, 0.5, 1.0)
# Steps of the steering: time in each [s]; lateral accelerations they aim at [m/s^2].
_STRAIGHT, _TURN = 0.25, 2.0
_CURVE_ACCELERATION, _STEP_ACCELERATION = 4.0, (2.0, 4.0)
# Speeds of the steps whose response gives stiffness and inertia [m/s].
STEP_SPEEDS = (8.0, 14.0, 20.0)
_LARGEST_STEP = 0.5


class Manoeuvre(NamedTuple):
    """States and the commands that were held after each; one state more than commands."""

    name: str
    states: list[VehicleState]
    commands: list[Command]
    dt: float


class ManoeuvreDriver:
    """Drives manoeuvres one after the other, each from a steady start at the plane's begin."""

    def __init__(self, plant: Plant, tell: Tell) -> None:
        """On a plant that has entered its road."""
        self.plant = plant
        self._tell = tell

    def run(
        self,
        name: str,
        speed: float,
        seconds: float,
        command: Callable[[float, VehicleState], Command],
        over: Callable[[VehicleState], bool] | None = None,
    ) -> Manoeuvre:
        """Reset on a straight and hold what ``command`` says of time and state, until ``over``."""
        self._tell(name)
        states, commands = [self.plant.reset(Pose(0.0, 0.0, 0.0), speed, 0.0)], []
        for k in range(round(seconds / self.plant.dt)):
            commands.append(command(k * self.plant.dt, states[-1]))
            states.append(self.plant.step(commands[-1]))
            if over is not None and over(states[-1]):
                break
        return Manoeuvre(name, states, commands, self.plant.dt)


def lock_at_rest(driver: ManoeuvreDriver) -> Manoeuvre:
    """Full lock and back at standstill, brake pressed."""
    return driver.run(
        "steering at rest",
        0.0,
        2.0 * _LOCK,
        lambda t, _: Command(1.0 if t < _LOCK else 0.0, 0.0, 1.0),
    )


def throttle_runs(driver: ManoeuvreDriver, vehicle: Vehicle) -> dict[float, list[Manoeuvre]]:
    """Each throttle of the vehicle's map from standstill up, and from the top speed down."""
    found: dict[float, list[Manoeuvre]] = {}
    for throttle in vehicle.map_throttle:
        runs = []
        if throttle > 0.0:
            runs.append(_throttle(driver, throttle, 0.0, rising=True))
        runs.append(_throttle(driver, throttle, TOP, rising=False))
        found[throttle] = runs
    return found


def _throttle(driver: ManoeuvreDriver, throttle: float, speed: float, *, rising: bool) -> Manoeuvre:
    def over(state: VehicleState) -> bool:
        if rising:
            settled = state.time > 2.0 and abs(state.a_x) < _PLATEAU  # noqa: PLR2004 - [s]
            return settled or state.v_x > TOP
        return state.v_x < _SLOWEST or (state.time > 2.0 and state.a_x > -_PLATEAU)  # noqa: PLR2004

    name = f"throttle {throttle:g} from {speed:g} m/s"
    return driver.run(name, speed, _THROTTLE, lambda *_: Command(0.0, throttle, 0.0), over)


def brake_runs(driver: ManoeuvreDriver) -> list[Manoeuvre]:
    """From a steady speed to about standstill, with each of some pressures of the brake pedal."""
    return [_brake(driver, brake) for brake in _BRAKES]


def _brake(driver: ManoeuvreDriver, brake: float) -> Manoeuvre:
    name = f"brake {brake:g} from {_BRAKE_FROM:g} m/s"

    def over(state: VehicleState) -> bool:
        return state.v_x < _SLOWEST

    return driver.run(name, _BRAKE_FROM, _THROTTLE, lambda *_: Command(0.0, 0.0, brake), over)


def curve_runs(driver: ManoeuvreDriver, vehicle: Vehicle) -> list[Manoeuvre]:
    """Steps of the steering, to both sides, at the speeds of the vehicle's steering curve."""
    speeds = [v for v in vehicle.steer_curve_speed if 0.0 < v < TOP]
    top = [0.5 * (speeds[-1] + TOP)] if speeds and vehicle.steer_curve_speed[-1] >= TOP else []
    return [
        _step(driver, vehicle, v, side * _CURVE_ACCELERATION)
        for v in (*speeds, *top)
        for side in (1.0, -1.0)
    ]


def step_runs(driver: ManoeuvreDriver, vehicle: Vehicle) -> list[Manoeuvre]:
    """Steps of the steering at speeds and accelerations that show the tyres' figures."""
    return [
        _step(driver, vehicle, v, side * a)
        for v in STEP_SPEEDS
        for side, a in zip((1.0, -1.0), _STEP_ACCELERATION, strict=True)
    ]


def _step(
    driver: ManoeuvreDriver, vehicle: Vehicle, speed: float, acceleration: float
) -> Manoeuvre:
    """A step to the wheel angle that gives about that lateral acceleration [m/s^2], and back."""
    angle = vehicle.wheelbase * acceleration / speed**2
    steer = vehicle.steer_for_wheel_angle(math.atan(angle), speed)
    steer = min(max(steer, -_LARGEST_STEP), _LARGEST_STEP)
    start: list[VehicleState] = []

    def command(t: float, state: VehicleState) -> Command:
        start[:] = start or [state]  # the pedals that hold the speed
        turned = _STRAIGHT <= t < _STRAIGHT + _TURN
        return Command(steer if turned else 0.0, start[0].throttle, start[0].brake)

    name = f"steering {steer:.3f} at {speed:.1f} m/s"
    return driver.run(name, speed, _STRAIGHT + _TURN + 1.0, command)


def inner_angle(vehicle: Vehicle, wheel_angle: float) -> float:
    """Angle of the inner wheel [rad] from the single-track angle [rad], by Ackermann."""
    middle = math.tan(abs(wheel_angle))
    ackermann = float(vehicle.table.rows[0, kernel.ACKERMANN])
    inner = middle / max(1.0 - 0.5 * ackermann * middle, 1e-9)
    return math.copysign(math.atan(inner), wheel_angle)
