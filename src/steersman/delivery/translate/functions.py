"""Functions of Python, math and numpy, as C has them."""

from __future__ import annotations

import math
import operator
from collections.abc import Callable
from functools import reduce
from typing import TYPE_CHECKING, Any

import numpy as np

from steersman.delivery.translate import array_functions as more
from steersman.delivery.translate import arrays
from steersman.delivery.translate.array_functions import Named, Special
from steersman.delivery.translate.values import (
    BOOL,
    INT,
    REAL,
    Array,
    Bundle,
    Maybe,
    NotTranslatable,
    Scalar,
    Static,
    Value,
    opened,
    scalar_kind,
)

if TYPE_CHECKING:
    from steersman.delivery.translate.expressions import Expressions


def _of_real(name: str, compute: Callable[..., Any]) -> Special:
    """A function of floating-point numbers that math.h has."""

    def write(out: Expressions, given: list[Value], _: Named) -> Value:
        function = out.program.math(name)
        if any(arrays.is_array(each) for each in given):
            return arrays.elementwise(
                out, given, lambda x: f"{function}({', '.join(out.real(each) for each in x)})"
            )
        known, of = out._known_of(compute, *(out.number(each) for each in given))
        return Scalar(f"{function}({', '.join(out.real(x) for x in given)})", REAL, known, of)

    return Special(write)


def _remainder(out: Expressions, given: list[Value], named: Named) -> Value:
    """In double where the divisor is known: of many turns, float's 2 pi is too coarse."""
    if not out.program.single or not out.fixed(given[1]):
        return _of_real("remainder", math.remainder).write(out, given, named)
    divisor = float(out.static(given[1]))
    return Scalar(f"(real)remainder((double){out.real(given[0])}, {divisor!r})", REAL)


def _absolute(out: Expressions, given: list[Value], _: Named) -> Value:
    if arrays.is_array(given[0]):
        return arrays.elementwise(out, given, lambda x: f"{out.program.math('fabs')}({x[0].text})")
    one = out.number(given[0])
    known, of = out._known_of(abs, one)
    if one.kind == REAL:
        return Scalar(f"{out.program.math('fabs')}({one.text})", REAL, known, of)
    one = out.local(one)  # type: ignore[assignment]
    return Scalar(f"({one.text} < 0 ? -{one.text} : {one.text})", INT, known, of)


def _least(compute: Callable[..., Any], sign: str) -> Special:
    """Python's min or max: of equal ones the first, and a later NaN is passed over."""

    def pair(out: Expressions, a: Scalar, b: Scalar) -> Scalar:
        kind = REAL if REAL in {a.kind, b.kind} else INT
        name = {"<": "least", ">": "most"}[sign] + ("" if kind == REAL else "_int")
        known, of = out._known_of(compute, a, b)
        text = f"{out.program.helper(name)}({out.text(a, kind)}, {out.text(b, kind)})"
        return Scalar(text, kind, known, of)

    def write(out: Expressions, given: list[Value], _: Named) -> Value:
        items = out.items(given[0]) if len(given) == 1 else given
        return reduce(lambda a, b: pair(out, a, b), [out.number(each) for each in items])

    return Special(write)


def _rounded(out: Expressions, given: list[Value], _: Named) -> Value:
    one = out.number(given[0])
    known, of = out._known_of(round, one)
    text = f"{out.program.helper('to_int')}({out.program.math('rint')}({out.real(one)}))"
    return Scalar(text, INT, known, of)


def _int(out: Expressions, given: list[Value], _: Named) -> Value:
    one = out.number(given[0])
    known, of = out._known_of(int, one)
    if one.kind != REAL:
        return Scalar(one.text, INT, known, of)
    return Scalar(f"{out.program.helper('to_int')}({one.text})", INT, known, of)


def _float(out: Expressions, given: list[Value], _: Named) -> Value:
    if isinstance(given[0], Static):
        return Static(float(given[0].value), given[0].path)
    one = out.number(given[0])
    return Scalar(out.real(one), REAL, one.known, one.of)


def _finite(out: Expressions, given: list[Value], _: Named) -> Value:
    helper = out.program.helper("finite")
    if arrays.is_array(given[0]):
        return arrays.elementwise(out, given, lambda x: f"{helper}({x[0].text})", INT)
    return Scalar(f"{helper}({out.real(given[0])})", BOOL)


def _isnan(out: Expressions, given: list[Value], _: Named) -> Value:
    one = out.local(out.number(given[0]))
    assert isinstance(one, Scalar)
    return Scalar(f"({one.text} != {one.text})", BOOL)


def _all(out: Expressions, given: list[Value], _: Named) -> Value:
    if arrays.is_array(given[0]):
        return arrays.total(out, given[0], "1", lambda a, x: f"{a} && {x}")
    tests = [out.truth(each) for each in out.items(given[0])]
    return out.every(tests)


def _any(out: Expressions, given: list[Value], _: Named) -> Value:
    return out._any([out.truth(each) for each in out.items(given[0])])


def _map(out: Expressions, given: list[Value], _: Named) -> Value:
    function, rows = out.static(given[0]), [out.items(each) for each in given[1:]]
    if function in _COMPARED:
        out_of = [out.compare(_COMPARED[function], *row) for row in zip(*rows, strict=True)]
    else:
        out_of = [out.call(function, list(row)) for row in zip(*rows, strict=True)]  # type: ignore[misc]
    return Bundle(tuple, tuple(out_of))


