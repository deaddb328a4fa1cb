"""Terms of the reward: each is one class with name, unit, weight and formula.

Environments, datasets and validation add up the same terms by the same kernel
(docs/rewards_and_features.md). Tasks are sums of them: :mod:`steersman.learning.task`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, ClassVar, NamedTuple

from pydantic import field_serializer, field_validator

from steersman.config import Component, param, register, required
from steersman.kernels import reward as kernel
from steersman.kernels.formula import Formula, Group, called, compiled, from_python, own_group


class Judged(NamedTuple):
    """One control step as the reward's terms see it; the state is that after the step."""

    speed: float
    """Magnitude of the velocity [m/s]."""
    lateral_error: float
    """True distance of the centre of mass from the path, left positive [m]."""
    heading_error: float
    """Yaw less the path's tangent, in (-pi, pi] [rad]."""
    course_error: float
    """Direction of the velocity less the path's tangent, in (-pi, pi] [rad]."""
    side_slip: float
    """Angle of the velocity in the vehicle's frame, left positive [rad]."""
    curvature: float
    """Curvature of the path beside the vehicle, left positive [1/m]."""
    v_x: float
    """Longitudinal velocity [m/s]."""
    v_y: float
    """Lateral velocity, left positive [m/s]."""
    yaw_rate: float
    """Yaw rate [rad/s]."""
    steer: float
    """Executed steering command of the step, in [-1, 1]."""
    previous_steer: float
    """Executed steering command of the step before; at the start the actual steering."""
    demonstrated_steer: float
    """Steering command of the demonstrator for this step; 0 without one."""
    dt: float
    """Control period [s]."""
    wished_speed: float = math.nan
    """Speed wished then [m/s]; NaN but for joint actions."""
    a_x: float = 0.0
    """Longitudinal acceleration [m/s^2]."""
    gap: float = math.nan
    """Distance to the car ahead, bumper to bumper [m]; NaN without one, as the next three."""
    relative_speed: float = math.nan
    """Its speed less the own one [m/s]."""
    wished_gap: float = math.nan
    """Gap that is wished at the own speed [m]."""
    jerk: float = math.nan
    """Change of the longitudinal acceleration in the step, over the control period [m/s^3]."""


_STEP = Group({name: k for k, name in enumerate(Judged._fields)})


class RewardTerm(Component):
    """One term of the reward.

    ``value`` is a formula, see :mod:`steersman.kernels.formula`: it takes ``step``, a
    :class:`Judged`, and returns what the term adds to the reward, its ``weight`` included.
    """

    unit: ClassVar[str] = "-"
    """Unit of the term before it is weighted."""
    joint: ClassVar[bool] = False
    """Whether it needs a joint action, which alone is judged by its speed."""
    lead: ClassVar[bool] = False
    """Whether it needs a car ahead."""
    weight: float = param(1.0, "-", "Factor on the term.", ge=0)
    value: ClassVar[Callable[..., float]]

    def formula(self) -> Formula:
        """The compiled formula."""
        groups = {"step": _STEP, "unused": Group({}), "self": own_group(self)}
        return compiled(type(self).value, groups)


@register("reward", "progress")
class Progress(RewardTerm):
    """Velocity along the path less that across it, less speed times error, over ``scale``.

    |v cos Phi| - |v sin Phi| - |v||d| (Wu et al. 2025), with the course error as Phi.
    """

    unit = "m/s"
    side_slip: bool = param(False, "-", "Phi is the side-slip angle, as the paper words it.")
    scale: float = param(1.0, "m/s", "Divisor.", gt=0)

    def value(self, step: Judged) -> float:
        """r_track / scale, weighted."""
        phi = step.side_slip if self.side_slip else step.course_error
        along = abs(step.speed * math.cos(phi)) - abs(step.speed * math.sin(phi))
        return self.weight * ((along - abs(step.speed * step.lateral_error)) / self.scale)


@register("reward", "precision")
class Precision(RewardTerm):
    """Of size one at any speed, with a slope that does not fade near zero error.

    1 - w sqrt(min(|d| / d_0, 1)) - k |d| - |sin(course error)|/2.
    """

    root_error: float = param(0.05, "m", "d_0, error at which the root is fully paid.", gt=0)
    root_weight: float = param(0.5, "-", "w, weight of the root.", ge=0)
    linear_weight: float = param(0.5, "1/m", "k, weight of the error itself.", ge=0)

    def value(self, step: Judged) -> float:
        """r_track, weighted."""
        d = abs(step.lateral_error)
        left = 1.0 - self.root_weight * math.sqrt(min(d / self.root_error, 1.0))
        left = left - self.linear_weight * d
        return self.weight * (left - 0.5 * abs(math.sin(step.course_error)))


