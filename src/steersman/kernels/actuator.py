"""Actuators: limited in speed, and for the steering with a first-order lag beside."""

from __future__ import annotations

import math

from steersman.kernels.compiled import kernel


@kernel
def slew(position: float, command: float, up: float, down: float, h: float) -> float:
    """Where an actuator gets in time ``h``: ``up`` limits it away from zero, ``down`` towards."""
    if position * command < 0.0:
        needed = abs(position) / down
        if h <= needed:
            return position - math.copysign(down * h, position)
        h -= needed
        position = 0.0
    gap = command - position
    rate = up if abs(command) > abs(position) else down
    return position + min(max(gap, -rate * h), rate * h)


@kernel
def _approach(position: float, command: float, rate: float, lag: float, h: float) -> float:
    """First-order lag whose speed is limited, after time ``h``: a ramp, then an exponential."""
    gap = command - position
    ramp = abs(gap) / rate - lag
    if ramp > 0.0:
        if h <= ramp:
            return position + math.copysign(rate * h, gap)
        h -= ramp
        gap = math.copysign(rate * lag, gap)
    return float(command - gap * math.exp(-h / lag))


@kernel
def slew_lagged(
    position: float, command: float, up: float, down: float, lag: float, h: float
) -> float:
    """As :func:`slew` for an actuator whose speed is at most its gap to the command / ``lag`` [s].

    Exact, so that it does not depend on the step either; without a lag it is ``slew``.
    """
    if lag <= 0.0:
        return slew(position, command, up, down, h)
    if position * command < 0.0:
        reached = _approach(position, command, down, lag, h)
        if reached * position > 0.0:
            return reached
        # How long the centre took: along the ramp, or beyond it on the exponential.
        gap = abs(command - position)
        ramp = max(gap / down - lag, 0.0)
        if abs(position) <= down * ramp:
            h -= abs(position) / down
        else:
            h -= ramp + lag * math.log((gap - down * ramp) / abs(command))
        position, h = 0.0, max(h, 0.0)
    rate = up if abs(command) > abs(position) else down
    return _approach(position, command, rate, lag, h)
