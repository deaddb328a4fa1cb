"""A vehicle of the stand-in: the embedded simulator's, in CARLA's terms, and its controls."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import steersman as sm
from carla_standin.wire import Refused, Transform

# Wheels as CARLA counts them.
FRONT_LEFT, FRONT_RIGHT, BACK_LEFT, BACK_RIGHT = range(4)
# Throttle, steer (right-positive), brake, hand brake, reverse, manual gear, gear.
_CENTRED = (0.0, 0.0, 0.0, False, False, False, 0)
_STEER, _REVERSE, _MANUAL, _GEAR = 1, 4, 5, 6
# A requested rate below this counts as no request [rad/s].
_NO_RATE = 1e-3


class Car:
    """One vehicle; ``offset`` is how far its centre of mass is ahead of the origin [m]."""

    def __init__(self, vehicle: sm.Vehicle, offset: float) -> None:
        """At rest on the origin, with everything centred."""
        self.motion = sm.VehicleMotion(vehicle)
        self.offset = offset
        self.command = sm.Command(0.0, 0.0, 0.0)
        self.reverse = False
        self.moves = True
        self.weighs = True
        """Whether it presses on the ground; else it goes on as it goes."""
        self.held: tuple[float, float] | None = None
        """A velocity that is kept, ahead and to the left [m/s]."""
        self._force = (0.0, 0.0)
        self.yaw_acceleration = 0.0
        """Mean over the last tick [rad/s^2]."""

    @property
    def vehicle(self) -> sm.Vehicle:
        """Its parameters."""
        return self.motion.vehicle

    def fit(self, vehicle: sm.Vehicle, offset: float) -> None:
        """Exchange the parameters; the origin stays where it is."""
        where = self.transform
        self.motion.vehicle, self.offset = vehicle, offset
        self.motion.pose = where.pose(offset)

    def advance(self, dt: float, substeps: int) -> None:
        """Hold the command for ``dt`` [s], in ``substeps`` integration steps or more."""
        if not self.moves or dt <= 0.0:
            self.yaw_acceleration = 0.0
            return
        before = self.motion.yaw_rate
        (x, y), self._force = self._force, (0.0, 0.0)
        if x or y:
            self.push((x * dt, y * dt, 0.0))
        if self.held is not None:
            self.motion.velocity = self.held
        if self.weighs:
            self.motion.advance(self.command, dt, substeps, self.reverse)
        else:
            self._float(dt)
        if self.held is not None:
            self.motion.velocity = self.held
        self.yaw_acceleration = (self.motion.yaw_rate - before) / dt

    def _float(self, dt: float) -> None:
        """Go on and turn for ``dt`` [s] as before: tyres without a load, and no air."""
        (x, y), rate, at = self.velocity, self.motion.yaw_rate, self.motion.pose
        self.motion.pose = sm.Pose(at.x + dt * x, at.y - dt * y, at.psi + dt * rate)
        self.velocity = x, y

    @property
    def transform(self) -> Transform:
        """Pose of the actor's origin."""
        return Transform.of(self.motion.pose, self.offset)

    @transform.setter
    def transform(self, where: Transform) -> None:
        """Teleport: the velocity over ground stays as it is, whatever the new heading."""
        velocity = self.velocity
        self.motion.pose = where.pose(self.offset)
        self.velocity = velocity

    @property
    def velocity(self) -> tuple[float, float]:
        """Velocity of the centre of mass in CARLA's world [m/s]."""
        return self._in_world(self.motion.velocity)

    @velocity.setter
    def velocity(self, value: tuple[float, float]) -> None:
        self.motion.velocity = sm.CarlaFrame.body_vector(self.motion.pose.psi, *value)

    @property
    def acceleration(self) -> tuple[float, float]:
        """Acceleration of the centre of mass in CARLA's world [m/s^2]."""
        return self._in_world(self.motion.acceleration)

    def _in_world(self, vector: tuple[float, float]) -> tuple[float, float]:
        return sm.CarlaFrame.world_vector(self.motion.pose.psi, *vector)

    @property
    def yaw_rate(self) -> float:
        """CARLA's yaw rate, positive to the right [deg/s]."""
        return sm.CarlaFrame.degrees_right(self.motion.yaw_rate)

    @yaw_rate.setter
    def yaw_rate(self, rate: float) -> None:
        self.motion.yaw_rate = sm.CarlaFrame.radians_left(rate)

    def push(self, impulse: tuple[float, float, float]) -> None:
        """Change the velocity by an impulse on the ground, in CARLA's world [N s]."""
        (v_x, v_y), mass = self.velocity, self.vehicle.mass
        self.velocity = v_x + impulse[0] / mass, v_y + impulse[1] / mass

    def pull(self, force: tuple[float, float, float]) -> None:
        """Add a force that acts over the next tick, in CARLA's world [N]."""
        self._force = self._force[0] + force[0], self._force[1] + force[1]

    def freeze(self, frozen: bool) -> None:
        """Stop and leave the physics, or take part in it again."""
        self.moves = not frozen
        if frozen:
            self.motion.stop()

    def wheel_angle(self, wheel: int) -> float:
        """Angle of one wheel, right-positive [deg]."""
        if wheel not in {FRONT_LEFT, FRONT_RIGHT}:
            return 0.0
        return sm.CarlaFrame.degrees_right(self.motion.wheel_angles()[wheel])


