"""A controller whose parameters a policy sets: fields are numbers in C, the design is made anew."""

from __future__ import annotations

import ast
import inspect
import math
from collections.abc import Iterable, Sequence
from functools import cache
from typing import TYPE_CHECKING, Any

from pydantic import BaseModel

from steersman.controllers.adjustment import Adjusted, Adjuster, Adjustment
from steersman.delivery.translate.array_functions import Named, Special
from steersman.delivery.translate.lines import bare
from steersman.delivery.translate.values import (
    Bundle,
    NotTranslatable,
    Scalar,
    Static,
    Value,
    field_names,
    opened,
    type_of,
)

if TYPE_CHECKING:
    from steersman.delivery.translate.expressions import Expressions

Names = Sequence[str]


@cache
def _with_fields(model: type) -> type:
    """A class with the fields and the methods of a model, for tuples of values."""
    members: dict[str, Any] = {}
    for each in reversed(model.__mro__):
        own = {k: v for k, v in vars(each).items() if not k.startswith("__")}
        members |= {
            k: v for k, v in own.items() if inspect.isfunction(v) or isinstance(v, property)
        }
    fields = tuple(model.model_fields)  # type: ignore[attr-defined]
    return type(f"Adjusted{model.__name__}", (), {**members, "_fields": fields})


def adjustable(model: BaseModel, names: Iterable[Names]) -> Bundle:
    """A controller, or a part of it, as a tuple of its fields, so that those named can change."""
    items: list[Value] = []
    for name in type(model).model_fields:
        value = getattr(model, name)
        inside = [rest for first, *rest in names if first == name and rest]
        items.append(adjustable(value, inside) if inside else Static(value))
    return Bundle(_with_fields(type(model)), tuple(items))


def begun(adjuster: Adjuster, now: Adjusted, state: Value) -> Value:
    """The values of ``now``, of which ``state`` are those, with a controller that can change."""
    assert isinstance(state, Bundle)
    names = [each.name.split(".") for each in adjuster.parameters]
    return Bundle(state.cls, (adjustable(now.controller, names), *state.items[1:]))


def _changed(owner: Value, names: Names, value: Value) -> Value:
    if not names:
        return value
    assert isinstance(owner, Bundle)
    pairs = zip(field_names(owner.cls), owner.items, strict=True)
    parts = (_changed(x, names[1:], value) if k == names[0] else x for k, x in pairs)
    return Bundle(owner.cls, tuple(parts))


def _carried(out: Expressions, state: Value, was: Value, now: Value) -> Value:
    """See :func:`steersman.controllers.adjustment.carried`."""
    state, was, now = opened(state), opened(was), opened(now)
    if isinstance(was, Static) and type_of(was) == type_of(now):
        return state
    if isinstance(state, Bundle) and isinstance(was, Bundle) and isinstance(now, Bundle):
        parts = zip(state.items, was.items, now.items, strict=True)
        return Bundle(state.cls, tuple(_carried(out, *each) for each in parts))
    if isinstance(state, Static) and isinstance(now, Scalar):  # no step changes it
        return now
    if not isinstance(state, Scalar):
        raise NotTranslatable("a design of more than numbers, under parameters that a policy sets")
    test = out.compare(ast.Eq, state, was)
    assert isinstance(test, Scalar)
    return out.either(test, now, state)


def _adjust(out: Expressions, given: list[Value], _: Named) -> Value:
    """The drive under the parameters of an action; one that is not finite leaves the former."""
    adjuster, now, action = given
    of: Adjuster = out.static(adjuster)
    assert isinstance(now, Bundle)
    actions = out.items(action)
    finite = out.every([out.truth(out.call(math.isfinite, [each])) for each in actions])
    with out.collected() as lines:
        controller = now["controller"]
        for each, number in zip(of.parameters, actions, strict=True):
            value = out.local(out.call(Adjustment.value, [Static(each), out.local(number)]))
            controller = _changed(controller, each.name.split("."), value)
        given = [Static(of.vehicle), Static(of.dt)]
        fresh = out.method(controller, "redesign", given, {})
        state = _carried(out, now["state"], now["fresh"], fresh)
        new = out.local(Bundle(Adjusted, (controller, fresh, state, action)))
    otherwise: list[str] = []
    merged = out.merged(new, now, lines, otherwise, "adjusted")
    assert isinstance(finite, Scalar)
    out.lines += [f"if ({bare(finite.text)}) {{", *lines, "} else {", *otherwise, "}"]
    return merged


ADAPTIVE_CALLS: dict[Any, Special] = {Adjuster.adjust: Special(_adjust)}
