"""What goes into a C function and comes out of it: arguments, results, by their types."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import Any

import numpy as np

from steersman.delivery.translate.expressions import Expressions
from steersman.delivery.translate.statements import Statements
from steersman.delivery.translate.values import (
    Array,
    Bundle,
    Maybe,
    Root,
    Scalar,
    Static,
    Type,
    Value,
)


def bound(
    function: Callable[..., Any], given: list[Value], named: dict[str, Value]
) -> dict[str, Value]:
    """What a call gives to each argument."""
    signature = inspect.signature(function)
    bound = signature.bind(*given, **named)
    out: dict[str, Value] = {}
    for name, each in signature.parameters.items():
        if name in bound.arguments:
            value = bound.arguments[name]
            out[name] = Bundle(tuple, value) if isinstance(value, tuple) else value
        else:
            out[name] = Static(each.default)
    return out


def dense(out: Expressions, value: Value) -> Value:
    """The value with every array row by row, as functions take them."""
    match value:
        case Array():
            return out.dense(value)
        case Static(np.ndarray(), path) if path is None:
            return value
        case Bundle(cls, items):
            return Bundle(cls, tuple(dense(out, each) for each in items))
        case Maybe(there, item):
            return Maybe(there, dense(out, item))
    return value


def formal(writer: Statements, name: str, value: Value) -> Value:
    """A function's own name for an argument."""
    match value:
        case Scalar(_, kind):
            return Scalar(writer.fresh(name), kind)
        case Array():
            text = writer.fresh(name)
            return Array(text, value.shape, Root(text), (), value.kind)
        case Bundle(cls, items):
            fields = getattr(cls, "_fields", [str(i) for i in range(len(items))])
            pairs = zip(items, fields, strict=True)
            return Bundle(cls, tuple(formal(writer, f"{name}_{k}", v) for v, k in pairs))
        case Maybe(there, item):
            flag = formal(writer, f"{name}_there", there)
            assert isinstance(flag, Scalar)
            return Maybe(flag, formal(writer, name, item))
    return value


def pointers(value: Value) -> Value:
    """The places that results are written to."""
    match value:
        case Scalar(text, kind):
            return Scalar(f"(*{text})", kind)
        case Bundle(cls, items):
            return Bundle(cls, tuple(pointers(each) for each in items))
        case Maybe(there, item):
            flag = pointers(there)
            assert isinstance(flag, Scalar)
            return Maybe(flag, pointers(item))
    return value


def example(wanted: Type) -> Value:
    """A value of a type, for what is known of it."""
    match wanted.form:
        case "static":
            return wanted.example  # type: ignore[no-any-return]
        case "scalar":
            return Scalar("0", wanted.detail)
        case "array":
            return Array("0", wanted.detail[0], Root(""), (), wanted.detail[1])
        case "record":
            return Bundle(wanted.detail, tuple(example(each) for each in wanted.parts))
        case "maybe":
            return Maybe(Scalar("0", "bool"), example(wanted.parts[0]))
    return Static(None)
