"""Arithmetic, comparisons and choices: known ones are computed, others become C text."""

from __future__ import annotations

import ast
import operator
from abc import abstractmethod
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from steersman.delivery.translate import arrays
from steersman.delivery.translate.emitter import Emitter
from steersman.delivery.translate.lines import bare
from steersman.delivery.translate.values import (
    BOOL,
    INT,
    REAL,
    Bundle,
    Maybe,
    NotTranslatable,
    Scalar,
    Static,
    Value,
    join,
    opened,
    same,
    scalar_kind,
    type_of,
)

_OPERATORS: dict[type, tuple[str, Callable[..., Any]]] = {
    ast.Add: ("+", operator.add), ast.Sub: ("-", operator.sub), ast.Mult: ("*", operator.mul),
    ast.Div: ("/", operator.truediv), ast.FloorDiv: ("/", operator.floordiv),
    ast.Mod: ("%", operator.mod), ast.Pow: ("**", operator.pow),
    ast.MatMult: ("@", operator.matmul), ast.BitOr: ("|", operator.or_),
    ast.Eq: ("==", operator.eq), ast.NotEq: ("!=", operator.ne), ast.Lt: ("<", operator.lt),
    ast.LtE: ("<=", operator.le), ast.Gt: (">", operator.gt), ast.GtE: (">=", operator.ge),
}  # fmt: skip
_LARGEST_POWER = 4


