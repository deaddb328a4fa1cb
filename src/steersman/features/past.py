"""What was: integral, commands and values of the steps before."""

from __future__ import annotations

from collections.abc import Sequence

from steersman.config import param, register
from steersman.features.base import Feature, Loop
from steersman.types import Observation


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

    count: int = param(1, "-", "Control steps back in time.", ge=1, le=1000)

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


@register("feature", "base_command_less_last")
class BaseCorrection(Feature):
    """Command of the base controller less the last command; last feature of a residual policy."""

    scale = 20.0  # a car at speed is steered by a twentieth in a step

    def value(self, loop: Loop) -> float:
        """Difference of normalised steering [-]."""
        return loop.base_command - loop.last_command
