"""A controller whose parameters a policy sets: fields are numbers in C, the design is made anew."""

from __future__ import annotations

import ast
import inspect
import math
from collections.abc import Iterable, Sequence
from dataclasses import is_dataclass
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np
from pydantic import BaseModel

from steersman.controllers.adjustment import Adjusted, Adjuster, Adjustment
from steersman.controllers.model_error import ModelError
from steersman.controllers.mpc_delay_plan import Tables
from steersman.delivery.translate import arrays
from steersman.delivery.translate.array_functions import Named, Special
from steersman.delivery.translate.lines import bare
from steersman.delivery.translate.values import (
    BOOL,
    REAL,
    Array,
    Bundle,
    NotTranslatable,
    Scalar,
    Static,
    Value,
    field_names,
    leaves,
    opened,
    type_of,
)
from steersman.vehicles import Vehicle

if TYPE_CHECKING:
    from steersman.delivery.translate.expressions import Expressions

Names = Sequence[str]
_TABLE = "table"


@cache
def _with_fields(model: type, *more: str) -> type:
    """A class with the fields and the methods of a model, for tuples of values, and more fields."""
    members: dict[str, Any] = {}
    for each in reversed(model.__mro__):
        own = {k: v for k, v in vars(each).items() if not k.startswith("__")}
        members |= {
            k: v for k, v in own.items() if inspect.isfunction(v) or isinstance(v, property)
        }
    fields = (*model.model_fields, *more)  # type: ignore[attr-defined]
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
    car = any(first == "model_error" for first, *_ in names)
    items = (_parts(each, car) for each in state.items[1:])
    return Bundle(state.cls, (adjustable(now.controller, names), *items))


def _parts(value: Value, car: bool) -> Value:
    """A design with its dataclasses as tuples of their fields; what they cache is left out.

    ``car``: and so its vehicle, of which parameters change the figures.
    """
    if isinstance(value, Bundle):
        return Bundle(value.cls, tuple(_parts(each, car) for each in value.items))
    known = value.value if isinstance(value, Static) else None
    if isinstance(known, Vehicle) and car:
        figures = tuple(Static(getattr(known, k)) for k in type(known).model_fields)
        return Bundle(_with_fields(type(known), _TABLE), (*figures, opened(Static(known.table))))
    if not is_dataclass(known):
        return value
    each = {k: getattr(known, k) for k in field_names(type(known))}
    items = (Static(None if k.startswith("_") else v) for k, v in each.items())
    return Bundle(type(known), tuple(_parts(opened(x), car) for x in items))


def _nominal(out: Expressions, given: list[Value], _: Named) -> Value:
    """A vehicle with some figures times factors; see ``ModelError.nominal``."""
    factors, vehicle = given
    assert isinstance(factors, Bundle)
    figures = _parts(vehicle, True)
    assert isinstance(figures, Bundle)
    items = list(figures.items)
    names = field_names(figures.cls)
    for name, factor in zip(field_names(factors.cls), factors.items, strict=True):
        at = names.index(name)
        items[at] = out.local(out.operate(ast.Mult, items[at], factor))
    whole = Bundle(figures.cls, tuple(items))
    row = out.call(Vehicle.row, [whole])
    table = whole[_TABLE]
    assert isinstance(table, Bundle)
    rows = out.method(row, "reshape", [Static(1), Static(-1)], {})
    items[-1] = Bundle(table.cls, (rows, *table.items[1:]))
    return Bundle(figures.cls, tuple(items))


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
    if isinstance(state, Static) and isinstance(now, Scalar | Array):  # no step changes it
        return now
    if arrays.is_array(state) and arrays.is_array(was):
        return out.either(_equal(out, out.array(state), out.array(was)), now, state)
    if not isinstance(state, Scalar):
        raise NotTranslatable("a design whose shape is set by a policy")
    test = out.compare(ast.Eq, state, was)
    assert isinstance(test, Scalar)
    return out.either(test, now, state)


def _equal(out: Expressions, one: Array, other: Array) -> Scalar:
    """Whether two arrays hold the same numbers."""
    if one.shape != other.shape:
        raise NotTranslatable("a design whose shape is set by a policy")
    equal = out.fresh("equal_store")
    out.lines.append(f"int {equal} = 1;")
    indices = out.loops(one.shape)
    out.lines.append(f"{equal} = {equal} && {one.element(*indices)} == {other.element(*indices)};")
    out.ended(indices)
    return Scalar(equal, BOOL)


def _solved(out: Expressions, design: Value) -> Static | Scalar:
    """Whether all numbers of a design are finite; what has no solution has none."""
    if not out.program.unsolved:
        return Static(True)
    tests: list[Static | Scalar] = []
    for each in leaves(design):
        test = out.call(np.isfinite, [each]) if each.kind == REAL else Static(True)
        tests.append(out.truth(out.call(all, [test]) if isinstance(test, Array) else test))
    return out.every(tests)


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
        solved = _solved(out, fresh)
        state = _carried(out, now["state"], now["fresh"], fresh)
        new: Value = Bundle(Adjusted, (controller, fresh, state, action))
        new = out.local(new if isinstance(solved, Static) else out.either(solved, new, now))
    otherwise: list[str] = []
    merged = out.merged(new, now, lines, otherwise, "adjusted")
    assert isinstance(finite, Scalar)
    out.lines += [f"if ({bare(finite.text)}) {{", *lines, "} else {", *otherwise, "}"]
    return merged


def _model(out: Expressions, given: list[Value], _: Named) -> Value:
    """A model of tables: those whose weights change are built where they are needed, and not kept.

    See :meth:`steersman.controllers.mpc_delay_plan.Tables.model`.
    """
    tables, place = given
    if isinstance(tables, Static):
        return out.program.call(out, Tables.model, given, {})
    return out.call(Tables.built, [tables, place])


ADAPTIVE_CALLS: dict[Any, Special] = {
    Adjuster.adjust: Special(_adjust),
    Tables.model: Special(_model),
    ModelError.nominal: Special(_nominal),
}
