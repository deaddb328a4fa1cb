"""Controls of a vehicle: what a client last told it, and the command that follows from that."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple

from steersman.kernels import vehicle as kernel
from steersman.standin.wire import Refused
from steersman.types import Command

if TYPE_CHECKING:
    from steersman.standin.car import Car

# Throttle, steer (right-positive), brake, hand brake, reverse, manual gear, gear.
_CENTRED = (0.0, 0.0, 0.0, False, False, False, 0)
_STEER = 1
# A slower rate than this counts as none being asked for [rad/s].
_NO_RATE = 1e-3


class Gains(NamedTuple):
    """Gains of the Ackermann controller, in CARLA's order, with CARLA's defaults."""

    speed_kp: float = 0.15
    speed_ki: float = 0.0
    speed_kd: float = 0.25
    accel_kp: float = 0.01
    accel_ki: float = 0.0
    accel_kd: float = 0.01


class Ackermann(NamedTuple):
    """A request: wheel angle [rad] and its rate, right-positive, speed, acceleration, jerk."""

    steer: float
    steer_speed: float
    speed: float
    acceleration: float
    jerk: float


class Control:
    """What moves a vehicle's pedals and steering."""

    def __init__(self) -> None:
        """Everything released."""
        self.told: tuple[Any, ...] = _CENTRED
        """The last control, as a snapshot returns it."""
        self.gains = Gains()
        self._ackermann: Ackermann | None = None
        self._pedal = 0.0

    def direct(self, values: Any) -> Command:
        """Take a vehicle control from the wire: throttle, steer, brake, switches and gear.

        Values are limited here, since the client does not; the hand brake acts as the foot brake.

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
        self._ackermann = None
        return Command(0.0 - steer, 0.0 if reverse else throttle, 1.0 if hand else brake)

    def ackermann(self, values: Any) -> None:
        """Take an Ackermann control from the wire; it acts until another control comes.

        Raises:
            Refused: it is none.
        """
        if not isinstance(values, list) or len(values) != len(Ackermann._fields):
            raise Refused(f"not an Ackermann control: {values!r:.80}")
        wanted = Ackermann(*(float(v) for v in values))
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
        if not isinstance(values, list) or len(values) != len(Gains._fields):
            raise Refused(f"not the settings of an Ackermann controller: {values!r:.80}")
        gains = Gains(*(float(v) for v in values))
        if not all(math.isfinite(v) for v in gains):
            raise Refused(f"gains must be finite: {values!r:.80}")
        self.gains = gains

    def command(self, car: Car, dt: float) -> Command | None:
        """The command of an Ackermann request for the next tick; none: the last one holds.

        Speed error to acceleration by ``speed_kp`` per second, bounded by the request's; its error
        moves the pedal, which stays where it is when acceleration is right.
        """
        wanted = self._ackermann
        if wanted is None or dt <= 0.0:
            return None
        speed, a_x = float(car.state[kernel.VX]), float(car.state[kernel.AX])
        steer = self._steer(wanted, car.vehicle.max_wheel_angle, dt)
        target = self.gains.speed_kp * (wanted.speed - speed) / dt
        most = abs(wanted.acceleration) or 3.0
        target = min(max(target, -most), most)
        self._pedal += self.gains.accel_kp * (target - a_x)
        self._pedal = min(max(self._pedal, -1.0), 1.0)
        if wanted.speed == 0.0 and abs(speed) < 0.2:  # noqa: PLR2004 - standing, as far as it matters
            self._pedal = -1.0
        throttle, brake = max(self._pedal, 0.0), max(-self._pedal, 0.0)
        self.told = (throttle, 0.0 - steer, brake, False, False, False, 1)
        return Command(steer, throttle, brake)

    def _steer(self, wanted: Ackermann, lock: float, dt: float) -> float:
        """Steering command, left-positive: the angle as a share of the largest wheel angle [rad].

        Like CARLA's controller (AckermannController.cpp): what the steering law then makes of a
        command (the curve over speed, the outer wheel) is not undone, so the wheels turn less than
        asked for. The rate holds from one command to the next, wherever the wheels are.
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
