"""Statements: branches that are known are taken, others and loops become those of C."""

from __future__ import annotations

import ast
import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from steersman.delivery.translate import arrays
from steersman.delivery.translate.lines import bare
from steersman.delivery.translate.loops import Loops
from steersman.delivery.translate.values import (
    NEVER,
    REAL,
    Array,
    Maybe,
    NotTranslatable,
    Scalar,
    Static,
    Type,
    Value,
    join,
    leaves,
    type_of,
)

if TYPE_CHECKING:
    from steersman.delivery.translate.program import Program


class Statements(Loops):
    """One function. ``result`` is the type of what it returns, once that is known."""

    def __init__(
        self, program: Program, names: dict[str, Value], world: dict[str, Any], result: Type
    ) -> None:
        """Begin with the arguments."""
        super().__init__(program)
        self.names, self.world, self.result = names, world, result
        self.returned: Type = NEVER
        self.over = False
        """Whether what follows is never reached."""
        self.targets: Value | None = None
        """Where results are stored; None: a C function returns its one number."""
        self._loop = None

    def block(self, body: Sequence[ast.stmt]) -> None:
        """Statements one after the other."""
        for each in body:
            if self.over:
                return
            method = getattr(self, f"_{type(each).__name__.lower()}", None)
            if method is None:
                raise NotTranslatable(ast.unparse(each).splitlines()[0])
            try:
                method(each)
            except NotTranslatable as error:
                if not hasattr(error, "line"):
                    error.line = each.lineno  # type: ignore[attr-defined]
                raise

    def _expr(self, node: ast.Expr) -> None:
        if not isinstance(node.value, ast.Constant):
            self.value(node.value)

    def _pass(self, node: ast.Pass) -> None:
        pass

    _assert = _import = _importfrom = _pass

    def _try(self, node: ast.Try) -> None:
        """C raises nothing."""
        self.block([*node.body, *node.orelse, *node.finalbody])

    def _with(self, node: ast.With) -> None:
        self.block(node.body)

    def _return(self, node: ast.Return) -> None:
        value = Static(None) if node.value is None else self.value(node.value)
        self.returned = join(self.returned, type_of(value))
        self.finish(value)

    def finish(self, value: Value) -> None:
        """Hand a result over, and leave the function."""
        if self.result != NEVER:
            if self.targets is None and self.result.form == "scalar":
                self.lines.append(f"return {self.text(value, self.result.detail)};")
            else:
                if self.targets is not None:
                    self.store(self.targets, value, self.result)
                self.lines.append("return;")
        self.over = True

    def _assign(self, node: ast.Assign) -> None:
        value = self.value(node.value)
        for target in node.targets:
            self._assigned(target, value)

    def _annassign(self, node: ast.AnnAssign) -> None:
        if node.value is not None:
            self._assigned(node.target, self.value(node.value))

    def _assigned(self, target: ast.expr, value: Value) -> None:
        match target:
            case ast.Name(name):
                self.names[name] = self.local(value, name)
            case ast.Subscript():
                self._write(target, value)
            case ast.Tuple(targets) if any(isinstance(x, ast.Subscript) for x in targets):
                values = [self.local(each) for each in self.items(value)]
                for one, each in zip(targets, values, strict=True):
                    self._assigned(one, each)
            case _:
                self.bind(target, self.local(value))

    def _write(self, target: ast.Subscript, value: Value) -> None:
        owner = self.value(target.value)
        if not isinstance(owner, Array):
            raise NotTranslatable(f"{ast.unparse(target)} is written to")
        owner.root.written = True
        places = target.slice.elts if isinstance(target.slice, ast.Tuple) else [target.slice]
        at = [self.place(each) for each in places]
        if any(isinstance(x, Static) and isinstance(x.value, range | list | tuple) for x in at):
            raise NotTranslatable(ast.unparse(target))
        part = arrays.at(self, owner, at)
        if isinstance(part, Scalar):
            self.lines.append(f"{part.text} = {self.text(value, part.kind)};")
            return
        assert isinstance(part, Array)
        if not arrays.is_array(value) and not isinstance(value, Scalar | Static):
            value = arrays.from_items(self, value)
        indices = self.loops(part.shape)
        source = (
            arrays.spread(self.array(value), part.shape).element(*indices)
            if arrays.is_array(value)
            else self.text(value, part.kind)
        )
        self.lines.append(f"{part.element(*indices)} = {source};")
        self.ended(indices)

    def _augassign(self, node: ast.AugAssign) -> None:
        now = self.value(node.target)
        if isinstance(now, Array):  # numbers are changed in place
            changed = self.operate(type(node.op), now, self.value(node.value))
            now.root.written = True
            self.copy(now, self.array(changed))
            return
        self._assigned(node.target, self.operate(type(node.op), now, self.value(node.value)))

    def _if(self, node: ast.If) -> None:
        test = self.truth(self.value(node.test))
        if isinstance(test, Static):
            self.block(node.body if test.value else node.orelse)
            return
        name, missing = _tested_for_none(node.test)
        sides = [
            self._side(body, name if empty is False else None)
            for body, empty in ((node.body, missing), (node.orelse, _opposite(missing)))
        ]
        names, heads = self._merged(sides), (f"if ({bare(test.text)}) {{", "} else {")
        for (_, lines, _), head in zip(sides, heads, strict=True):
            if head.startswith("if") or lines:
                self.lines += [head, *lines]
        self.lines.append("}")
        self.over = all(over for _, _, over in sides)
        self.names = names

    def _side(
        self, body: Sequence[ast.stmt], present: str | None
    ) -> tuple[dict[str, Value], list[str], bool]:
        """One branch: its names, lines, and whether it leaves. ``present`` is not None there."""
        before = self.names
        self.names = dict(before)
        there = None if present is None else self.names.get(present)
        if present is not None and isinstance(there, Maybe):
            self.names[present] = there.item
        with self.collected() as lines:
            self.block(body)
        names, over = self.names, self.over
        self.names, self.over = before, False
        return names, lines, over

    def _merged(
        self, sides: Sequence[tuple[dict[str, Value], list[str], bool]]
    ) -> dict[str, Value]:
        """The names after a branch; what differs is stored at the end of each side."""
        open_sides = [each for each in sides if not each[2]]
        if len(open_sides) < len(sides):
            return open_sides[0][0] if open_sides else self.names
        (a, lines_a, _), (b, lines_b, _) = open_sides
        out: dict[str, Value] = {}
        for name in a:
            if name not in b:
                continue
            out[name] = self.merged(a[name], b[name], lines_a, lines_b, name)
        return out

    def _raise(self, node: ast.Raise) -> None:
        """What has no solution has NaN for all numbers of it."""
        if node.exc is None or "LinAlgError" not in ast.unparse(node.exc):
            raise NotTranslatable(ast.unparse(node))
        self.program.unsolved = True
        nan = Static(math.nan)
        if self.targets is not None:
            for each in leaves(self.targets):
                if isinstance(each, Array):
                    indices = self.loops(each.shape)
                    self.lines.append(f"{each.element(*indices)} = {self.real(nan)};")
                    self.ended(indices)
                elif each.kind == REAL:
                    self.lines.append(f"{each.text} = {self.real(nan)};")
            self.lines.append("return;")
        elif self.result.form == "scalar":
            self.lines.append(f"return {self.real(nan)};")
        self.over = True


def _tested_for_none(test: ast.expr) -> tuple[str | None, bool | None]:
    """A name that is compared with None, and whether it is None where the test holds."""
    match test:
        case ast.Compare(ast.Name(name), [ast.Is()], [ast.Constant(None)]):
            return name, True
        case ast.Compare(ast.Name(name), [ast.IsNot()], [ast.Constant(None)]):
            return name, False
    return None, None


def _opposite(flag: bool | None) -> bool | None:
    return None if flag is None else not flag
