"""Features of the observation: the numbers that a policy's network can read.

A feature is one class: name, unit, scale, sign under mirroring and formula. Training, exported
policies, their cards and their C code all follow from it (docs/rewards_and_features.md).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import ClassVar, Protocol, final

from steersman.config import Component, param, register
from steersman.kernels import encode as kernel
from steersman.kernels import observe
from steersman.kernels.formula import Formula, Group, compiled, own_group
from steersman.types import FloatArray, Observation

# The formulas that renew a feature's cells.
UPDATES = ("begin", "advance", "remember")
_SEEN = Group(
    {
        "lateral_error": observe.O_D,
        "heading_error": observe.O_HEADING,
        "v_x": observe.O_VX,
        "v_y": observe.O_VY,
        "yaw_rate": observe.O_RATE,
        "steer": observe.O_STEER,
        "curvature": observe.O_KAPPA,
    },
    ("preview", observe.O_PREVIEW),
)
_LOOP = Group(
    {
        "last_command": kernel.LAST_COMMAND,
        "base_command": kernel.BASE_COMMAND,
        "dt": kernel.DT,
        "spacing": kernel.SPACING,
        "last_share": kernel.LAST_SHARE,
    },
    ("wishes", kernel.WISHES),
)


class Loop(Protocol):
    """What a feature can read beside the observation."""

    last_command: float
    """Steering command that was executed in the last step [-]."""
    base_command: float
    """Steering command of the base controller that the policy corrects [-]."""
    dt: float
    """Control period [s]."""
    spacing: float
    """Distance between waypoints [m]."""
    last_share: float
    """Share of the wished speed that the last joint action allowed [-]."""
    wishes: FloatArray
    """Rows of wished speed [m/s] and distance ahead [m]; under a joint action only."""


class Feature(Component):
    """One or several numbers that a network reads.

    ``value`` is a formula, see :mod:`steersman.kernels.formula`. It may take ``seen`` (an
    :class:`~steersman.types.Observation`), ``loop`` (a :class:`Loop`), ``memory`` (this feature's
    cells) and ``i`` (which of its numbers). A feature that remembers something has ``cells`` > 0
    and formulas for cell ``i``: ``begin`` at the first observation of a drive, ``advance`` at
    each later one, ``remember`` once the step's command is known. Cells are renewed in descending
    order, so that ``memory[i - 1]`` is still the old value.
    """

    unit: ClassVar[str] = "-"
    """Unit of its numbers."""
    sign: ClassVar[float] = -1.0
    """Factor under mirroring left and right: -1 for what is positive to the left, else 1."""
    scale: ClassVar[float] = 1.0
    """Factor that brings it to about unit size [1/unit]."""

    joint: ClassVar[bool] = False
    """Whether it needs a joint action, which alone knows the wished speed."""

    value: ClassVar[Callable[..., float]]
    begin: ClassVar[Callable[..., float] | None] = None
    advance: ClassVar[Callable[..., float] | None] = None
    remember: ClassVar[Callable[..., float] | None] = None

    @property
    def size(self) -> int:
        """How many numbers it has."""
        return 1

    @property
    def cells(self) -> int:
        """How many numbers it remembers."""
        return 0

    @property
    def reads(self) -> int:
        """How many waypoints it reads."""
        return 0

    def label(self, i: int, spacing: float) -> str:
        """Name of number ``i`` and its unit in brackets; waypoints are ``spacing`` [m] apart."""
        return f"{self.kind} [{self.unit}]"

    def factor(self, i: int, spacing: float) -> float:
        """Scale of number ``i``."""
        return self.scale

    def mirrored(self, i: int) -> float:
        """Sign under mirroring of number ``i``."""
        return self.sign

    @final
    @property
    def formulas(self) -> dict[str, Formula]:
        """The compiled formulas by name."""
        found = {name: getattr(type(self), name, None) for name in ("value", *UPDATES)}
        groups = {"seen": _SEEN, "loop": _LOOP, "self": own_group(self), "memory": Group({})}
        return {name: compiled(each, groups) for name, each in found.items() if each is not None}


@register("feature", "waypoints")
class Waypoints(Feature):
    """Waypoints ahead, x and y of each in the vehicle's frame."""

    unit = "m"
    count: int = param(15, "-", "Waypoints, from the one beside the vehicle on.", ge=1)

    @property
    def size(self) -> int:
        """Two numbers for each."""
        return 2 * self.count

    @property
    def reads(self) -> int:
        """All of them."""
        return self.count

    def label(self, i: int, spacing: float) -> str:
        """Number and axis."""
        return f"waypoint_{i // 2}_{'xy'[i % 2]} [m]"

    def factor(self, i: int, spacing: float) -> float:
        """One over the preview's length for x, four times as much for y."""
        reach = max(self.count - 1, 1) * spacing
        return (4.0 if i % 2 else 1.0) / reach

    def mirrored(self, i: int) -> float:
        """Only y changes its sign."""
        return -1.0 if i % 2 else 1.0

    def value(self, seen: Observation, i: int) -> float:
        """X or y [m]."""
        return float(seen.preview[i // 2, i % 2])


@register("feature", "road_curvatures")
class RoadCurvatures(Feature):
    """Curvature of the road beside the vehicle, then its mean over 2, 4, ... waypoints ahead.

    Twice the road's offset from its tangent beside the vehicle, over the squared distance. The
    tangent follows from the sensed heading error, so these features hold the road's shape and not
    the vehicle's own error (small angles).
    """

    unit, scale = "1/m", 20.0
    count: int = param(7, "-", "Curvatures.", ge=1)

    @property
    def size(self) -> int:
        """One number for each."""
        return self.count

    @property
    def reads(self) -> int:
        """Every second waypoint."""
        return 2 * self.count - 1

    def label(self, i: int, spacing: float) -> str:
        """The distance over which it is the mean."""
        return f"road_curvature_{2 * i * spacing:g}m [1/m]"

    def value(self, seen: Observation, loop: Loop, i: int) -> float:
        """Mean curvature [1/m]."""
        if i == 0:
            return seen.curvature
        u = 2 * i * loop.spacing
        ahead = seen.preview[2 * i, 0] - seen.preview[0, 0]
        offset = seen.preview[2 * i, 1] - seen.preview[0, 1] + seen.heading_error * ahead
        return float(2.0 * offset / (u * u))


@register("feature", "road_accelerations")
class RoadAccelerations(RoadCurvatures):
    """Lateral acceleration that the road asks for at the present speed: ``road_curvatures`` v^2."""

    unit, scale = "m/s^2", 0.1

    def label(self, i: int, spacing: float) -> str:
        """The distance over which it is the mean."""
        return f"road_acceleration_{2 * i * spacing:g}m [m/s^2]"

    def value(self, seen: Observation, loop: Loop, i: int) -> float:
        """Mean curvature times v_x^2 [m/s^2]."""
        square = seen.v_x * seen.v_x
        if i == 0:
            return square * seen.curvature
        u = 2 * i * loop.spacing
        ahead = seen.preview[2 * i, 0] - seen.preview[0, 0]
        offset = seen.preview[2 * i, 1] - seen.preview[0, 1] + seen.heading_error * ahead
        return float(square * 2.0 * offset / (u * u))


@register("feature", "v_x")
class LongitudinalVelocity(Feature):
    """Longitudinal velocity."""

    unit, sign, scale = "m/s", 1.0, 1.0 / 15.0

    def value(self, seen: Observation) -> float:
        """As sensed [m/s]."""
        return seen.v_x


@register("feature", "v_y")
class LateralVelocity(Feature):
    """Lateral velocity of the centre of mass, left positive."""

    unit, scale = "m/s", 0.5

    def value(self, seen: Observation) -> float:
        """As sensed [m/s]."""
        return seen.v_y


@register("feature", "yaw_rate")
class YawRate(Feature):
    """Yaw rate."""

    unit = "rad/s"

    def value(self, seen: Observation) -> float:
        """As sensed [rad/s]."""
        return seen.yaw_rate


@register("feature", "yaw_rate_error")
class YawRateError(Feature):
    """Yaw rate less that of the road, v_x times its curvature beside the vehicle."""

    unit, scale = "rad/s", 4.0

    def value(self, seen: Observation) -> float:
        """As sensed [rad/s]."""
        return seen.yaw_rate - seen.v_x * seen.curvature


@register("feature", "speed_across")
class SpeedAcross(Feature):
    """Speed away from the path to the left, for small angles: the rate of the lateral error."""

    unit = "m/s"

    def value(self, seen: Observation) -> float:
        """v_y + v_x times the heading error [m/s]."""
        return seen.v_y + seen.v_x * seen.heading_error


@register("feature", "steer")
class ActualSteering(Feature):
    """Actual normalised steering, which follows the command with delay and rate limit."""

    scale = 5.0

    def value(self, seen: Observation) -> float:
        """As sensed [-]."""
        return seen.steer


@register("feature", "lateral_error")
class LateralError(Feature):
    """Distance from the path, left positive."""

    unit = "m"

    def value(self, seen: Observation) -> float:
        """As sensed [m]."""
        return seen.lateral_error


@register("feature", "heading_error")
class HeadingError(Feature):
    """Yaw less the path's tangent."""

    unit, scale = "rad", 4.0

    def value(self, seen: Observation) -> float:
        """As sensed [rad]."""
        return seen.heading_error


@register("feature", "lateral_error_fine")
class FineLateralError(Feature):
    """Lateral error d on a scale that is fine near zero, d / (half + |d|)."""

    half: float = param(0.05, "m", "Error at half range.", gt=0)

    def value(self, seen: Observation) -> float:
        """In (-1, 1)."""
        return seen.lateral_error / (self.half + abs(seen.lateral_error))


@register("feature", "heading_error_fine")
class FineHeadingError(Feature):
    """Heading error on a scale that is fine near zero, as the lateral error's."""

    half: float = param(0.02, "rad", "Heading error at half range.", gt=0)

    def value(self, seen: Observation) -> float:
        """In (-1, 1)."""
        return seen.heading_error / (self.half + abs(seen.heading_error))


@register("feature", "lateral_error_integral")
class LateralErrorIntegral(Feature):
    """Bounded integral of the lateral error since the start of the drive."""

    unit = "m s"
    limit: float = param(0.25, "m s", "Bound of the integral.", gt=0)

    @property
    def cells(self) -> int:
        """The integral."""
        return 1

    def factor(self, i: int, spacing: float) -> float:
        """One at the bound."""
        return 1.0 / self.limit

    def value(self, memory: Sequence[float]) -> float:
        """The integral [m s]."""
        return memory[0]

    def advance(self, seen: Observation, loop: Loop, memory: Sequence[float]) -> float:
        """Euler's rule; an error beyond half a metre counts as that, so that no outlier stays."""
        total = memory[0] + min(max(seen.lateral_error, -0.5), 0.5) * loop.dt
        return min(max(total, -self.limit), self.limit)


@register("feature", "last_command")
class LastCommand(Feature):
    """Steering command that was executed in the last step."""

    scale = 5.0

    def value(self, loop: Loop) -> float:
        """Normalised steering [-]."""
        return loop.last_command


class _Past(Feature):
    """Values of the last control steps, newest first."""

    count: int = param(1, "-", "Control steps back in time.", ge=1)

    @property
    def size(self) -> int:
        """One number for each step."""
        return self.count

    @property
    def cells(self) -> int:
        """All of them."""
        return self.count

    def value(self, memory: Sequence[float], i: int) -> float:
        """As remembered."""
        return memory[i]


@register("feature", "past_errors")
class PastErrors(_Past):
    """Lateral errors of the last control steps, newest first; at the start the present one."""

    unit = "m"

    def label(self, i: int, spacing: float) -> str:
        """How many steps ago."""
        return f"lateral_error_{i + 1}_ago [m]"

    def begin(self, seen: Observation) -> float:
        """The present error [m]."""
        return seen.lateral_error

    def remember(self, seen: Observation, memory: Sequence[float], i: int) -> float:
        """The error of this step [m]; the others move on by one."""
        return memory[i - 1] if i > 0 else seen.lateral_error


@register("feature", "past_yaw_rates")
class PastYawRates(_Past):
    """Yaw rates of the last control steps, newest first; at the start the present one."""

    unit = "rad/s"

    def label(self, i: int, spacing: float) -> str:
        """How many steps ago."""
        return f"yaw_rate_{i + 1}_ago [rad/s]"

    def begin(self, seen: Observation) -> float:
        """The present yaw rate [rad/s]."""
        return seen.yaw_rate

    def remember(self, seen: Observation, memory: Sequence[float], i: int) -> float:
        """The yaw rate of this step [rad/s]; the others move on by one."""
        return memory[i - 1] if i > 0 else seen.yaw_rate


@register("feature", "past_commands")
class PastCommands(_Past):
    """Commands before the last one, newest first; at the start the actual steering."""

    scale = 5.0

    def label(self, i: int, spacing: float) -> str:
        """How many steps ago; one step ago is ``last_command``."""
        return f"command_{i + 2}_ago [-]"

    def begin(self, seen: Observation) -> float:
        """The actual steering [-]."""
        return seen.steer

    def remember(self, loop: Loop, memory: Sequence[float], i: int) -> float:
        """The last command [-]; the others move on by one."""
        return memory[i - 1] if i > 0 else loop.last_command


@register("feature", "past_speeds")
class PastSpeeds(_Past):
    """Speeds of the last control steps less the present one, newest first: what pedals did."""

    unit, sign = "m/s", 1.0

    def label(self, i: int, spacing: float) -> str:
        """How many steps ago."""
        return f"v_x_{i + 1}_ago_less_now [m/s]"

    def value(  # type: ignore[override]
        self, seen: Observation, memory: Sequence[float], i: int
    ) -> float:
        """Difference of longitudinal velocities [m/s]."""
        return memory[i] - seen.v_x

    def begin(self, seen: Observation) -> float:
        """The present speed [m/s]."""
        return seen.v_x

    def remember(self, seen: Observation, memory: Sequence[float], i: int) -> float:
        """The speed of this step [m/s]; the others move on by one."""
        return memory[i - 1] if i > 0 else seen.v_x


@register("feature", "wished_speeds")
class WishedSpeeds(Feature):
    """Speed wished now beside the vehicle and at every third waypoint ahead."""

    unit, sign, scale, joint = "m/s", 1.0, 1.0 / 15.0, True
    count: int = param(kernel.N_WISHES, "-", "Places.", ge=1, le=kernel.N_WISHES)

    @property
    def size(self) -> int:
        """One number for each place."""
        return self.count

    @property
    def reads(self) -> int:
        """Up to the last place."""
        return kernel.STRIDE * (self.count - 1) + 1

    def label(self, i: int, spacing: float) -> str:
        """The distance ahead."""
        return f"wished_speed_{kernel.STRIDE * i * spacing:g}m [{self.unit}]"

    def value(self, loop: Loop, i: int) -> float:
        """The speed [m/s]."""
        return float(loop.wishes[i, 0])


@register("feature", "speed_error")
class SpeedError(Feature):
    """Longitudinal velocity less the speed wished here and now."""

    unit, sign, scale, joint = "m/s", 1.0, 0.3, True

    def value(self, seen: Observation, loop: Loop) -> float:
        """Positive where the car is too fast [m/s]."""
        return float(seen.v_x - loop.wishes[0, 0])


@register("feature", "last_share")
class LastShare(Feature):
    """Share of the wished speed that the last action allowed."""

    sign, joint = 1.0, True

    def value(self, loop: Loop) -> float:
        """In [0, 1]."""
        return loop.last_share


@register("feature", "base_command_less_last")
class BaseCorrection(Feature):
    """Command of the base controller less the last command; last feature of a residual policy."""

    scale = 20.0  # a car at speed is steered by a twentieth in a step

    def value(self, loop: Loop) -> float:
        """Difference of normalised steering [-]."""
        return loop.base_command - loop.last_command