def warm_up() -> None:
    """Compile, or load from the cache, what a car needs: no call shall wait for it."""
    car = Car(sm.Vehicle(), 0.0)
    car.advance(0.01, 1)
    car.wheel_angle(FRONT_LEFT)
    car.motion.rolled_over()
    car.reverse, car.command = True, sm.Command(0.0, 1.0, 0.0)
    car.advance(0.01, 1)


class AckermannGains(NamedTuple):
    """Gains of the Ackermann controller, in CARLA's order, with CARLA's defaults."""

    speed_kp: float = 0.15
    speed_ki: float = 0.0
    speed_kd: float = 0.25
    accel_kp: float = 0.01
    accel_ki: float = 0.0
    accel_kd: float = 0.01


class AckermannControl(NamedTuple):
    """A request: wheel angle [rad] and its rate, right-positive, speed, acceleration, jerk."""

    steer: float
    steer_speed: float
    speed: float
    acceleration: float
    jerk: float


class VehicleControl:
    """Pedals and steering of a vehicle: the client's last control, and the command it gives."""

    def __init__(self, sticky: bool = True) -> None:
        """Everything released; a control that is not ``sticky`` is released again after a tick."""
        self._sticky, self._fresh = sticky, False
        self.told: tuple[Any, ...] = _CENTRED
        """The last control, as a snapshot returns it."""
        self.gains = AckermannGains()
        self._ackermann: AckermannControl | None = None
        self._pedal = 0.0

    def direct(self, values: Any) -> sm.Command:
        """Take a vehicle control from the wire: throttle, steer, brake, switches and gear.

        Values are limited here, since the client does not; the hand brake acts as the foot brake.
        The manual gear 0 is neutral; of the others, only whether it is below 0 matters.

        Raises:
            Refused: it is no vehicle control.
        """
        match values:
            case [throttle, steer, brake, bool(hand), bool(reverse), bool(manual), int(gear)]:
                pass
            case _:
                raise Refused(f"not a vehicle control: {values!r:.80}")
        throttle, brake = _limited(throttle, 0.0), _limited(brake, 0.0)
        steer = _limited(steer, -1.0)
        gear = min(max(gear, -1), 100)
        self.told = (throttle, steer, brake, hand, reverse, manual, gear)
        self._ackermann, self._fresh = None, True
        neutral = manual and gear == 0
        return sm.Command(0.0 - steer, 0.0 if neutral else throttle, 1.0 if hand else brake)

    @property
    def reverse(self) -> bool:
        """Whether the reverse gear is engaged: by its switch, or as a manual gear below 0."""
        return bool(self.told[_GEAR] < 0 if self.told[_MANUAL] else self.told[_REVERSE])

    def ackermann(self, values: Any) -> None:
        """Take an Ackermann control from the wire; it acts until another control comes.

        Raises:
            Refused: it is none.
        """
        if not isinstance(values, list) or len(values) != len(AckermannControl._fields):
            raise Refused(f"not an Ackermann control: {values!r:.80}")
        wanted = AckermannControl(*(float(v) for v in values))
        if not all(math.isfinite(v) for v in wanted):
            raise Refused(f"an Ackermann control must be finite: {values!r:.80}")
        if self._ackermann is None:
            self._pedal = 0.0
        self._ackermann = wanted

    def set_gains(self, values: Any) -> None:
        """Take the Ackermann controller's gains from the wire.

        Raises:
            Refused: these are none.
        """
        if not isinstance(values, list) or len(values) != len(AckermannGains._fields):
            raise Refused(f"not the settings of an Ackermann controller: {values!r:.80}")
        gains = AckermannGains(*(float(v) for v in values))
        if not all(math.isfinite(v) for v in gains):
            raise Refused(f"gains must be finite: {values!r:.80}")
        self.gains = gains

    def command(self, car: Car, dt: float) -> sm.Command | None:
        """The command of an Ackermann request for the next tick; None: the last one holds.

        Speed error to acceleration by ``speed_kp`` per second, bounded by the request's; its error
        moves the pedal, which stays where it is when acceleration is right. A negative speed is
        driven in reverse.
        """
        wanted, fresh, self._fresh = self._ackermann, self._fresh, False
        if wanted is None and not self._sticky and not fresh:
            self.told = _CENTRED
            return sm.Command(0.0, 0.0, 0.0)
        if wanted is None or dt <= 0.0:
            return None
        back = wanted.speed < 0.0
        ahead = -1.0 if back else 1.0
        speed, a_x = ahead * car.motion.velocity[0], ahead * car.motion.acceleration[0]
        steer = self._steer(wanted, car.vehicle.max_wheel_angle, dt)
        target = self.gains.speed_kp * (abs(wanted.speed) - speed) / dt
        most = abs(wanted.acceleration) or 3.0
        target = min(max(target, -most), most)
        self._pedal += self.gains.accel_kp * (target - a_x)
        self._pedal = min(max(self._pedal, -1.0), 1.0)
        if wanted.speed == 0.0 and abs(speed) < 0.2:  # noqa: PLR2004 - standing, as far as it matters
            self._pedal = -1.0
        throttle, brake = max(self._pedal, 0.0), max(-self._pedal, 0.0)
        self.told = (throttle, 0.0 - steer, brake, False, back, False, -1 if back else 1)
        return sm.Command(steer, throttle, brake)

    def _steer(self, wanted: AckermannControl, lock: float, dt: float) -> float:
        """Steering command, left-positive: the angle as a share of the largest wheel angle [rad].

        Like CARLA's controller (AckermannController.cpp): what the steering law then makes of a
        command (the curve over speed, the outer wheel) is not undone, so the wheels turn less than
        requested. The rate holds from one command to the next, wherever the wheels are.
        """
        angle = min(max(0.0 - wanted.steer, -lock), lock)
        if abs(wanted.steer_speed) >= _NO_RATE:
            before, reach = 0.0 - self.told[_STEER] * lock, abs(wanted.steer_speed) * dt
            angle = before + min(max(angle - before, -reach), reach)
        return angle / lock


def _limited(value: Any, low: float) -> float:
    """Within [low, 1]; what is no number counts as 0."""
    number = float(value)
    return 0.0 if math.isnan(number) else min(max(number, low), 1.0)
