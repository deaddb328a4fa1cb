"""Parameters of a controller that change while it drives, each as an action in [-1, 1].

The controller stays what it is: its limits, its solver's status and its fallback hold under every
set of parameters within the bounds. docs/through.md
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from contextlib import suppress
from typing import Any, NamedTuple

import numpy as np
from pydantic import BaseModel

from steersman import core_yaml
from steersman.config import dump, lay_over, resolve
from steersman.controllers.base import ControllerComponent, designed
from steersman.errors import ConfigError, suggestion
from steersman.ranges import SettingRange, search_range
from steersman.types import Decision, FloatArray, Observation
from steersman.vehicles import Vehicle

# Designs that are kept, by the values of the parameters.
_KEPT = 256


class Adjustment(NamedTuple):
    """A field of a controller that an action sets."""

    name: str
    """Dotted name of the field."""
    span: SettingRange
    """Its bounds."""
    choices: tuple[Any, ...] = ()
    """Values to choose from instead, each for an equal share of [-1, 1]."""

    def value(self, action: float) -> Any:
        """The field's value for an action, which is clipped to [-1, 1]."""
        share = 0.5 * (min(max(action, -1.0), 1.0) + 1.0)
        if self.choices:
            return self.choices[min(int(share * len(self.choices)), len(self.choices) - 1)]
        low, high = self.span.low, self.span.high
        value = low * (high / low) ** share if self.span.log else low + share * (high - low)
        return round(value) if self.span.whole else min(max(value, low), high)

    def action(self, controller: ControllerComponent) -> float:
        """The action that leads to the controller's own value, or as near to it as the bounds."""
        own = field(controller, self.name)
        if self.choices:
            near = self.choices.index(own) if own in self.choices else len(self.choices) // 2
            return (2.0 * near + 1.0) / len(self.choices) - 1.0
        low, high = self.span.low, self.span.high
        own = min(max(own, low), high)
        if self.span.log:
            return 2.0 * math.log(own / low) / math.log(high / low) - 1.0
        return float(2.0 * (own - low) / (high - low) - 1.0)


def field(model: BaseModel, name: str) -> Any:
    """The value of a field, its name dotted within parts of the model."""
    value: Any = model
    for part in name.split("."):
        value = getattr(value, part)
    return value


def _replaced(model: BaseModel, names: Sequence[str], value: Any) -> BaseModel:
    """A copy of the model with a value, which is not checked, at the dotted name."""
    first, *rest = names
    new = _replaced(getattr(model, first), rest, value) if rest else value
    return model.model_copy(update={first: new})


def flattened(tree: Mapping[str, Any], before: str = "") -> dict[str, Any]:
    """Nested names as dotted ones.

    >>> flattened({"gains": {"k_p": "0.1..1"}, "horizon": [5, 10]})
    {'gains.k_p': '0.1..1', 'horizon': [5, 10]}
    """
    out: dict[str, Any] = {}
    for name, value in tree.items():
        inner = isinstance(value, Mapping)
        out |= flattened(value, f"{before}{name}.") if inner else {f"{before}{name}": value}
    return out


def adjustments(
    base: ControllerComponent, parameters: Mapping[str, str | tuple[Any, ...]]
) -> tuple[Adjustment, ...]:
    """The fields of a controller that actions set.

    Args:
        base: the controller.
        parameters: dotted field -> LOW..HIGH, LOW..HIGH:log, A|B, or a list of values.

    Raises:
        ConfigError: there is no such field, or the controller does not allow one of the values.
    """
    return tuple(_adjustment(base, name, given) for name, given in parameters.items())


def check_prices(prices: Mapping[str, float], chosen: Sequence[Adjustment]) -> None:
    """Refuse prices of what is no parameter, or has values that are no numbers.

    Raises:
        ConfigError: at ``prices``.
    """
    known = {each.name: each for each in chosen}
    for name in prices:
        if name not in known:
            raise ConfigError(f"is no parameter{suggestion(name, known)}", ("prices", name))
        if not all(isinstance(value, int | float) for value in known[name].choices):
            raise ConfigError("has values that are no numbers, so no price", ("prices", name))


def _adjustment(base: ControllerComponent, name: str, given: str | tuple[Any, ...]) -> Adjustment:
    where = ("parameters", name)
    try:
        span = search_range(name, given) if isinstance(given, str) else SettingRange()
    except ConfigError as error:
        raise ConfigError(error.what, where) from None
    choices = [core_yaml.value(each) for each in span.choices] if isinstance(given, str) else given
    ends = (span.low, span.high)
    own = None
    with suppress(AttributeError):  # of an unknown field the error is raised below
        own = field(base, name)
    whole = isinstance(own, int)
    if whole:
        ends = math.ceil(span.low), math.floor(span.high)
    allowed = []
    for value in choices or ends:
        try:
            allowed.append(field(_with(base, name, value), name))
        except ConfigError as error:
            raise ConfigError(error.what, where) from None
    if choices:
        return Adjustment(name, span, tuple(allowed))
    if not isinstance(own, int | float):
        raise ConfigError(f"is {own!r} in the base; set it to a number there", where)
    return Adjustment(name, span._replace(low=ends[0], high=ends[1], whole=whole))


