"""Numbers with their derivatives (dual numbers), with which the kernels compute as they are.

A dual number is a value and its slopes in ``LANES`` directions. numba compiles a kernel anew for
every type of argument: called with duals instead of numbers, the same source gives value and
derivatives, exact but for rounding. So there is no second car whose equations could differ.

Source: Griewank and Walther, Evaluating Derivatives, 2nd ed., SIAM 2008, ch. 3 (forward mode).
"""

from __future__ import annotations

import operator
from typing import Any

from llvmlite import ir  # type: ignore[import-untyped]
from numba import types
from numba.core import cgutils
from numba.core.typeconv import Conversion  # type: ignore[attr-defined]
from numba.extending import (
    intrinsic,
    lower_cast,
    make_attribute_wrapper,
    models,
    overload,
    register_model,
)

# numba's, without its type hints, which do not know what it makes of a function.
_intrinsic: Any = intrinsic
PROXY: Any = cgutils.create_struct_proxy
# Directions of a dual number.
LANES = 8
# Numbers that one takes in an array: its value, then its slopes.
WIDTH = LANES + 1
VECTOR = ir.VectorType(ir.DoubleType(), LANES)
# Slopes may be computed by fused multiply-add; values are those of the plain kernel, to the bit.
FUSED = ("contract",)


class _Lanes(types.Type):
    def __init__(self) -> None:
        super().__init__(name="Lanes")


class _Dual(types.Type):
    def __init__(self) -> None:
        super().__init__(name="Dual")

    def can_convert_from(self, context: Any, other: Any) -> Any:
        """A number is a dual whose slopes are zero."""
        return Conversion.safe if isinstance(other, types.Number) else None

    def unify(self, context: Any, other: Any) -> Any:
        """What is a number on one way and a dual on another is a dual."""
        return self if isinstance(other, types.Number) else None


class _DualRow(types.Type):
    def __init__(self) -> None:
        super().__init__(name="DualRow")


LANES_TYPE, DUAL, ROW = _Lanes(), _Dual(), _DualRow()


@register_model(_Lanes)
class _LanesModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, VECTOR)


@register_model(_Dual)
class _DualModel(models.StructModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, [("value", types.float64), ("slopes", LANES_TYPE)])


@register_model(_DualRow)
class _DualRowModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, ir.DoubleType().as_pointer())


make_attribute_wrapper(_Dual, "value", "value")
make_attribute_wrapper(_Dual, "slopes", "slopes")


def make(context: Any, builder: Any, value: Any, slopes: Any) -> Any:
    """Code that joins a value and slopes."""
    made = PROXY(DUAL)(context, builder)
    made.value, made.slopes = value, slopes
    return made._getvalue()


@lower_cast(types.Number, DUAL)
def _lift(context: Any, builder: Any, kind: Any, to: Any, number: Any) -> Any:
    value = context.cast(builder, number, kind, types.float64)
    return make(context, builder, value, ir.Constant(VECTOR, None))


@_intrinsic
def join(typing: Any, value: Any, slopes: Any) -> Any:
    """A dual number of its value and its slopes."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return make(context, builder, *arguments)

    return DUAL(types.float64, LANES_TYPE), generate


def spread(builder: Any, number: Any) -> Any:
    """Code that puts a number into every lane."""
    one = builder.insert_element(ir.Constant(VECTOR, ir.Undefined), number, ir.IntType(32)(0))
    mask = ir.Constant(ir.VectorType(ir.IntType(32), LANES), [0] * LANES)
    return builder.shuffle_vector(one, ir.Constant(VECTOR, ir.Undefined), mask)


@_intrinsic
def scaled(typing: Any, slopes: Any, factor: Any) -> Any:
    """Slopes times a number."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.fmul(arguments[0], spread(builder, arguments[1]), flags=FUSED)

    return LANES_TYPE(LANES_TYPE, types.float64), generate


@_intrinsic
def added(typing: Any, a: Any, b: Any) -> Any:
    """Sum of slopes."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.fadd(*arguments, flags=FUSED)

    return LANES_TYPE(LANES_TYPE, LANES_TYPE), generate


@_intrinsic
def rows(typing: Any, array: Any) -> Any:
    """A contiguous array (..., WIDTH) as a row of dual numbers; the caller keeps it alive."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        made = context.make_array(signature.args[0])(context, builder, arguments[0])
        return made.data

    return ROW(array), generate


def load(context: Any, builder: Any, pointer: Any) -> Any:
    """Code that reads the dual number at a place in memory."""
    behind = builder.gep(pointer, [ir.IntType(64)(1)])
    slopes = builder.load(builder.bitcast(behind, VECTOR.as_pointer()), align=8)
    return make(context, builder, builder.load(pointer), slopes)


def store(context: Any, builder: Any, pointer: Any, number: Any) -> None:
    """Code that writes a dual number to a place in memory."""
    given = PROXY(DUAL)(context, builder, number)
    builder.store(given.value, pointer)
    behind = builder.gep(pointer, [ir.IntType(64)(1)])
    builder.store(given.slopes, builder.bitcast(behind, VECTOR.as_pointer()), align=8)


@_intrinsic
def _get_at(typing: Any, row: Any, at: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return load(context, builder, _at(builder, *arguments))

    return DUAL(ROW, types.int64), generate


@_intrinsic
def _put_at(typing: Any, row: Any, at: Any, number: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        value = context.cast(builder, arguments[2], signature.args[2], DUAL)
        store(context, builder, _at(builder, *arguments[:2]), value)
        return context.get_dummy_value()

    return types.void(ROW, types.int64, number), generate


@_intrinsic
def _behind(typing: Any, row: Any, by: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return _at(builder, *arguments)

    return ROW(ROW, types.int64), generate


def _at(builder: Any, row: Any, by: Any) -> Any:
    return builder.gep(row, [builder.mul(by, ir.IntType(64)(WIDTH))])


@overload(operator.getitem, strict=False)
def _get(row: Any, at: Any) -> Any:
    if row is not ROW:
        return None
    if isinstance(at, types.SliceType):
        return lambda row, at: _behind(row, at.start)
    return lambda row, at: _get_at(row, at)  # noqa: PLW0108 - numba needs a function


@overload(operator.setitem, strict=False)
def _set(row: Any, at: Any, number: Any) -> Any:
    if row is not ROW:
        return None
    return lambda row, at, number: _put_at(row, at, number)  # noqa: PLW0108
