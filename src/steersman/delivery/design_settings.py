"""Which settings of a controller its design is made of.

The C code holds the design as it was exported. A setting that the design is made of would
therefore, changed there, act in one half of the controller alone: it is no parameter.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from pydantic import BaseModel

from steersman.controllers.base import ControllerComponent, designed
from steersman.delivery.parameter_limits import limits
from steersman.delivery.translate.values import field_names, key
from steersman.errors import ConfigError
from steersman.vehicles import Vehicle


class DesignSettings:
    """Compares a controller's design with those of changed settings.

    Args:
        controller: the controller.
        vehicle: nominal parameters.
        dt: control period [s].
    """

    def __init__(self, controller: ControllerComponent, vehicle: Vehicle, dt: float) -> None:
        """Nothing is compared yet."""
        self._controller, self._vehicle, self._dt = controller, vehicle, dt
        self._own: list[Any] = []
        self._known: dict[str, bool] = {}

    def acts(self, path: str) -> bool:
        """Whether another value of the setting of that dotted path makes another design."""
        if path not in self._known:
            self._known[path] = self._compared(path)
        return self._known[path]

    def _compared(self, path: str) -> bool:
        self._own = self._own or self._numbers(self._controller)
        return any(
            self._numbers(replaced(self._controller, path.split("."), value)) != self._own
            for value in other_values(self._controller, path)
        )

    def _numbers(self, controller: Any) -> list[Any]:
        """All that is known of a design, None if there is no solution."""
        try:
            return [*_leaves(designed(controller, self._vehicle, self._dt, again=True))]
        except ConfigError:
            return []


def _leaves(value: Any) -> Iterator[Any]:
    """What a design holds, so that it can be compared; of other objects their class alone."""
    if isinstance(value, tuple):
        for each in value:
            yield from _leaves(each)
    elif dataclasses.is_dataclass(value) and not isinstance(value, type):
        names = [each for each in field_names(type(value)) if not each.startswith("_")]
        yield from _leaves(tuple(getattr(value, name) for name in names))
    elif isinstance(value, BaseModel):
        yield value
    elif isinstance(value, np.ndarray | bool | int | float | str | None):
        yield key(value)
    else:
        yield type(value)


def other_values(controller: ControllerComponent, path: str) -> list[float]:
    """Allowed values of a setting, below and above its own [its unit]."""
    *way, name = path.split(".")
    owner: Any = controller
    for each in way:
        owner = owner[int(each)] if each.isdecimal() else getattr(owner, each)
    own, (low, high) = float(getattr(owner, name)), limits(type(owner).model_fields[name])
    wanted = (1.25 * own, 0.5 * own, 4.0 * own, own + 1.0, own - 1.0)
    ends = [each for each in (low, high) if math.isfinite(each)]
    middle = [0.5 * (own + each) for each in ends]
    return [x for x in dict.fromkeys((*wanted, *middle)) if low <= x <= high and x != own]


def replaced(owner: Any, names: Sequence[str], value: float) -> Any:
    """A copy with a value, which is not checked, at a path through parts and their places."""
    if not names:
        return value
    first, *rest = names
    if first.isdecimal():
        at = int(first)
        return type(owner)([*owner[:at], replaced(owner[at], rest, value), *owner[at + 1 :]])
    return owner.model_copy(update={first: replaced(getattr(owner, first), rest, value)})
