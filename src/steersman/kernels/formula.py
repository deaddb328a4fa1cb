"""Formulas: scalar functions that are written once, in plain Python, for kernels and for C.

A formula is a function of named groups of numbers, such as ``seen.v_x`` or ``own.weight``. From
its source follow the compiled function, which kernels call through its address, and a syntax tree,
which :mod:`steersman.delivery.translate` writes as C. As the call goes through an address, one
compiled kernel serves every selection of formulas, those of other packages included.
"""

from __future__ import annotations

import ast
import ctypes
import hashlib
import inspect
import math
import re
import textwrap
from collections.abc import Callable, Mapping
from contextlib import suppress
from functools import cache
from typing import Any, NamedTuple, cast

import numpy as np
from llvmlite import ir  # type: ignore[import-untyped]
from numba import cfunc, types
from numba.extending import intrinsic, overload

from steersman.errors import ConfigError, shortened, suggestion
from steersman.types import FloatArray

_NUMBERS = types.CPointer(types.float64)
_SIGNATURE = types.float64(_NUMBERS, _NUMBERS, _NUMBERS, _NUMBERS, types.int64)
_POINTER = ctypes.POINTER(ctypes.c_double)
_CALL = ctypes.CFUNCTYPE(ctypes.c_double, *[_POINTER] * 4, ctypes.c_int64)


class Group(NamedTuple):
    """An argument of a formula: named numbers in a row, and perhaps pairs behind them."""

    columns: Mapping[str, int]
    """Place of each name in the row."""
    pairs: tuple[str, int] | None = None
    """Name of the pairs, which are read as ``seen.preview[j, 0]``, and where they begin."""
    whole: tuple[str, ...] = ()
    """Names of whole numbers, which may be indices."""


class Formula(NamedTuple):
    """A formula after its source was read."""

    function: Callable[..., float]
    """The function as it was written."""
    tree: ast.FunctionDef | None
    """Its syntax; None for a plain Python function."""
    address: int
    """Where the compiled function is."""
    placed: ast.FunctionDef | None = None
    """Its syntax with the numbers' places instead of their names."""


class _Columns(ast.NodeTransformer):
    """Turns names of numbers into their places."""

    def __init__(self, groups: Mapping[str, Group], where: str) -> None:
        self.groups, self.where = groups, where

    def visit_Subscript(self, node: ast.Subscript) -> ast.expr:
        group = self._group(node.value)
        if group is None or group.pairs is None or not isinstance(node.value, ast.Attribute):
            return cast("ast.expr", self.generic_visit(node))
        if node.value.attr != group.pairs[0] or not isinstance(node.slice, ast.Tuple):
            raise ConfigError(
                f"{self.where}: write {group.pairs[0]}[j, 0] or {group.pairs[0]}[j, 1]"
            )
        row, side = (cast("ast.expr", self.visit(each)) for each in node.slice.elts)
        place = ast.BinOp(ast.BinOp(ast.Constant(2), ast.Mult(), row), ast.Add(), side)
        shifted = ast.BinOp(ast.Constant(group.pairs[1]), ast.Add(), place)
        return ast.Subscript(node.value.value, shifted, ast.Load())

    def visit_Attribute(self, node: ast.Attribute) -> ast.expr:
        group = self._group(node)
        if group is None:
            return node
        if node.attr not in group.columns:
            name = cast("ast.Name", node.value).id
            near = suggestion(node.attr, group.columns)
            raise ConfigError(f"{self.where}: there is no {name}.{node.attr}{near}")
        place = ast.Constant(group.columns[node.attr])
        number = ast.Subscript(node.value, place, ast.Load())
        if node.attr in group.whole:
            return ast.Call(ast.Name("int", ast.Load()), [number], [])
        return number

    def _group(self, node: ast.expr) -> Group | None:
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
            return self.groups.get(node.value.id)
        return None


