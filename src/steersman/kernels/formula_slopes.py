"""Derivatives of formulas, from the declaration that they are: the same source with dual numbers.

A formula's derivative is compiled from its syntax tree once more, with rows of dual numbers in the
place of its groups. :func:`steersman.kernels.formula.call` calls it by its address where it is
given such rows, so that kernels that add up formulas work with either kind of numbers.
"""

from __future__ import annotations

import ast
import copy
from collections.abc import Sequence
from functools import cache
from typing import Any

from llvmlite import ir  # type: ignore[import-untyped]
from numba import types
from numba.extending import intrinsic, overload

from steersman.errors import ConfigError
from steersman.kernels import dual as _rules  # noqa: F401 - the chain rules
from steersman.kernels.dual_number import DUAL, ROW, WIDTH, load, store
from steersman.kernels.formula import Formula, address_of, call

_intrinsic: Any = intrinsic
_NUMBERS = types.CPointer(types.float64)
_SIGNATURE = types.void(*[_NUMBERS] * 4, types.int64, _NUMBERS)


@_intrinsic
def _as_row(typing: Any, numbers: Any) -> Any:
    return ROW(_NUMBERS), lambda context, builder, signature, arguments: arguments[0]


class _Returns(ast.NodeTransformer):
    """Returned values are written behind the last argument."""

    def visit_Return(self, node: ast.Return) -> list[ast.stmt]:
        value = node.value or ast.Constant(None)
        put = ast.Call(ast.Name("_put", ast.Load()), [ast.Name("_out", ast.Load()), value], [])
        return [ast.Expr(put), ast.Return(None)]