@register("reward", "log_error")
class LogError(RewardTerm):
    """-log(1 + (d / scale)^2) - (d / far)^2: smooth; halving any error pays about the same."""

    scale: float = param(0.02, "m", "Error of the steepest slope of the logarithm.", gt=0)
    far: float = param(0.2, "m", "Error at which the square is one.", gt=0)

    def value(self, step: Judged) -> float:
        """Weighted."""
        near, far = step.lateral_error / self.scale, step.lateral_error / self.far
        return -self.weight * (math.log(1.0 + near * near) + far * far)


@register("reward", "imitation")
class Imitation(RewardTerm):
    """Minus half the squared difference from the demonstrated steering, over ``scale``."""

    scale: float = param(1.0, "-", "Divisor.", gt=0)

    def value(self, step: Judged) -> float:
        """-r_diff / scale, weighted."""
        away = step.demonstrated_steer - step.steer
        return -self.weight * (0.5 * away * away / self.scale)


@register("reward", "steering_change")
class SteeringChange(RewardTerm):
    """Minus half the squared change of the steering command."""

    def value(self, step: Judged) -> float:
        """Weighted."""
        change = step.steer - step.previous_steer
        return -(0.5 * self.weight * change * change)


@register("reward", "speed_progress")
class SpeedProgress(RewardTerm):
    """Velocity along the path over the wished speed, at most 1."""

    joint = True

    def value(self, step: Judged) -> float:
        """Weighted; where standstill is wished, standing is all of it."""
        along = step.speed * math.cos(step.course_error)
        return self.weight * min((along + 1.0) / (step.wished_speed + 1.0), 1.0)


@register("reward", "speed_error")
class SpeedErrorPrice(RewardTerm):
    """Minus the difference of speed and wished speed, over ``scale``."""

    joint = True
    scale: float = param(1.0, "m/s", "Divisor.", gt=0)

    def value(self, step: Judged) -> float:
        """Weighted."""
        return -(self.weight * abs(step.speed - step.wished_speed) / self.scale)


@register("reward", "comfort")
class Comfort(RewardTerm):
    """Minus half the squared longitudinal acceleration, over ``scale``."""

    joint = True
    scale: float = param(3.0, "m/s^2", "Acceleration at which the price is half the weight.", gt=0)

    def value(self, step: Judged) -> float:
        """Weighted."""
        share = step.a_x / self.scale
        return -(0.5 * self.weight * share * share)


@register("reward", "gap")
class GapPrice(RewardTerm):
    """Minus the difference of gap and wished gap over ``scale``, at most 1.

    Half of it is the size, half its square root, so that the slope does not fade near zero.
    """

    joint = lead = True
    scale: float = param(10.0, "m", "Difference from which on the price is the weight.", gt=0)

    def value(self, step: Judged) -> float:
        """Weighted."""
        share = min(abs(step.gap - step.wished_gap) / self.scale, 1.0)
        return -(0.5 * self.weight * (share + math.sqrt(share)))


@register("reward", "jerk")
class JerkPrice(RewardTerm):
    """Minus half the squared longitudinal jerk over ``scale``; the share is at most ``most``."""

    joint = lead = True
    scale: float = param(5.0, "m/s^3", "Jerk at which the price is half the weight.", gt=0)
    most: float = param(4.0, "-", "Largest share of the scale.", gt=0)

    def value(self, step: Judged) -> float:
        """Weighted."""
        share = min(abs(step.jerk) / self.scale, self.most)
        return -(0.5 * self.weight * share * share)


@register("reward", "function")
class FunctionTerm(RewardTerm):
    """A plain Python function of a :class:`Judged`, called at every step of every vehicle.

    It costs some microseconds a step; a training goes on where one of its name is given again.
    """

    function: Any = required("-", "Python function of the judged step.")

    @field_validator("function", mode="before")
    @classmethod
    def _callable(cls, value: Any) -> Any:
        if not callable(value):
            raise ValueError(
                "a file cannot hold a Python function; register it as a reward term "
                "(docs/rewards_and_features.md)"
            )
        return value

    @field_serializer("function")
    def _named(self, function: Callable[[Judged], float]) -> str:
        return f"{function.__module__}.{getattr(function, '__qualname__', 'function')}"

    def formula(self) -> Formula:
        """The function behind an address."""
        return from_python(
            lambda step: self.weight * called(self.function, Judged(*step.tolist())),
            kernel.N_JUDGED,
        )