def numbers_of(component: Any) -> dict[str, float]:
    """The fields of a component that are numbers or switches, which its formulas can read."""
    values = {name: getattr(component, name) for name in type(component).model_fields}
    return {name: float(value) for name, value in values.items() if isinstance(value, int | float)}


def own_group(component: Any) -> Group:
    """The group ``self`` of a component's formulas."""
    names = numbers_of(component)
    whole = tuple(name for name in names if type(getattr(component, name)) is int)
    return Group({name: k for k, name in enumerate(names)}, None, whole)


def parse(function: Callable[..., float]) -> ast.FunctionDef:
    """The syntax of a function, at its lines in its file.

    Raises:
        ConfigError: its source is not at hand.
    """
    try:
        lines, first = inspect.getsourcelines(function)
        tree = ast.parse(textwrap.dedent("".join(lines))).body[0]
    except (OSError, TypeError, SyntaxError):
        raise ConfigError(f"{_name(function)}: its source is not at hand") from None
    if not isinstance(tree, ast.FunctionDef):
        raise ConfigError(f"{_name(function)}: write it with def")
    ast.increment_lineno(tree, first - 1)
    tree.decorator_list, tree.returns = [], None
    return tree


def _name(function: Callable[..., Any]) -> str:
    return f"{function.__module__}.{getattr(function, '__qualname__', function)}"


def compiled(function: Callable[..., float], groups: Mapping[str, Group]) -> Formula:
    """Compile a formula whose arguments are some of ``groups`` (four at most) and ``i``.

    numba keeps the result beside the function's file, or in the user's cache folder.

    Raises:
        ConfigError: an argument or a number is unknown, or numba cannot compile it.
    """
    return _compiled(function, tuple((name, _frozen(group)) for name, group in groups.items()))


def _frozen(group: Group) -> Any:
    return tuple(group.columns.items()), group.pairs, group.whole


@cache
def _compiled(function: Callable[..., float], frozen: tuple[tuple[str, Any], ...]) -> Formula:
    groups = {name: Group(dict(columns), *rest) for name, (columns, *rest) in frozen}
    where, tree = _name(function), parse(function)
    names = [*groups, *(f"unused_{k}" for k in range(4 - len(groups))), "i"]
    for argument in tree.args.args:
        if argument.arg not in names:
            allowed = ", ".join([*groups, "i"])
            raise ConfigError(f"{where}: unknown argument {argument.arg!r}; allowed: {allowed}")
    placed = _Columns(groups, where).visit(parse(function))
    placed.args = ast.arguments([], [ast.arg(name) for name in names], None, [], [], None, [])
    address = address_of(placed, function, function.__globals__, _SIGNATURE)
    return COMPILED.setdefault(address, Formula(function, tree, address, placed))


def address_of(
    placed: ast.FunctionDef, function: Callable[..., float], names: dict[str, Any], signature: Any
) -> int:
    """Where the compiled function is of a syntax tree made from ``function``, reading ``names``.

    Raises:
        ConfigError: numba cannot compile it.
    """
    module = ast.fix_missing_locations(ast.Module([placed], []))
    made: dict[str, Any] = {}
    exec(compile(module, inspect.getfile(function), "exec"), names, made)
    plain = made[placed.name]
    # numba's cache does not see constants: the name distinguishes formulas with other places.
    digest = hashlib.sha256(ast.dump(placed).encode()).hexdigest()[:12]
    plain.__qualname__ = f"{function.__qualname__}_{digest}"
    kept = _cfunc(plain, _name(function), signature)
    _KEPT.append(kept)
    return int(kept.address)


def _cfunc(plain: Callable[..., float], where: str, signature: Any) -> Any:
    compiler: Any = cfunc
    options = {"error_model": "numpy", "_nrt": False}
    try:
        with suppress(Exception):  # no folder can be written, or what is in it is damaged
            return compiler(signature, cache=True, **options)(plain)
        return compiler(signature, **options)(plain)
    except Exception as error:
        raise ConfigError(f"{where}: numba cannot compile it: {_reason(error)}") from error


