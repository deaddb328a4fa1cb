"""Formulas of features as C99 functions in float32, from the syntax of their Python source."""

from __future__ import annotations

import ast
from collections.abc import Mapping
from types import ModuleType
from typing import Any

from steersman.delivery.c_text import decimal
from steersman.errors import DataError
from steersman.kernels.formula import Formula

_OPERATORS: dict[type, str] = {
    ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/", ast.FloorDiv: "/", ast.Mod: "%",
    ast.USub: "-", ast.UAdd: "+", ast.Not: "!", ast.And: " && ", ast.Or: " || ",
    ast.Eq: "==", ast.NotEq: "!=", ast.Lt: "<", ast.LtE: "<=", ast.Gt: ">", ast.GtE: ">=",
}  # fmt: skip
_TWO = 2
_WHOLE_ONLY = (ast.FloorDiv, ast.Mod)
# Functions of math, and Python's own, by their names in C.
_FUNCTIONS = {
    **{name: f"{name}f" for name in (
        "sin", "cos", "tan", "asin", "acos", "atan", "atan2", "sinh", "cosh", "tanh", "exp", "log",
        "sqrt", "hypot", "floor", "ceil", "copysign",
    )},
    "float": "(float)", "abs": "fabsf", "fabs": "fabsf", "min": "least", "max": "most",
}  # fmt: skip