class Operators(Emitter):
    """Operators between values, and choices among them."""

    @abstractmethod
    def value(self, node: ast.expr) -> Value:
        """The value of an expression."""

    @abstractmethod
    def items(self, value: Value) -> list[Value]:
        """What a loop over it meets, one after the other."""

    def operate(self, op: type, a: Value, b: Value) -> Value:
        """An operator between two values."""
        if op not in _OPERATORS:
            raise NotTranslatable(f"the operator {op.__name__}")
        sign, compute = _OPERATORS[op]
        a, b = (each.item if isinstance(each, Maybe) else each for each in (a, b))
        if self.fixed(a) and self.fixed(b):
            with np.errstate(all="ignore"):
                return Static(compute(_known(a), _known(b)))
        if isinstance(a, Bundle) and isinstance(b, Bundle) and op is ast.Add:
            return Bundle(tuple, (*a.items, *b.items))
        a, b = (
            arrays.from_items(self, one)
            if isinstance(one, Bundle) and arrays.is_array(other)
            else one
            for one, other in ((a, b), (b, a))
        )
        if op is ast.MatMult:
            return arrays.product(self, a, b)
        if arrays.is_array(a) or arrays.is_array(b):
            return arrays.elementwise(self, [a, b], lambda x: self._binary(op, x[0], x[1]).text)
        return self._binary(op, a, b, sign)

    def _binary(self, op: type, a: Value, b: Value, sign: str = "") -> Scalar:
        if op not in _OPERATORS:
            raise NotTranslatable(f"the operator {op.__name__}")
        sign, compute = _OPERATORS[op]
        one, other = self.number(a), self.number(b)
        known, of = self._known_of(compute, one, other)
        if op is ast.Pow:
            return self._power(one, b, known, of)
        whole = INT in {one.kind, other.kind} and REAL not in {one.kind, other.kind}
        if op in {ast.FloorDiv, ast.Mod}:
            if not whole:
                raise NotTranslatable(f"whole quotients of {a} and {b}")
            helper = self.program.helper("floor_div" if op is ast.FloorDiv else "floor_mod")
            return Scalar(f"{helper}({one.text}, {other.text})", INT, known, of)
        if whole and op is not ast.Div:
            return Scalar(f"({one.text} {sign} {other.text})", INT, known, of)
        return Scalar(f"({self.real(one)} {sign} {self.real(other)})", REAL, known, of)

    @staticmethod
    def _known_of(compute: Callable[..., Any], *given: Scalar) -> tuple[Any, frozenset[str]]:
        if any(each.known is None for each in given):
            return None, frozenset()
        try:
            known = compute(*(each.known for each in given))
        except ArithmeticError:
            return None, frozenset()
        return known, frozenset().union(*(each.of for each in given))

    def _power(self, base: Scalar, exponent: Value, known: Any, of: frozenset[str]) -> Scalar:
        power = exponent.value if isinstance(exponent, Static) else None
        if isinstance(power, int) and 1 <= power <= _LARGEST_POWER:
            one = self.local(base)
            assert isinstance(one, Scalar)
            return Scalar(f"({' * '.join([one.text] * power)})", base.kind, known, of)
        pow_ = self.program.math("pow")
        return Scalar(f"{pow_}({self.real(base)}, {self.real(exponent)})", REAL, known, of)

    def _unaryop(self, node: ast.UnaryOp) -> Value:
        value = self.value(node.operand)
        if isinstance(node.op, ast.Not):
            return self._not(self.truth(value))
        if self.fixed(value):
            return Static(-_known(value))
        if arrays.is_array(value):
            return arrays.elementwise(self, [value], lambda x: f"(-{x[0].text})")
        one = self.number(value)
        known, of = self._known_of(operator.neg, one)
        return Scalar(f"(-{one.text})", one.kind, known, of)

    def _compare(self, node: ast.Compare) -> Value:
        left, tests = self.value(node.left), list[Static | Scalar]()
        if len(node.ops) == 1:
            right = self.value(node.comparators[0])
            op: type = type(node.ops[0])
            ordered = op not in {ast.Is, ast.IsNot, ast.In, ast.NotIn}
            if ordered and (arrays.is_array(left) or arrays.is_array(right)):
                return arrays.elementwise(
                    self, [left, right], lambda x: self._compared_text(op, x[0], x[1]), INT
                )
            return self.compare(op, left, right)
        for i, (each, right_node) in enumerate(zip(node.ops, node.comparators, strict=True)):
            right = self.value(right_node)
            if i < len(node.ops) - 1:
                right = self.local(right)
            tests.append(self.compare(type(each), left, right))
            left = right
        return self.every(tests)

    def every(self, tests: Sequence[Static | Scalar]) -> Static | Scalar:
        """Whether all of them hold."""
        out: Static | Scalar = Static(True)
        for each in tests:
            out = self.both(out, each)
        return out

    def both(self, a: Static | Scalar, b: Static | Scalar) -> Static | Scalar:
        """Whether both hold."""
        for one, other in ((a, b), (b, a)):
            if isinstance(one, Static):
                return other if one.value else Static(False)
        assert isinstance(a, Scalar)
        assert isinstance(b, Scalar)
        return Scalar(f"({a.text} && {b.text})", BOOL)

    def _compared_text(self, op: type, a: Scalar, b: Scalar) -> str:
        test = self.compare(op, a, b)
        assert isinstance(test, Scalar)
        return test.text

    def compare(self, op: type, a: Value, b: Value) -> Static | Scalar:
        """A comparison."""
        if op in {ast.Is, ast.IsNot} and None in (_known(a), _known(b)):
            missing = self._is_none(b if _known(a) is None else a)
            return missing if op is ast.Is else self._not(missing)
        if op in {ast.In, ast.NotIn}:
            test = self._any([self.compare(ast.Eq, a, each) for each in self.items(b)])
            return test if op is ast.In else self._not(test)
        return self._compared(op, opened(a), opened(b))

    def _compared(self, op: type, a: Value, b: Value) -> Static | Scalar:
        """A comparison of numbers, or of tuples of them."""
        op = ast.Eq if op is ast.Is else ast.NotEq if op is ast.IsNot else op
        if isinstance(a, Bundle) and isinstance(b, Bundle):
            pairs = zip(a.items, b.items, strict=True)
            same = self.every([self.compare(ast.Eq, x, y) for x, y in pairs])
            return same if op is ast.Eq else self._not(same)
        if self.fixed(a) and self.fixed(b):
            return Static(bool(_OPERATORS[op][1](_known(a), _known(b))))
        one, other = self.number(a), self.number(b)
        known, of = self._known_of(_OPERATORS[op][1], one, other)
        whole = REAL not in {one.kind, other.kind}
        left, right = (one.text, other.text) if whole else (self.real(one), self.real(other))
        return Scalar(f"({left} {_OPERATORS[op][0]} {right})", BOOL, known, of)

    @staticmethod
    def _is_none(value: Value) -> Static | Scalar:
        if isinstance(value, Maybe):
            return Scalar(f"(!{value.there.text})", BOOL)
        return Static(isinstance(value, Static) and value.value is None)

    def _not(self, test: Static | Scalar) -> Static | Scalar:
        if isinstance(test, Static):
            return Static(not test.value)
        return Scalar(f"(!{test.text})", BOOL)

    def _any(self, tests: list[Static | Scalar]) -> Static | Scalar:
        return self._not(self.every([self._not(each) for each in tests]))

    def truth(self, value: Value) -> Static | Scalar:
        """Whether Python takes a value for true."""
        match value:
            case Maybe(there, item):
                return self.both(there, self.truth(item))
            case Static(known, path):
                if scalar_kind(known) != REAL or not self.program.is_parameter(path):
                    return Static(bool(known))
            case Bundle():
                return Static(bool(value.items))
        one = self.number(value)
        if one.kind == BOOL:
            return one
        zero = self.program.literal(0.0 if one.kind == REAL else 0)
        return Scalar(f"({one.text} != {zero})", BOOL)

    def _boolop(self, node: ast.BoolOp) -> Value:
        out, stop = self.value(node.values[0]), isinstance(node.op, ast.Or)
        for each in node.values[1:]:
            test = self.truth(out)
            if isinstance(test, Static):
                if bool(test.value) == stop:
                    return out
                out = self.value(each)
                continue
            here, there = (out, each) if stop else (each, out)
            out = self._tests(test, out, each, "||" if stop else "&&") or self.either(
                test, here, there
            )
        return out

    def _tests(self, test: Scalar, out: Value, each: ast.expr, sign: str) -> Scalar | None:
        """Both tests in one expression, where both are tests and C can do so."""
        if not (isinstance(out, Scalar) and out.kind == BOOL):
            return None
        top, names = len(self.top), self._names
        with self.collected() as lines:
            other = self.value(each)
        if lines or not (isinstance(other, Scalar) and other.kind == BOOL):
            del self.top[top:]
            self._names = names
            return None
        return Scalar(f"({test.text} {sign} {other.text})", BOOL)

    def _ifexp(self, node: ast.IfExp) -> Value:
        test = self.truth(self.value(node.test))
        if isinstance(test, Static):
            return self.value(node.body if test.value else node.orelse)
        return self.either(test, node.body, node.orelse)

    def either(self, test: Scalar, yes: ast.expr | Value, no: ast.expr | Value) -> Value:
        """One of two values; each is computed only where it is taken."""
        sides: list[tuple[Value, list[str]]] = []
        for each in (yes, no):
            with self.collected() as lines:
                side = self.value(each) if isinstance(each, ast.expr) else each
            sides.append((side, lines))
        (a, before_a), (b, before_b) = sides
        wanted = join(type_of(a), type_of(b))
        if not before_a and not before_b and wanted.form == "scalar":
            kind = wanted.detail
            text = f"({test.text} ? {self.text(a, kind)} : {self.text(b, kind)})"
            return Scalar(text, kind)
        if wanted.form == "static":
            return a
        target = self.merged(a, b, before_a, before_b, "side")
        if before_a or before_b:
            self.lines += [f"if ({bare(test.text)}) {{", *before_a, "} else {", *before_b, "}"]
        return target

    def merged(
        self, a: Value, b: Value, lines_a: list[str], lines_b: list[str], hint: str
    ) -> Value:
        """One value for two branches; what differs is stored at the end of their lines."""
        if same(a, b):
            return a
        if isinstance(a, Bundle) and isinstance(b, Bundle) and len(a.items) == len(b.items):
            names = getattr(a.cls, "_fields", range(len(a.items)))
            pairs = zip(a.items, b.items, names, strict=True)
            items = [self.merged(x, y, lines_a, lines_b, f"{hint}_{k}") for x, y, k in pairs]
            return Bundle(a.cls, tuple(items))
        wanted = join(type_of(a), type_of(b))
        target = self.storage(wanted, hint)
        for before, value in ((lines_a, a), (lines_b, b)):
            with self.collected() as stored:
                self.store(target, value, wanted)
            before.extend(stored)
        return target


def _known(value: Value) -> Any:
    return value.value if isinstance(value, Static) else value
