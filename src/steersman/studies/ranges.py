"""The ranges that a tuning searches: a controller's own, wider where the best trial presses on.

After every so many trials the best of them is looked at. Where one of its values lies within a
twentieth of an end of its range, that end moves away: by a factor on a logarithmic scale, by half
of the range on a linear one, never beyond what the field allows. The ranges are a function of the
trials, so an interrupted search goes on with the same ones.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from pydantic import BaseModel

from steersman.controllers.base import ControllerComponent

# Trials from one look to the next, the share of a range that is its end, and how far ends move.
_LOOK, _END, _FACTOR, _SHARE = 20, 0.05, 4.0, 0.5
_UNBOUNDED = (-math.inf, math.inf)


class GainRange(NamedTuple):
    """The values of a gain that are searched."""

    low: float
    high: float
    log: bool

    def place(self, value: float) -> float:
        """Where a value lies in the range: 0 at its low end, 1 at the high one."""
        given = (self.low, self.high, value)
        low, high, at = map(math.log, given) if self.log else given
        return (at - low) / (high - low)

    def pressed(self, value: float) -> str:
        """The end at which a value lies, ``low`` or ``high``; nothing where it is between them."""
        place = self.place(value)
        return "low" if place <= _END else "high" if place >= 1.0 - _END else ""

    def wider(self, value: float, bounds: tuple[float, float]) -> GainRange:
        """With the end that the value presses on farther away, within bounds."""
        end, (least, most) = self.pressed(value), bounds
        if end == "low":
            low = self.low / _FACTOR if self.log else self.low - _SHARE * (self.high - self.low)
            return self._replace(low=max(low, least))
        if end == "high":
            high = self.high * _FACTOR if self.log else self.high + _SHARE * (self.high - self.low)
            return self._replace(high=min(high, most))
        return self


class TriedValues(NamedTuple):
    """A finished trial: its cost and its values by name."""

    cost: float
    values: Mapping[str, float]


def declared(controller: ControllerComponent) -> dict[str, GainRange]:
    """The ranges that the controller declares."""
    return {name: GainRange(*given) for name, given in controller.search.items()}


def starts(controller: ControllerComponent) -> list[dict[str, float]]:
    """The values that a search begins with: the controller's own, then the defaults of its kind."""
    kind, present = type(controller), _present(controller)
    if any(each.is_required() for each in kind.model_fields.values()):
        return [present]
    usual = _present(kind())
    return [present] if usual == present else [present, usual]


def _present(controller: ControllerComponent) -> dict[str, float]:
    """The controller's own values, brought into the ranges."""
    out = {}
    for name, (low, high, _) in controller.search.items():
        value: Any = controller
        for part in name.split("."):
            value = getattr(value, part)
        out[name] = min(max(float(value), low), high)
    return out


def ranges(controller: ControllerComponent, tried: Sequence[TriedValues]) -> dict[str, GainRange]:
    """The ranges to search after these trials."""
    found = declared(controller)
    for count in range(_LOOK, len(tried) + 1, _LOOK):
        best = min(tried[:count], key=lambda one: one.cost)
        for name, value in best.values.items():
            found[name] = found[name].wider(value, field_bounds(controller, name))
    return found


def widened(controller: ControllerComponent, now: Mapping[str, GainRange]) -> list[str]:
    """What was widened, as sentences."""
    return [
        f"{name}: searched from {now[name].low:.4g} to {now[name].high:.4g}, not from"
        f" {first.low:.4g} to {first.high:.4g}: the best value lay at the end of that range"
        for name, first in declared(controller).items()
        if now[name] != first
    ]


def field_bounds(model: BaseModel, name: str) -> tuple[float, float]:
    """The least and the largest value that a field allows; an open bound is kept away from.

    Args:
        model: the component.
        name: the field, dotted within parts of it.
    """
    part, _, rest = name.partition(".")
    if rest:
        return field_bounds(getattr(model, part), rest)
    low, high = _UNBOUNDED
    for mark in type(model).model_fields[part].metadata:
        low = max(low, _bound(mark, "ge", "gt", low, 1.0))
        high = min(high, _bound(mark, "le", "lt", high, -1.0))
    return low, high


def _bound(mark: Any, closed: str, opened: str, otherwise: float, inwards: float) -> float:
    if getattr(mark, closed, None) is not None:
        return float(getattr(mark, closed))
    if getattr(mark, opened, None) is not None:
        limit = float(getattr(mark, opened))
        return limit + inwards * 1e-6 * max(abs(limit), 1.0)
    return otherwise
