"""What a policy calls that is no plain Python: its network, and the formulas of its features."""

from __future__ import annotations

import ast
import inspect
import re
from collections.abc import Callable, Sequence
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np

from steersman.controllers.policy import network_answer
from steersman.delivery import c_text
from steersman.delivery.graph import Network
from steersman.delivery.operations import OPERATORS, Operation
from steersman.delivery.translate import arrays
from steersman.delivery.translate.array_functions import Named, Special
from steersman.delivery.translate.lines import indented
from steersman.delivery.translate.values import (
    INT,
    Array,
    NotTranslatable,
    Scalar,
    Static,
    Value,
    opened,
)
from steersman.kernels import encode, formula
from steersman.kernels import observe as o
from steersman.types import FloatArray

if TYPE_CHECKING:
    from steersman.delivery.translate.expressions import Expressions
    from steersman.delivery.translate.program import Program

_FORMULA, _INDEX, _OWN, _CELL = range(4)
_BEGIN, _ADVANCE, _, _PLACE = range(4)
NETWORK = "network"
"""What the keys of the functions of networks begin with."""
# Hidden values beyond this leave no room for what is done with them in float.
_LARGEST = 1e30
# No feature of a usable observation is larger.
_FEATURE = 1e6


@cache
def placed_formula(address: int) -> Callable[..., float]:
    """The formula at an address as a function of arrays, with its syntax."""
    found = formula.COMPILED.get(address)
    if found is None or found.placed is None:
        raise NotTranslatable("a feature that is a plain Python function")
    module = ast.fix_missing_locations(ast.Module([found.placed], []))
    made: dict[str, Any] = {}
    code = compile(module, inspect.getfile(found.function), "exec")
    exec(code, found.function.__globals__, made)
    made[found.placed.name].placed = found.placed
    made[found.placed.name].__name__ = re.sub(r"\W+", "_", found.function.__qualname__).lower()
    return made[found.placed.name]  # type: ignore[no-any-return]


def _tail(out: Expressions, given: Array, first: int) -> Value:
    """The numbers of an array from a place on; where there is none, nothing reads them."""
    if first >= given.size:
        return Static(np.zeros(1))
    return arrays.at(out, given, [Static(slice(first, None))])


def _called(out: Expressions, table: Value, row: Array, memory: Array, *at: int) -> str:
    """The value of a formula: its address, the places of its settings and cells, its index."""
    address, own, cells, index = at
    settings = opened(table)["own"]  # type: ignore[index]
    mine = _tail(out, out.array(settings), own) if out.array(settings).size else Static(np.zeros(1))
    given = [row, memory, mine, _tail(out, memory, cells), Scalar(str(index), INT)]
    return out.real(out.program.call(out, placed_formula(address), given, {}))


def _numbers(out: Expressions, table: Value, name: str) -> list[list[int]]:
    return out.static(opened(table)[name]).tolist()  # type: ignore[index, no-any-return]


def _update(out: Expressions, given: list[Value], _: Named) -> Value:
    """Renew every cell by one of its formulas, the last cell first."""
    table, row, memory, which = given
    cells, kept = _numbers(out, table, "cells"), out.array(memory)
    kept.root.written = True
    for c in range(len(cells) - 1, -1, -1):
        address = cells[c][out.static(which)]
        if address:
            index, own, first = cells[c][_PLACE:]
            text = _called(out, table, out.array(row), kept, address, own, first, index)
            out.lines.append(f"{kept.element(str(encode.CELLS + c))} = {text};")
    return Static(None)


def _written(out: Expressions, given: list[Value], places: range) -> None:
    """Write features (features,) of ``table, row, memory, out``."""
    table, row, memory, to = given
    target = out.array(to)
    target.root.written = True
    for j in places:
        number = _numbers(out, table, "numbers")[j]
        at = number[_FORMULA], number[_OWN], number[_CELL], number[_INDEX]
        text = _called(out, table, out.array(row), out.array(memory), *at)
        out.lines.append(f"{target.element(str(j))} = {text};")


def _encode(out: Expressions, given: list[Value], _: Named) -> Value:
    """Renew the cells, then write all features."""
    table, row, memory, _to = given
    kept, seen, whole = out.array(memory), out.array(row), opened(table)
    kept.root.written = True
    started, last, base, dt, spacing = map(kept.element, map(str, range(5)))
    out.lines += [
        f"if ({started} == {out.program.literal(0.0)}) {{",
        f"{started} = {out.program.literal(1.0)};",
        f"{last} = {seen.element(str(o.O_STEER))};",
        f"{dt} = {out.real(whole['dt'])};",  # type: ignore[index]
        f"{spacing} = {out.real(whole['spacing'])};",  # type: ignore[index]
    ]
    _update(out, [table, row, memory, Static(_BEGIN)], {})
    out.lines.append("} else {")
    _update(out, [table, row, memory, Static(_ADVANCE)], {})
    out.lines += ["}", f"{base} = {last};"]
    _written(out, given, range(len(_numbers(out, table, "numbers"))))
    return Static(None)


