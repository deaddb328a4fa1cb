"""Schedules: numbers that change over training, as functions of environment steps."""

from __future__ import annotations

from abc import abstractmethod
from typing import ClassVar

from steersman.config import Component, param, register


class Schedule(Component):
    """A value over training."""

    @abstractmethod
    def value(self, step: float, total: float) -> float:
        """The value at environment step ``step`` of ``total``."""


@register("schedule", "constant")
class Constant(Schedule):
    """The same value throughout; a number alone is one."""

    bare_number: ClassVar[str] = "at"

    at: float = param(0.0, "-", "The value.")

    def value(self, step: float, total: float) -> float:
        """The value at environment step ``step`` of ``total``."""
        return self.at


@register("schedule", "linear")
class Linear(Schedule):
    """From one value to another over a share of the training, then held."""

    start: float = param(1.0, "-", "Value at the beginning.")
    end: float = param(0.0, "-", "Value at the end.")
    until: float = param(
        1.0, "-", "Share of the training after which the end is reached.", gt=0, le=1
    )

    def value(self, step: float, total: float) -> float:
        """The value at environment step ``step`` of ``total``."""
        done = min(step / (self.until * total), 1.0)
        return self.start + (self.end - self.start) * done


@register("schedule", "hold_then_decay")
class HoldThenDecay(Schedule):
    """Constant for a share of the training, then an exponential fall to a final value."""

    start: float = param(1e-3, "-", "Value at the beginning.", gt=0)
    end: float = param(1e-5, "-", "Value at the end.", gt=0)
    hold: float = param(0.5, "-", "Share of the training before the fall.", ge=0, lt=1)

    def value(self, step: float, total: float) -> float:
        """The value at environment step ``step`` of ``total``."""
        done = min(max((step / total - self.hold) / (1.0 - self.hold), 0.0), 1.0)
        return float(self.start * (self.end / self.start) ** done)


@register("schedule", "cyclical")
class Cyclical(Schedule):
    """The paper's learning rate: constant for half the training, then decaying triangles.

    Cycles of ``period`` environment steps go linearly from eta_max to eta_min and back; after k
    cycles both bounds have decayed by ``decay`` to the power k.
    """

    maximum: float = param(1e-3, "-", "eta_max,0, also the constant of the first half.", gt=0)
    ratio: float = param(0.1, "-", "eta_min,0 over eta_max,0.", gt=0, le=1)
    decay: float = param(0.997, "-", "lambda, decay of both bounds per cycle.", gt=0, le=1)
    period: float = param(32.0, "steps", "Environment steps in a cycle.", gt=0)
    hold: float = param(0.5, "-", "Share of the training before the first cycle.", ge=0, lt=1)

    def value(self, step: float, total: float) -> float:
        """The value at environment step ``step`` of ``total``."""
        since = step - self.hold * total
        if since < 0.0:
            return self.maximum
        cycle, within = divmod(since, self.period)
        bound = self.maximum * float(self.decay**cycle)
        low = bound * self.ratio
        return low + (bound - low) * abs(1.0 - 2.0 * within / self.period)