@_intrinsic
def _put(typing: Any, out: Any, number: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        value = context.cast(builder, arguments[1], signature.args[1], DUAL)
        store(context, builder, arguments[0], value)
        return context.get_dummy_value()

    return types.void(_NUMBERS, number), generate


def slopes(formula: Formula) -> int:
    """Where the compiled derivative of a formula is.

    Raises:
        ConfigError: it is a plain Python function, or numba cannot compile it with dual numbers.
    """
    if formula.placed is None:
        name = getattr(formula.function, "__qualname__", formula.function)
        raise ConfigError(
            f"{name} is a plain Python function, which has no derivative; write it as a formula "
            "(docs/rewards_and_features.md)"
        )
    return _compiled(formula)


@cache
def _compiled(formula: Formula) -> int:
    tree = copy.deepcopy(formula.placed)
    assert tree is not None
    names = [argument.arg for argument in tree.args.args]
    taken = [
        ast.Assign(
            [ast.Name(name, ast.Store())],
            ast.Call(ast.Name("_as_row", ast.Load()), [ast.Name(name, ast.Load())], []),
        )
        # Behind seen and loop come the component's own settings, which are plain numbers.
        for name in (names[0], names[1], names[3])
    ]
    tree = _Returns().visit(tree)
    tree.name = f"{tree.name}_slopes"
    tree.body = [*taken, *tree.body]
    tree.args.args.append(ast.arg("_out"))
    known = {**formula.function.__globals__, "_as_row": _as_row, "_put": _put}
    return address_of(tree, formula.function, known, _SIGNATURE)


class _Settled(ast.NodeTransformer):
    """Keeps of each branch the side that is taken, where what is known decides it."""

    def __init__(self, known: dict[str, Any]) -> None:
        self.known = known

    def visit_IfExp(self, node: ast.IfExp) -> Any:
        taken = _known(node.test, self.known)
        if taken is None:
            return self.generic_visit(node)
        return self.visit(node.body if taken else node.orelse)

    def visit_If(self, node: ast.If) -> Any:
        taken = _known(node.test, self.known)
        if taken is None:
            return self.generic_visit(node)
        found = [self.visit(each) for each in (node.body if taken else node.orelse)]
        return [one for each in found for one in (each if isinstance(each, list) else [each])]


def _settled(
    formula: Formula, own: Sequence[float], i: int
) -> tuple[list[ast.stmt], dict[str, Any], dict[str, int]]:
    """What a formula computes of its ``i``-th number, what is known, and its groups by name."""
    assert formula.placed is not None
    names = [argument.arg for argument in formula.placed.args.args]
    assigned = {
        each.id
        for each in ast.walk(formula.placed)
        if isinstance(each, ast.Name) and isinstance(each.ctx, ast.Store)
    }
    known = {names[2]: own, "i": i, "int": int}
    known = {name: value for name, value in known.items() if name not in assigned}
    tree = _Settled(known).visit(copy.deepcopy(formula.placed))
    ends = [k for k, each in enumerate(tree.body) if isinstance(each, ast.Return)]
    body = tree.body[: ends[0] + 1] if ends else tree.body
    return body, known, {names[0]: 0, names[1]: 1, names[3]: 2}


def reads(formula: Formula, own: Sequence[float], i: int, sizes: Sequence[int]) -> list[list[int]]:
    """The places that a formula may read in its first, second and last group, ascending.

    Args:
        formula: the formula.
        own: settings of its component.
        i: which of the component's numbers it is.
        sizes: how many numbers the three groups have; what lies beyond is left out.
    """
    body, known, groups = _settled(formula, own, i)
    found: list[set[int]] = [set(), set(), set()]
    for node in (each for statement in body for each in ast.walk(statement)):
        if not isinstance(node, ast.Subscript) or not isinstance(node.value, ast.Name):
            continue
        group = groups.get(node.value.id)
        if group is not None:
            found[group] |= _places(node.slice, known, sizes[group])
    return [sorted(places) for places in found]


def hands_on(formula: Formula, own: Sequence[float], i: int) -> bool:
    """Whether a formula gives a number that it reads as it is: its only derivative is one."""
    body, _, groups = _settled(formula, own, i)
    steps = [each for each in body if not isinstance(each, ast.Expr)]  # docstrings
    value = steps[0].value if len(steps) == 1 and isinstance(steps[0], ast.Return) else None
    if (
        isinstance(value, ast.Call)
        and isinstance(value.func, ast.Name)
        and value.func.id == "float"
    ):
        value = value.args[0]
    return (
        isinstance(value, ast.Subscript)
        and isinstance(value.value, ast.Name)
        and value.value.id in groups
    )


def _known(expression: ast.expr, known: dict[str, Any]) -> Any:
    """The value of an expression that depends on nothing but ``known``, else None."""
    whole = ast.fix_missing_locations(ast.Expression(copy.deepcopy(expression)))
    try:
        return eval(compile(whole, "index", "eval"), {"__builtins__": {}}, known)  # noqa: S307
    except (NameError, ArithmeticError):
        return None


def _places(index: ast.expr, known: dict[str, Any], size: int) -> set[int]:
    """The place that an index names, or all of them if it depends on more than is known."""
    place = _known(index, known)
    return set(range(size)) & ({int(place)} if place is not None else set(range(size)))


@_intrinsic
def _leap(
    typing: Any, address: Any, seen: Any, loop: Any, own: Any, at: Any, cells: Any, i: Any
) -> Any:
    """Call the compiled derivative at ``address``."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        start, row, memory, fields, first, place, index = arguments
        settings = context.make_array(signature.args[3])(context, builder, fields).data
        double, whole = ir.DoubleType(), ir.IntType(64)
        pointer = double.as_pointer()
        kind = ir.FunctionType(ir.VoidType(), [pointer] * 4 + [whole, pointer])
        with builder.goto_entry_block():
            out = builder.alloca(double, WIDTH)
        behind = builder.gep(memory, [builder.mul(place, whole(WIDTH))])
        given = [row, memory, builder.gep(settings, [first]), behind, index, out]
        builder.call(builder.inttoptr(start, kind.as_pointer()), given)
        return load(context, builder, out)

    return DUAL(address, ROW, ROW, own, at, cells, i), generate


@overload(call, strict=False)
def _call(address: Any, seen: Any, loop: Any, own: Any, at: Any, cells: Any, i: Any) -> Any:
    if seen is not ROW:
        return None
    return lambda a, b, c, d, e, f, g: _leap(a, b, c, d, e, f, g)  # noqa: PLW0108 - numba needs it