def _with(base: ControllerComponent, name: str, value: Any) -> BaseModel:
    changed = resolve("controller", lay_over(dump(base) or {}, name, value))
    assert changed is not None
    return changed


def carried(state: Any, was: Any, now: Any) -> Any:
    """A controller's state under other parameters.

    States are named tuples, nested at will. What still is as ``init`` made it (a model, tables)
    becomes what it is in the new design; what changed while driving stays.

    Args:
        state: the state under the former parameters.
        was: what ``init`` returned under them.
        now: what ``init`` returns under the new ones.

    >>> from steersman.controllers.pid import PidState
    >>> was, now = PidState(), PidState(derivative=0.5)
    >>> carried(was._replace(error=0.1), was, now)
    PidState(integral=0.0, derivative=0.5, error=0.1)
    """
    if state is was or _equal(state, was):
        return now
    alike = type(state) is type(was) is type(now)
    if isinstance(state, tuple) and alike and len(state) == len(was) == len(now):
        parts = [carried(*each) for each in zip(state, was, now, strict=True)]
        return type(state)(*parts) if hasattr(state, "_fields") else tuple(parts)
    return state


def _equal(one: Any, other: Any) -> bool:
    """Whether two numbers, texts or arrays are equal."""
    if isinstance(one, np.ndarray):
        return isinstance(other, np.ndarray) and np.array_equal(one, other)
    return isinstance(one, bool | int | float | str) and bool(one == other)


class Adjusted(NamedTuple):
    """A controller under the parameters of an action, and its state."""

    controller: ControllerComponent
    fresh: Any
    """What its ``init`` returned."""
    state: Any
    action: FloatArray
    """(m,) the action that set the parameters."""

    def step(self, observation: Observation) -> tuple[Decision, Adjusted]:
        """The controller's decision."""
        decision, state = self.controller.step(self.state, observation)
        return decision, self._replace(state=state)

    def executed(self, steer: float) -> Adjusted:
        """After ``steer`` [normalised] was executed."""
        return self._replace(state=self.controller.executed(self.state, steer))


class Adjuster:
    """Gives a base controller other parameters while it drives."""

    def __init__(
        self,
        base: ControllerComponent,
        parameters: tuple[Adjustment, ...],
        vehicle: Vehicle,
        dt: float,
    ) -> None:
        """Nothing is designed yet.

        Args:
            base: the controller with the values of all other fields.
            parameters: the fields that actions set.
            vehicle: nominal parameters.
            dt: control period [s].
        """
        self.base, self.parameters = base, parameters
        self.vehicle, self.dt = vehicle, dt
        self._designs: dict[tuple[Any, ...], tuple[ControllerComponent, Any]] = {}

    def begin(self) -> Adjusted:
        """The base before its first step, under its own parameters.

        Raises:
            ConfigError: the base finds no solution for this vehicle and its settings.
        """
        fresh = designed(self.base, self.vehicle, self.dt)
        own = np.array([each.action(self.base) for each in self.parameters])
        return Adjusted(self.base, fresh, fresh, own)

    def adjust(self, now: Adjusted, action: FloatArray) -> Adjusted:
        """The same drive under the parameters of an action (m,) in [-1, 1].

        Parameters for which the controller finds no solution, and actions that are not finite,
        leave the former parameters.
        """
        if not np.isfinite(action).all():
            return now
        numbers = action.tolist()
        values = tuple(
            each.choices.index(each.value(a)) if each.choices else each.value(a)
            for each, a in zip(self.parameters, numbers, strict=True)
        )
        with suppress(ConfigError):
            controller, fresh = self._designed(values)
            state = carried(now.state, now.fresh, fresh)
            return Adjusted(controller, fresh, state, np.array(action, dtype=np.float64))
        return now

    def _designed(self, values: tuple[Any, ...]) -> tuple[ControllerComponent, Any]:
        """The controller with these values, and what its ``init`` returns."""
        if values in self._designs:
            return self._designs[values]
        controller: BaseModel = self.base
        for each, value in zip(self.parameters, values, strict=True):
            chosen = each.choices[value] if each.choices else value
            controller = _replaced(controller, each.name.split("."), chosen)
        assert isinstance(controller, ControllerComponent)
        made = controller, designed(controller, self.vehicle, self.dt, again=True)
        if len(self._designs) >= _KEPT:
            self._designs.clear()
        self._designs[values] = made
        return made