def _zip(out: Expressions, given: list[Value], _: Named) -> Value:
    rows = zip(*(out.items(each) for each in given), strict=True)
    return Bundle(tuple, tuple(Bundle(tuple, row) for row in rows))


def _enumerate(out: Expressions, given: list[Value], _: Named) -> Value:
    rows = enumerate(out.items(given[0]))
    return Bundle(tuple, tuple(Bundle(tuple, (Static(i), each)) for i, each in rows))


def _reversed(out: Expressions, given: list[Value], _: Named) -> Value:
    return Bundle(tuple, tuple(reversed(out.items(given[0]))))


def _tuple(out: Expressions, given: list[Value], _: Named) -> Value:
    return Bundle(tuple, tuple(out.items(given[0])))


def _len(out: Expressions, given: list[Value], _: Named) -> Value:
    whole = opened(given[0])
    if isinstance(whole, Maybe) and isinstance(whole.item, Array):
        return out.counted(whole.there, whole.item.shape[0])
    whole = whole.item if isinstance(whole, Maybe) else whole
    if isinstance(whole, Static):
        return Static(len(whole.value))
    return Static(whole.shape[0] if isinstance(whole, Array) else len(out.items(whole)))


def _isinstance(out: Expressions, given: list[Value], _: Named) -> Value:
    classes = out.static(given[1])
    value = given[0]
    if isinstance(value, Maybe):
        inside = _isinstance(out, [value.item, given[1]], {})
        return out.both(value.there, inside)  # type: ignore[arg-type]
    if isinstance(value, Bundle):
        return Static(issubclass(value.cls, classes))
    if isinstance(value, Scalar):
        return Static(isinstance({REAL: 0.5, INT: 1, BOOL: True}[value.kind], classes))
    if isinstance(value, Array):
        return Static(isinstance(np.zeros(0), classes))
    return Static(isinstance(value.value, classes))


_COMPARED: dict[Any, type] = {}


def _whole(of: Special) -> Special:
    """The same as an int."""
    return Special(lambda out, given, named: _int(out, [of.write(out, given, named)], named))


def _cast(out: Expressions, given: list[Value], _: Named) -> Value:
    if isinstance(given[0], Static) and scalar_kind(given[0].value) is None:
        raise NotTranslatable(f"bool of {given[0]}")
    return out.truth(given[0])


def _register() -> dict[Any, Special]:
    import ast

    _COMPARED.update({operator.le: ast.LtE, operator.lt: ast.Lt, operator.eq: ast.Eq})
    one = ("sin", "cos", "tan", "asin", "acos", "atan", "sinh", "cosh", "tanh", "exp", "expm1",
           "log", "log1p", "sqrt", "floor", "ceil")  # fmt: skip
    two = ("atan2", "hypot", "copysign", "remainder", "fmod", "pow")
    table: dict[Any, Special] = {}
    for name in (*one, *two):
        table[getattr(math, name)] = _of_real(name, getattr(math, name))
        if hasattr(np, name):
            table[getattr(np, name)] = _of_real(name, getattr(math, name))
    table[math.remainder] = Special(_remainder)
    table[np.arctan] = table[math.atan]
    table[np.rint] = _of_real("rint", round)
    table |= {f: _whole(table[f]) for f in (math.floor, math.ceil)}
    plain: dict[Any, Callable[[Expressions, list[Value], Named], Value]] = {
        abs: _absolute, np.abs: _absolute, math.fabs: _absolute, round: _rounded, int: _int,
        float: _float, bool: _cast, math.isfinite: _finite, np.isfinite: _finite,
        math.isnan: _isnan, sum: more.sum, all: _all, any: _any, map: _map, zip: _zip,
        enumerate: _enumerate, reversed: _reversed, tuple: _tuple, list: _tuple, len: _len,
        isinstance: _isinstance, np.asarray: more.given, np.ascontiguousarray: more.given,
        np.searchsorted: more.searchsorted, np.square: more.square, np.where: more.where,
    }  # fmt: skip
    fresh: dict[Any, Callable[[Expressions, list[Value], Named], Value]] = {
        np.array: more.array, np.concatenate: more.concatenate, np.append: more.append,
        np.vstack: more.vstack,
        np.diff: more.diff, np.diag: more.diag,
    }  # fmt: skip
    table |= {function: Special(write) for function, write in plain.items()}
    table |= {function: Special(write, always=True) for function, write in fresh.items()}
    return table | {
        min: _least(min, "<"), max: _least(max, ">"),
        np.minimum: more.pairwise("<"), np.maximum: more.pairwise(">"),
        np.empty: more.filled(math.nan), np.zeros: more.filled(0.0), np.ones: more.filled(1.0),
        np.full: more.filled(None), np.empty_like: more.filled(math.nan, like=True),
        np.zeros_like: more.filled(0.0, like=True), np.full_like: more.filled(None, like=True),
    }  # fmt: skip


CALLS = _register()
METHODS = {
    "copy": more.copy, "tolist": more.tolist, "mean": more.mean, "sum": more.sum, "all": _all,
    "min": more.smallest,
    "ravel": more.ravel, "reshape": more.reshape,
    "setflags": more.nothing,
}  # fmt: skip