def _reason(error: Exception) -> str:
    """The line of numba's message that says what is wrong."""
    text = re.sub(r"\x1b\[[0-9;]*m", "", str(error))
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    told = [line for line in lines if not line.startswith(("Failed in", "During:", "File "))]
    return (told or lines or [type(error).__name__])[0]


# Formulas by their addresses.
COMPILED: dict[int, Formula] = {}
# What has to stay in memory as long as its address is used, and what it has raised.
_KEPT: list[Any] = []
_FAULTS: list[Exception] = []


def from_python(function: Callable[[FloatArray], float], count: int) -> Formula:
    """A plain Python function of the first group's ``count`` numbers behind an address.

    What it raises is kept for :func:`check`, and its value is NaN.
    """

    def call_back(row: Any, *_: Any) -> float:
        try:
            return float(function(np.ctypeslib.as_array(row, (count,))))
        except Exception as error:  # noqa: BLE001 - raised again by check()
            _FAULTS.append(error)
            return math.nan

    made = _CALL(call_back)
    _KEPT.append(made)
    return Formula(function, None, ctypes.cast(made, ctypes.c_void_p).value or 0)


def called(function: Callable[[Any], Any], step: Any) -> float:
    """What a user's reward function returns; a ConfigError with its name if that is no number."""
    value = function(step)
    with suppress(TypeError, ValueError):
        if not isinstance(value, str | bytes):
            return float(value)
    name = getattr(function, "__name__", type(function).__name__)
    told = f"the function {name} returned {shortened(repr(value))}; a number is needed"
    raise ConfigError(told, ("reward",))


def check() -> None:
    """Raise what a function of :func:`from_python` has raised since the last time."""
    if _FAULTS:
        fault = _FAULTS[0]
        _FAULTS.clear()
        raise fault


def _jump(
    typing: Any, address: Any, seen: Any, loop: Any, own: Any, at: Any, cells: Any, i: Any
) -> Any:
    """Call the compiled formula at ``address``."""
    arrays = (seen, loop, own)

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        start, row, memory, fields, first, place, index = arguments
        data = [
            context.make_array(kind)(context, builder, value).data
            for kind, value in zip(arrays, (row, memory, fields), strict=True)
        ]
        double, whole = ir.DoubleType(), ir.IntType(64)
        pointer = double.as_pointer()
        kind = ir.FunctionType(double, [pointer] * 4 + [whole])
        target = builder.inttoptr(start, kind.as_pointer())
        given = [
            data[0],
            data[1],
            builder.gep(data[2], [first]),
            builder.gep(data[1], [place]),
            index,
        ]
        return builder.call(target, given)

    return types.float64(address, seen, loop, own, at, cells, i), generate


_JUMP: Any = intrinsic(_jump)


def call(
    address: int, seen: FloatArray, loop: FloatArray, own: FloatArray, at: int, cells: int, i: int
) -> float:
    """The value of the formula at ``address``.

    Its groups are ``seen``, ``loop``, ``own`` from place ``at`` on, and ``loop`` from place
    ``cells`` on; all of them contiguous.
    """
    starts = (
        seen.ctypes.data,
        loop.ctypes.data,
        own.ctypes.data + 8 * at,
        loop.ctypes.data + 8 * cells,
    )
    return float(_CALL(int(address))(*(ctypes.cast(p, _POINTER) for p in starts), int(i)))


@overload(call, strict=False)
def _call(address: Any, seen: Any, loop: Any, own: Any, at: Any, cells: Any, i: Any) -> Any:
    if not isinstance(seen, types.Array):
        return None  # rows of other numbers: see formula_slopes
    return lambda a, b, c, d, e, f, g: _JUMP(a, b, c, d, e, f, g)  # noqa: PLW0108 - numba requires it