class Writer:
    """Writes the formulas of one feature.

    Each gives the C text of what stands in a formula: ``numbers`` of single numbers, such as
    ``seen.v_x``; ``whole`` of whole numbers, such as ``self.count``; ``pairs`` of rows of pairs,
    such as ``seen.preview``; ``memory`` of the cells.
    """

    def __init__(
        self,
        kind: str,
        numbers: Mapping[str, str],
        whole: Mapping[str, int],
        pairs: Mapping[str, str],
        memory: str,
    ) -> None:
        """Keep what the names mean."""
        self.kind, self.numbers, self.whole = kind, numbers, whole
        self.pairs, self.memory = pairs, memory
        self._globals: dict[str, Any] = {}
        self._locals: set[str] = set()

    def body(self, formula: Formula) -> list[str]:
        """The lines of a function's body; ``i`` is an int.

        Raises:
            DataError: the formula holds what C text cannot be made of.
        """
        if formula.tree is None:
            raise self._fault(None, "a plain Python function")
        self._globals, self._locals = formula.function.__globals__, set()
        return self._block(formula.tree.body)

    def _fault(self, node: ast.AST | None, what: str) -> DataError:
        line = f" (line {node.lineno})" if isinstance(node, ast.expr | ast.stmt) else ""
        return DataError(f"feature {self.kind}{line}: C code cannot be made of {what}")

    def _block(self, statements: list[ast.stmt]) -> list[str]:
        return [line for each in statements for line in self._statement(each)]

    def _statement(self, node: ast.stmt) -> list[str]:
        match node:
            case ast.Expr(ast.Constant(str())):
                return []
            case ast.Return(ast.expr() as value):
                return [f"return {self.real(value)};"]
            case ast.Assign([ast.Name(name)], value):
                text = f"{name} = {self.real(value)};"
                new = name not in self._locals
                self._locals.add(name)
                return [f"float {text}" if new else text]
            case ast.If(test, body, otherwise):
                lines = [f"if ({self._test(test)}) {{", *self._inner(body)]
                if otherwise:
                    lines += ["} else {", *self._inner(otherwise)]
                return [*lines, "}"]
        raise self._fault(node, ast.unparse(node).splitlines()[0])

    def _inner(self, body: list[ast.stmt]) -> list[str]:
        known = set(self._locals)
        lines = [f"    {line}" for line in self._block(body)]
        if self._locals != known:
            raise self._fault(body[0], "a name that is new inside an if: give it a value before")
        return lines

    def real(self, node: ast.expr) -> str:
        """An expression as a float."""
        match node:
            case ast.Constant() | ast.Name():
                return self._leaf(node)
            case ast.Attribute() | ast.Subscript():
                return self._number(node)
            case ast.Call(function, arguments, []):
                return self._call(function, arguments)
            case ast.IfExp(test, body, otherwise):
                return f"({self._test(test)} ? {self.real(body)} : {self.real(otherwise)})"
        return self._arithmetic(node)

    def _leaf(self, node: ast.Constant | ast.Name) -> str:
        if isinstance(node, ast.Name) and node.id in self._locals:
            return node.id
        if isinstance(node, ast.Name) and node.id == "i":
            return "(float)i"
        value = node.value if isinstance(node, ast.Constant) else self._globals.get(node.id)
        if not isinstance(value, int | float):
            raise self._fault(node, ast.unparse(node))
        return decimal(value, self.kind)

    def _arithmetic(self, node: ast.expr) -> str:
        match node:
            case ast.BinOp(left, ast.Pow(), right):
                return f"powf({self.real(left)}, {self.real(right)})"
            case ast.BinOp(left, operator, right) if not isinstance(operator, _WHOLE_ONLY):
                return f"({self.real(left)} {self._sign(node, operator)} {self.real(right)})"
            case ast.UnaryOp(ast.USub() | ast.UAdd() as operator, operand):
                return f"({_OPERATORS[type(operator)]}{self.real(operand)})"
        raise self._fault(node, ast.unparse(node))

    def _sign(self, node: ast.expr, operator: ast.AST) -> str:
        if type(operator) not in _OPERATORS:
            raise self._fault(node, ast.unparse(node))
        return _OPERATORS[type(operator)]

    def _call(self, function: ast.expr, arguments: list[ast.expr]) -> str:
        match function:
            case ast.Name(name):
                module: Any = None
            case ast.Attribute(ast.Name(owner), name):
                module = self._globals.get(owner)
            case _:
                raise self._fault(function, ast.unparse(function))
        own = module is None or (isinstance(module, ModuleType) and module.__name__ == "math")
        if name not in _FUNCTIONS or not own:
            raise self._fault(function, ast.unparse(function))
        written = [self.real(each) for each in arguments]
        while name in {"min", "max"} and len(written) > _TWO:
            written[:_TWO] = [f"{_FUNCTIONS[name]}({written[0]}, {written[1]})"]
        return f"{_FUNCTIONS[name]}({', '.join(written)})"

    def _number(self, node: ast.expr) -> str:
        text = ast.unparse(node)
        match node:
            case ast.Attribute() if text in self.numbers:
                return self.numbers[text]
            case ast.Attribute(ast.Name("math"), name) if name in {"pi", "tau", "e"}:
                return decimal(getattr(self._globals["math"], name), name)
            case ast.Subscript(ast.Name("memory"), place):
                return f"{self.memory}[{self._whole(place)}]"
            case ast.Subscript(row, ast.Tuple([place, side])) if ast.unparse(row) in self.pairs:
                name = self.pairs[ast.unparse(row)]
                return f"{name}[{self._whole(place)}][{self._whole(side)}]"
        raise self._fault(node, text)

    def _whole(self, node: ast.expr) -> str:
        """An expression as an int."""
        match node:
            case ast.Constant(int() as value):
                return str(value)
            case ast.Name("i"):
                return "i"
            case ast.Attribute() if ast.unparse(node) in self.whole:
                return str(self.whole[ast.unparse(node)])
            case ast.BinOp(left, operator, right) if not isinstance(operator, ast.Div | ast.Pow):
                sign = self._sign(node, operator)
                return f"({self._whole(left)} {sign} {self._whole(right)})"
        raise self._fault(node, f"{ast.unparse(node)} as a whole number")

    def _test(self, node: ast.expr) -> str:
        match node:
            case ast.Compare(left, [operator], [right]) if type(operator) in _OPERATORS:
                write = self._whole if self._only_i(left, right) else self.real
                return f"{write(left)} {_OPERATORS[type(operator)]} {write(right)}"
            case ast.BoolOp(operator, values):
                return _OPERATORS[type(operator)].join(f"({self._test(each)})" for each in values)
            case ast.UnaryOp(ast.Not(), operand):
                return f"!({self._test(operand)})"
        return f"{self.real(node)} != 0.0f"

    @staticmethod
    def _only_i(*sides: ast.expr) -> bool:
        """Whether ``i`` and whole numbers are all that is compared."""
        leaves = [each for side in sides for each in ast.walk(side)]
        names = [each.id for each in leaves if isinstance(each, ast.Name)]
        real = any(isinstance(each, ast.Constant) and type(each.value) is float for each in leaves)
        return set(names) == {"i"} and not real
