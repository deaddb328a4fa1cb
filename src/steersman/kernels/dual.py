"""Kernels that compute derivatives: the chain rule for every operation on dual numbers.

Importing this module lets every kernel be called with rows of dual numbers, see ``dual_number``.
Where a function has a kink, the slope is that of the side on which the value lies: a clipped
number has slope zero, ``min`` and ``max`` have that of the one they return, a root at zero zero.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable
from types import FunctionType
from typing import Any

import numpy as np
from llvmlite import ir  # type: ignore[import-untyped]
from numba import njit, types
from numba.core.imputils import lower_builtin
from numba.core.typing.templates import ConcreteTemplate, infer_global, signature
from numba.extending import overload

from steersman.kernels.dual_number import DUAL, FUSED, PROXY, added, join, make, scaled, spread


def _rule(function: Callable[..., Any], slope: Callable[[float], float]) -> None:
    """The chain rule for a function of one number."""
    plain, steep = function, slope
    if isinstance(slope, FunctionType):
        steep = njit(error_model="numpy")(slope)

    @overload(function, strict=False)
    def of_one(x: Any) -> Any:
        if x is not DUAL:
            return None
        return lambda x: join(plain(x.value), scaled(x.slopes, steep(x.value)))


def _rule_of_two(
    function: Callable[..., Any],
    by_first: Callable[[float, float], float],
    by_second: Callable[[float, float], float],
    *others: Callable[..., Any],
) -> None:
    """The chain rule for a function of two numbers, one of which may be plain.

    ``others`` are further names of the function.
    """
    plain = function
    first, second = (njit(error_model="numpy")(each) for each in (by_first, by_second))

    def both(a: Any, b: Any) -> Any:
        x, y = a.value, b.value
        slopes = added(scaled(a.slopes, first(x, y)), scaled(b.slopes, second(x, y)))
        return join(plain(x, y), slopes)

    def left(a: Any, b: Any) -> Any:
        return join(plain(a.value, b), scaled(a.slopes, first(a.value, b)))

    def right(a: Any, b: Any) -> Any:
        return join(plain(a, b.value), scaled(b.slopes, second(a, b.value)))

    def of_two(a: Any, b: Any) -> Any:
        if a is DUAL and b is DUAL:
            return both
        if a is DUAL and isinstance(b, types.Number):
            return left
        return right if b is DUAL and isinstance(a, types.Number) else None

    for name in (function, *others):
        overload(name, strict=False)(of_two)


Builder = Any
# What a compiled operation makes of a builder, two values and two slopes (None: a plain number).
_Operation = Callable[[Builder, Any, Any, Any, Any], tuple[Any, Any]]


def _sum(builder: Builder, x: Any, y: Any, dx: Any, dy: Any) -> tuple[Any, Any]:
    slopes = dx if dy is None else dy if dx is None else builder.fadd(dx, dy)
    return builder.fadd(x, y), slopes


def _difference(builder: Builder, x: Any, y: Any, dx: Any, dy: Any) -> tuple[Any, Any]:
    if dx is None:
        return builder.fsub(x, y), builder.fneg(dy)
    return builder.fsub(x, y), dx if dy is None else builder.fsub(dx, dy)


def _product(builder: Builder, x: Any, y: Any, dx: Any, dy: Any) -> tuple[Any, Any]:
    parts = [builder.fmul(d, spread(builder, z), flags=FUSED) for d, z in ((dx, y), (dy, x)) if d]
    slopes = parts[0] if len(parts) == 1 else builder.fadd(*parts, flags=FUSED)
    return builder.fmul(x, y), slopes


def _quotient(builder: Builder, x: Any, y: Any, dx: Any, dy: Any) -> tuple[Any, Any]:
    value = builder.fdiv(x, y)
    inverse = builder.fdiv(ir.DoubleType()(1.0), y)
    if dy is not None:
        lost = builder.fmul(dy, spread(builder, value), flags=FUSED)
        dx = builder.fneg(lost) if dx is None else builder.fsub(dx, lost, flags=FUSED)
    return value, builder.fmul(dx, spread(builder, inverse), flags=FUSED)


def _arithmetic(operation: _Operation, *names: Callable[..., Any]) -> None:
    """Teach the compiler an operation on two numbers, one of which may be plain."""

    def generate(context: Any, builder: Builder, signature: Any, arguments: Any) -> Any:
        pairs = []
        for kind, given in zip(signature.args, arguments, strict=True):
            made = PROXY(DUAL)(context, builder, given) if kind is DUAL else None
            pairs.append((given, None) if made is None else (made.value, made.slopes))
        (x, dx), (y, dy) = pairs
        return make(context, builder, *operation(builder, x, y, dx, dy))

    for name in names:
        _teach(name, DUAL, generate)


def _comparison(symbol: str, name: Callable[..., Any]) -> None:
    """Duals compare by their values."""

    def generate(context: Any, builder: Builder, signature: Any, arguments: Any) -> Any:
        values = [
            PROXY(DUAL)(context, builder, given).value if kind is DUAL else given
            for kind, given in zip(signature.args, arguments, strict=True)
        ]
        compare = builder.fcmp_unordered if symbol == "!=" else builder.fcmp_ordered
        return compare(symbol, *values)

    _teach(name, types.boolean, generate)


def _teach(name: Callable[..., Any], result: Any, generate: Any) -> None:
    signatures = [
        signature(result, *pair)
        for pair in ((DUAL, DUAL), (DUAL, types.float64), (types.float64, DUAL))
    ]
    infer: Any = infer_global
    lower: Any = lower_builtin
    infer(name)(type("_Template", (ConcreteTemplate,), {"cases": signatures}))
    for each in signatures:
        lower(name, *each.args)(generate)


def _plain_value(function: Callable[..., Any]) -> None:
    """What is constant between jumps has no slope."""
    plain = function

    @overload(function, strict=False)
    def of_value(x: Any) -> Any:
        return (lambda x: plain(x.value)) if x is DUAL else None


@overload(float, strict=False)
def _float(x: Any) -> Any:
    return (lambda x: x) if x is DUAL else None


_rule(abs, lambda x: math.copysign(1.0, x))
_rule(operator.neg, lambda x: -1.0)
_rule(math.sin, math.cos)
_rule(math.cos, lambda x: -math.sin(x))
_rule(math.tan, lambda x: 1.0 + math.tan(x) ** 2)
_rule(math.atan, lambda x: 1.0 / (1.0 + x * x))
_rule(math.tanh, lambda x: 1.0 - math.tanh(x) ** 2)
_rule(math.exp, math.exp)
_rule(math.log, lambda x: 1.0 / x)
_rule(math.sqrt, lambda x: 0.5 / math.sqrt(x) if x > 0.0 else 0.0)
_rule_of_two(operator.pow, lambda a, b: b * a ** (b - 1), lambda a, b: a**b * math.log(a))
_rule_of_two(min, lambda a, b: 1.0 if a <= b else 0.0, lambda a, b: 0.0 if a <= b else 1.0)
_rule_of_two(max, lambda a, b: 1.0 if a >= b else 0.0, lambda a, b: 0.0 if a >= b else 1.0)
_rule_of_two(math.copysign, lambda a, b: math.copysign(1.0, a * b), lambda a, b: 0.0)
_rule_of_two(
    math.hypot, lambda a, b: a / math.hypot(a, b), lambda a, b: b / math.hypot(a, b), np.hypot
)
_rule_of_two(
    math.atan2, lambda a, b: b / (a * a + b * b), lambda a, b: -a / (a * a + b * b), np.arctan2
)
_arithmetic(_sum, operator.add, operator.iadd)
_arithmetic(_difference, operator.sub, operator.isub)
_arithmetic(_product, operator.mul, operator.imul)
_arithmetic(_quotient, operator.truediv, operator.itruediv)
_comparison("<", operator.lt)
_comparison("<=", operator.le)
_comparison(">", operator.gt)
_comparison(">=", operator.ge)
_comparison("==", operator.eq)
_comparison("!=", operator.ne)
for each in (math.isnan, bool, int, math.ceil, math.floor):
    _plain_value(each)
