"""Functions of numpy that make or read whole arrays."""

from __future__ import annotations

import ast
from collections.abc import Callable
from functools import reduce
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

import numpy as np

from steersman.delivery.translate import arrays
from steersman.delivery.translate.values import INT, REAL, Array, Bundle, Scalar, Static, Value

if TYPE_CHECKING:
    from steersman.delivery.translate.expressions import Expressions

Named: TypeAlias = dict[str, Value]


class Special(NamedTuple):
    """How a call is written."""

    write: Callable[[Expressions, list[Value], Named], Value]
    always: bool = False
    """Also where all that is given is known: what it makes is written to later."""


def sum(out: Expressions, given: list[Value], _: Named) -> Value:
    """The sum of an array or of a tuple."""
    if arrays.is_array(given[0]):
        return arrays.total(out, given[0], out.program.literal(0.0), lambda a, x: f"{a} + {x}")
    start: Value = given[1] if len(given) > 1 else Static(0)
    return reduce(lambda a, b: out.operate(ast.Add, a, b), out.items(given[0]), start)


def given(out: Expressions, given: list[Value], _: Named) -> Value:
    """The array itself, as numbers row by row."""
    return out.dense(given[0]) if arrays.is_array(given[0]) else arrays.from_items(out, given[0])


def array(out: Expressions, given: list[Value], _: Named) -> Value:
    """A new array of numbers, or of rows."""
    return arrays.from_items(out, given[0])


def filled(value: float | None, *, like: bool = False) -> Special:
    """A new array; ``value`` None: of the second thing given."""

    def write(out: Expressions, given: list[Value], named: Named) -> Value:
        shape = out.array(given[0]).shape if like else out.static(given[0])
        made = out.new_array((shape,) if isinstance(shape, int) else tuple(shape))
        if value != value:  # noqa: PLR0124 - NaN stands for no value
            return made
        text = out.real(given[1]) if value is None else out.program.literal(value)
        indices = out.loops(made.shape)
        out.lines.append(f"{made.element(*indices)} = {text};")
        out.ended(indices)
        return made

    return Special(write, always=True)


def pairwise(sign: str) -> Special:
    """The minimum or maximum of numpy."""

    def write(out: Expressions, given: list[Value], _: Named) -> Value:
        helper = out.program.helper({"<": "least", ">": "most"}[sign])
        return arrays.elementwise(
            out, given, lambda x: f"{helper}({out.real(x[1])}, {out.real(x[0])})"
        )

    return Special(write)


def square(out: Expressions, given: list[Value], _: Named) -> Value:
    """Each number times itself."""
    if not arrays.is_array(given[0]):
        one = out.local(out.number(given[0]))
        assert isinstance(one, Scalar)
        return Scalar(f"({one.text} * {one.text})", REAL)
    return arrays.elementwise(out, given, lambda x: f"{x[0].text} * {x[0].text}")


def searchsorted(out: Expressions, given: list[Value], _: Named) -> Value:
    """How many numbers of a rising array are smaller."""
    wanted = out.local(out.number(given[1]))
    whole = out.array(given[0])
    count = out.fresh("count_store")
    out.lines.append(f"int {count} = 0;")
    indices = out.loops(whole.shape)
    out.lines.append(f"{count} += {whole.element(*indices)} < {out.real(wanted)} ? 1 : 0;")
    out.ended(indices)
    return Scalar(count, INT)


def concatenate(out: Expressions, given: list[Value], _: Named) -> Value:
    """Arrays one behind the other."""
    parts = [
        out.array(each) if arrays.is_array(each) else arrays.from_items(out, each)
        for each in out.items(given[0])
    ]
    return arrays.joined(out, parts)


def append(out: Expressions, given: list[Value], _: Named) -> Value:
    """An array and more numbers behind it."""
    last = given[1] if arrays.is_array(given[1]) else Bundle(tuple, (given[1],))
    return concatenate(out, [Bundle(tuple, (given[0], last))], {})


def vstack(out: Expressions, given: list[Value], _: Named) -> Value:
    """Rows below each other."""
    rows = [out.array(each) for each in out.items(given[0])]
    whole = [
        r if len(r.shape) > 1 else Array(r.text, (1, *r.shape), r.root, (0, *r.strides))
        for r in rows
    ]
    return arrays.joined(out, whole)


def diff(out: Expressions, given: list[Value], named: Named) -> Value:
    """Differences of neighbours along the first axis."""
    times = out.static(given[1]) if len(given) > 1 else 1
    source: Value = out.array(given[0])
    if "prepend" in named:
        first = Bundle(tuple, (named["prepend"],))
        source = concatenate(out, [Bundle(tuple, (first, source))], {})
    for _ in range(times):
        whole = out.array(source)
        later = arrays.at(out, whole, [Static(slice(1, None))])
        source = out.operate(ast.Sub, later, arrays.at(out, whole, [Static(slice(None, -1))]))
    return source


def where(out: Expressions, given: list[Value], _: Named) -> Value:
    """Numbers of one array or of another."""
    return arrays.elementwise(
        out, given, lambda x: f"{x[0].text} ? {out.real(x[1])} : {out.real(x[2])}"
    )


def diag(out: Expressions, given: list[Value], _: Named) -> Value:
    """A diagonal matrix."""
    items = out.items(given[0])
    made = filled(0.0).write(out, [Static((len(items), len(items)))], {})
    assert isinstance(made, Array)
    for i, each in enumerate(items):
        out.lines.append(f"{made.element(str(i), str(i))} = {out.real(each)};")
    return made


def copy(out: Expressions, given: list[Value], _: Named) -> Value:
    """A copy."""
    return out.copied(out.array(given[0]))


def tolist(out: Expressions, given: list[Value], _: Named) -> Value:
    """The numbers as a tuple, of tuples maybe."""

    def opened_up(value: Value) -> Value:
        if not isinstance(value, Array):
            return out.local(value)
        return Bundle(tuple, tuple(opened_up(each) for each in out.items(value)))

    return opened_up(out.array(given[0]))


def mean(out: Expressions, given: list[Value], _: Named) -> Value:
    """The mean."""
    whole = sum(out, given, {})
    count = out.program.literal(float(out.array(given[0]).size))
    return Scalar(f"({out.real(whole)} / {count})", REAL)


def smallest(out: Expressions, given: list[Value], _: Named) -> Value:
    """The least of them."""
    least, start = out.program.helper("least"), out.program.literal(float("inf"))
    return arrays.total(out, given[0], start, lambda a, x: f"{least}({a}, {x})")


def ravel(out: Expressions, given: list[Value], _: Named) -> Value:
    """The numbers in a row."""
    whole = out.dense(given[0])
    return Array(whole.text, (whole.size,), whole.root)


def reshape(out: Expressions, given: list[Value], _: Named) -> Value:
    """The same numbers row by row in another shape."""
    whole = out.dense(given[0])
    wanted = [out.static(each) for each in given[1:]]
    shape = np.empty(whole.size).reshape(*wanted).shape
    return Array(whole.text, shape, whole.root, (), whole.kind)


def nothing(_: Expressions, __: list[Value], ___: Named) -> Value:
    """What Python does to its own memory."""
    return Static(None)