def _tell_base(out: Expressions, given: list[Value], _: Named) -> Value:
    table, row, memory, base, to = given
    kept = out.array(memory)
    kept.root.written = True
    out.lines.append(f"{kept.element(str(encode.BASE_COMMAND))} = {out.real(base)};")
    last = len(_numbers(out, table, "numbers")) - 1
    _written(out, [table, row, memory, to], range(last, last + 1))
    return Static(None)


def _network(out: Expressions, given: list[Value], _: Named) -> Value:
    """The actions (m,)."""
    state, features = given
    network = out.static(opened(state)["run"]).network  # type: ignore[index]
    made = out.new_array((network.actions,), "action")
    name = network_function(out.program, network)
    out.lines.append(f"{name}({out.dense(features).text}, {made.text});")
    made.root.written = True
    return made


def network_function(program: Program, network: Network) -> str:
    """The name of the C function of a network, from features (n,) to actions (m,).

    What is done with features before the first layer is done in float. What follows is summed, in
    float, with about twice its digits: a hidden value has what rounding takes from it as its
    ``low``.

    Raises:
        NotTranslatable: its hidden values may leave float.
    """
    if program.single:
        _check_size(network)

    def write(name: str) -> str:
        lines = _network_lines(program, network)
        head = f"static void {name}(const real *features, real *actions)"
        return f"{head}\n{{\n" + "\n".join(indented(lines)) + "\n}\n"

    return program.written((NETWORK, id(network)), "network", write)


def _check_size(network: Network) -> None:
    """Refuse hidden values that leave float; operators are monotonic, features below a million."""
    size = _largest(network.head, np.full(network.features, _FEATURE))
    for layer in network.layers:
        size = abs(layer.weights).astype(np.float64) @ size + abs(layer.bias)
        if size.max() > _LARGEST:
            what = f"a network with hidden values up to {size.max():.1e}"
            raise NotTranslatable(f"{what}, which leave float; use double")
        size = _largest(layer.after, size)


def _largest(operations: Sequence[Operation], size: FloatArray) -> FloatArray:
    for each in operations:
        size = np.maximum(abs(each(size)), abs(each(-size)))
    return size


def _network_lines(program: Program, network: Network) -> list[str]:
    single, lows = program.single, ["lows"] * program.single
    sizes = [network.features, *(len(layer.bias) for layer in network.layers)]
    lines = [f"real {name}_{k}[{n}];" for k, n in enumerate(sizes) for name in ["values", *lows]]
    lines += [
        "int i;",
        f"for (i = 0; i < {network.features}; ++i) {{",
        "float x = (float)features[i];",
        *(f"x = {_text(program, each, 'x', head=True)};" for each in network.head),
        "if (x != x) {",
        *_each(network.actions, "actions[i] = (real)NAN;"),
        "return;",
        "}",
        "values_0[i] = (real)x;",
        *[f"lows_0[i] = {program.literal(0.0)};"] * single,
        "}",
    ]
    for k, layer in enumerate(network.layers):
        given = [f"{name}_{j}" for j in (k, k + 1) for name in ["values", *lows]]
        sizes_of = [str(sizes[k]), str(sizes[k + 1])]
        numbers = [_constant(program, each) for each in (layer.weights.T, layer.bias)]
        sum_of = program.helper("exact_layer" if single else "layer")
        lines.append(f"{sum_of}({', '.join([*numbers, *sizes_of, *given])});")
        cell, low = f"values_{k + 1}[i]", f"lows_{k + 1}[i] = {program.literal(0.0)};"
        done = [line for each in layer.after for line in _done(program, each, cell, low)]
        lines += _each(sizes[k + 1], *done) if done else []
    return [*lines, *_each(network.actions, f"actions[i] = values_{len(sizes) - 1}[i];")]


def _constant(program: Program, numbers: Any) -> str:
    return program.constant(Static(numbers.astype(float))).text


def _done(program: Program, operation: Operation, cell: str, low: str) -> list[str]:
    """The lines of an operator; what rounding takes stays beside a number that Relu leaves."""
    lows = [low] * program.single
    if operation.name == "Relu":
        zero = program.literal(0.0)
        return [f"if (!({cell} > {zero})) {{", f"{cell} = {zero};", *lows, "}"]
    return [f"{cell} = {_text(program, operation, cell)};", *lows]


def _text(program: Program, operation: Operation, x: str, *, head: bool = False) -> str:
    """An operator in C; the head's is in float."""
    numbers = []
    for each in operation.numbers:
        if each.size == 1:
            known = float(each[0])
            numbers.append(c_text.decimal(known) if head else program.literal(known))
        else:
            numbers.append(f"{'(float)' * head}{_constant(program, each)}[i]")
    end = "f" if head or program.single else ""
    return OPERATORS[operation.name].text.format(*numbers, x=x, f=end)


def _each(count: int, *lines: str) -> list[str]:
    return [f"for (i = 0; i < {count}; ++i) {{", *lines, "}"]


POLICY_CALLS: dict[Any, Special] = {
    network_answer: Special(_network),
    encode.encode.py_func: Special(_encode),  # type: ignore[attr-defined]
    encode.tell_base.py_func: Special(_tell_base),  # type: ignore[attr-defined]
    encode._update.py_func: Special(_update),  # type: ignore[attr-defined]
}
