"""What a policy calls that is no plain Python: its network, and the formulas of its features."""

from __future__ import annotations

import ast
import inspect
import re
from collections.abc import Callable
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np

from steersman.controllers.policy import network_answer
from steersman.delivery.graph import CLIP, RELU, TANH, Network
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

if TYPE_CHECKING:
    from steersman.delivery.translate.expressions import Expressions
    from steersman.delivery.translate.program import Program

_FORMULA, _INDEX, _OWN, _CELL = range(4)
_BEGIN, _ADVANCE, _, _PLACE = range(4)
NETWORK = "network"
"""What the keys of the functions of networks begin with."""
# Hidden values beyond this leave no room for what is done with them in float.
_LARGEST = 1e30


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
    made = out.new_array((len(network.layers[-1].bias),), "action")
    name = network_function(out.program, network)
    out.lines.append(f"{name}({out.dense(features).text}, {made.text});")
    made.root.written = True
    return made


def network_function(program: Program, network: Network) -> str:
    """The name of the C function of a network, from features (n,) to actions (m,).

    Features are scaled and clipped in float. What follows is summed, in float, with about twice its
    digits: a hidden value has what rounding takes from it as its ``low``.

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
    size = np.full(len(network.scale), network.limit)
    for layer in network.layers:
        size = abs(layer.weights).astype(np.float64) @ size + abs(layer.bias)
        if size.max() > _LARGEST:
            what = f"a network with hidden values up to {size.max():.1e}"
            raise NotTranslatable(f"{what}, which leave float; use double")
        if layer.activation in {TANH, CLIP}:
            size = np.minimum(size, 1.0)


def _network_lines(program: Program, network: Network) -> list[str]:
    def known(numbers: Any) -> str:
        return program.constant(Static(numbers.astype(float))).text

    single, count = program.single, len(network.scale)
    actions = len(network.layers[-1].bias)
    arrays_, zero = ["values", "lows"] if single else ["values"], program.literal(0.0)
    sizes = [count, *(len(layer.bias) for layer in network.layers)]
    lines = [f"real {name}_{k}[{size}];" for k, size in enumerate(sizes) for name in arrays_]
    lines += [
        "int i;",
        f"for (i = 0; i < {count}; ++i) {{",
        f"const float x = (float)features[i] * (float){known(network.scale)}[i];",
        "if (x != x) {",
        *_each(actions, "actions[i] = (real)NAN;"),
        "return;",
        "}",
        f"values_0[i] = (real){program.helper('clipped')}(x, {network.limit:.1f}f);",
        *[f"lows_0[i] = {zero};"] * single,
        "}",
    ]
    for k, layer in enumerate(network.layers):
        weights, bias = known(layer.weights.T), known(layer.bias)
        given = [f"{name}_{k}" for name in arrays_] + [f"{name}_{k + 1}" for name in arrays_]
        sum_of = program.helper("exact_layer" if single else "layer")
        words = [weights, bias, str(sizes[k]), str(sizes[k + 1]), *given]
        lines.append(f"{sum_of}({', '.join(words)});")
        cell, low = f"values_{k + 1}[i]", f"lows_{k + 1}[i] = {zero};"
        if layer.activation == RELU:
            smaller = [f"if (!({cell} > {zero})) {{", f"{cell} = {zero};", *[low] * single, "}"]
            lines += _each(sizes[k + 1], *smaller)
        elif layer.activation in {TANH, CLIP}:
            answer = _bounded(program, layer.activation, cell)
            lines += _each(sizes[k + 1], f"{cell} = {answer};", *[low] * single)
    return [*lines, *_each(actions, f"actions[i] = values_{len(sizes) - 1}[i];")]


def _each(count: int, *lines: str) -> list[str]:
    return [f"for (i = 0; i < {count}; ++i) {{", *lines, "}"]


def _bounded(program: Program, activation: str, cell: str) -> str:
    one = program.literal(1.0)
    if activation == TANH:
        return f"{program.math('tanh')}({cell})"
    return f"{cell} < -{one} ? -{one} : ({cell} > {one} ? {one} : {cell})"


POLICY_CALLS: dict[Any, Special] = {
    network_answer: Special(_network),
    encode.encode.py_func: Special(_encode),  # type: ignore[attr-defined]
    encode.tell_base.py_func: Special(_tell_base),  # type: ignore[attr-defined]
    encode._update.py_func: Special(_update),  # type: ignore[attr-defined]
}
