"""Operators of ONNX on the numbers of a row, one by one: as numpy computes them, and as C does."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Single = NDArray[np.float32]


class Operator(NamedTuple):
    """What an operator does."""

    compute: Callable[..., Any]
    """Of numbers and of what the operator takes besides."""
    text: str
    """In C: ``{x}`` is the number, ``{0}`` and ``{1}`` what it takes besides, ``{f}`` the end of
    names of math.h."""
    slope: Callable[..., Any] = lambda *_: 1.0
    """The largest slope, of what it takes besides."""
    attributes: Mapping[str, float] = {}
    """Attributes that it takes besides, and their defaults."""


class Operation(NamedTuple):
    """An operator with what it takes besides."""

    name: str
    numbers: tuple[Single, ...] = ()
    """Each of size 1, or one for each number of the row."""

    def __call__(self, x: Any) -> Any:
        """Of numbers (..., n), in their own precision."""
        with np.errstate(over="ignore", invalid="ignore"):
            return OPERATORS[self.name].compute(x, *(each.astype(x.dtype) for each in self.numbers))

    @property
    def slope(self) -> Any:
        """The largest slope."""
        return OPERATORS[self.name].slope(*(abs(each.astype(float)) for each in self.numbers))


def _smooth(x: Any, alpha: Any) -> Any:
    return np.where(x > 0.0, x, alpha * np.expm1(np.minimum(x, 0.0)))


def _steepest(alpha: Any, *more: Any) -> Any:
    return np.maximum(1.0, alpha) * np.prod(more or (1.0,))


OPERATORS = {
    "Abs": Operator(np.abs, "fabs{f}({x})"),
    "Add": Operator(np.add, "{x} + {0}"),
    "Clip": Operator(np.clip, "{x} < {0} ? {0} : ({x} > {1} ? {1} : {x})", lambda *_: 1.0),
    "Div": Operator(np.divide, "{x} / {0}", lambda c: 1.0 / c),
    "Elu": Operator(_smooth, "{x} > 0 ? {x} : {0} * expm1{f}({x})", _steepest, {"alpha": 1.0}),
    "HardSigmoid": Operator(
        lambda x, alpha, beta: np.clip(alpha * x + beta, 0.0, 1.0),
        "{0} * {x} + {1} < 0 ? 0 : ({0} * {x} + {1} > 1 ? 1 : {0} * {x} + {1})",
        lambda alpha, _: alpha,
        {"alpha": 0.2, "beta": 0.5},
    ),
    "Identity": Operator(np.positive, "{x}"),
    "LeakyRelu": Operator(
        lambda x, alpha: np.where(x > 0.0, x, alpha * x),
        "{x} > 0 ? {x} : {0} * {x}",
        _steepest,
        {"alpha": 0.01},
    ),
    "Max": Operator(np.maximum, "{x} < {0} ? {0} : {x}"),
    "Min": Operator(np.minimum, "{x} > {0} ? {0} : {x}"),
    "Mul": Operator(np.multiply, "{x} * {0}", lambda c: c),
    "Neg": Operator(np.negative, "-{x}"),
    "Relu": Operator(lambda x: np.maximum(x, 0.0), "{x} > 0 ? {x} : 0"),
    "Selu": Operator(
        lambda x, alpha, gamma: gamma * _smooth(x, alpha),
        "{x} > 0 ? {1} * {x} : {1} * ({0} * expm1{f}({x}))",
        _steepest,
        {"alpha": 1.6732632423543772, "gamma": 1.0507009873554805},
    ),
    "Sigmoid": Operator(lambda x: 1.0 / (1.0 + np.exp(-x)), "1 / (1 + exp{f}(-{x}))"),
    "Softplus": Operator(
        lambda x: np.maximum(x, 0.0) + np.log1p(np.exp(-np.abs(x))),
        "({x} > 0 ? {x} : 0) + log1p{f}(exp{f}(-fabs{f}({x})))",
    ),
    "Softsign": Operator(lambda x: x / (1.0 + np.abs(x)), "{x} / (1 + fabs{f}({x}))"),
    "Sub": Operator(np.subtract, "{x} - {0}"),
    "Tanh": Operator(np.tanh, "tanh{f}({x})"),
}
COMMUTATIVE = frozenset(("Add", "Max", "Min", "Mul"))
"""Of which the constant may stand first."""
