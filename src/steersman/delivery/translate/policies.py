"""What a policy calls that is no plain Python: its network, and the formulas of its features."""

from __future__ import annotations

import ast
import inspect
from collections.abc import Callable
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np

from steersman.controllers.policy import network_answer
from steersman.delivery.graph import CLIP, RELU, TANH
from steersman.delivery.translate import arrays
from steersman.delivery.translate.array_functions import Named, Special
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

_FORMULA, _INDEX, _OWN, _CELL = range(4)
_BEGIN, _ADVANCE, _, _PLACE = range(4)


@cache
def _placed(address: int) -> Callable[..., float]:
    """The formula at an address as a function of arrays, with its syntax."""
    found = formula.COMPILED.get(address)
    if found is None or found.placed is None:
        raise NotTranslatable("a feature that is a plain Python function")
    module = ast.fix_missing_locations(ast.Module([found.placed], []))
    made: dict[str, Any] = {}
    code = compile(module, inspect.getfile(found.function), "exec")
    exec(code, found.function.__globals__, made)
    made[found.placed.name].placed = found.placed
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
    return out.real(out.program.call(out, _placed(address), given, {}))


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
    """The actions (m,): features scaled and clipped in float, then layer by layer."""
    state, features = given
    network, known = out.static(opened(state)["run"]).network, out.program.constant  # type: ignore[index]
    seen, clip = out.array(features), out.program.helper("clipped")
    scale = known(Static(network.scale.astype(float)))
    here = out.new_array(seen.shape, "scaled")
    (i,) = out.loops(seen.shape)
    single = f"(float){seen.element(i)} * (float){scale.element(i)}"
    out.lines.append(f"{here.element(i)} = (real){clip}({single}, {network.limit:.1f}f);")
    out.ended([i])
    for layer in network.layers:
        weights, bias = (known(Static(each.astype(float))) for each in layer[:2])
        made = out.new_array(bias.shape, "layer")
        (j,) = out.loops(bias.shape)
        cell = made.element(j)
        out.lines.append(f"{cell} = {bias.element(j)};")
        (i,) = out.loops(here.shape)
        out.lines.append(f"{cell} += {weights.element(j, i)} * {here.element(i)};")
        out.ended([i])
        out.lines += [f"{cell} = {_activated(out, layer.activation, cell)};"]
        out.ended([j])
        here = made
    return here


def _activated(out: Expressions, activation: str, cell: str) -> str:
    zero, one = out.program.literal(0.0), out.program.literal(1.0)
    if activation == RELU:
        return f"{cell} > {zero} ? {cell} : {zero}"
    if activation == TANH:
        return f"{out.program.math('tanh')}({cell})"
    if activation == CLIP:
        return f"{cell} < -{one} ? -{one} : ({cell} > {one} ? {one} : {cell})"
    return cell


POLICY_CALLS: dict[Any, Special] = {
    network_answer: Special(_network),
    encode.encode.py_func: Special(_encode),  # type: ignore[attr-defined]
    encode.tell_base.py_func: Special(_tell_base),  # type: ignore[attr-defined]
    encode._update.py_func: Special(_update),  # type: ignore[attr-defined]
}
