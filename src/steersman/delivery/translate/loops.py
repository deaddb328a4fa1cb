"""Loops: over what is known they are written out, others become those of C."""

from __future__ import annotations

import ast
from abc import abstractmethod
from collections.abc import Sequence

from steersman.delivery.translate.expressions import Expressions
from steersman.delivery.translate.values import (
    INT,
    NotTranslatable,
    Scalar,
    Static,
    Type,
    Value,
    join,
    same,
    type_of,
)

_PASSES = 6


class _Loop:
    """The variables that a loop carries from turn to turn."""

    def __init__(self, types: dict[str, Type], targets: dict[str, Value]) -> None:
        self.types, self.targets = types, targets
        self.found = dict(types)


class Loops(Expressions):
    """Loops of a function. ``over``: what follows is never reached."""

    over: bool
    read: frozenset[tuple[str, int]] = frozenset()
    """Names that are read, with their lines."""
    _loop: _Loop | None

    @abstractmethod
    def block(self, body: Sequence[ast.stmt]) -> None:
        """Statements one after the other."""

    def _for(self, node: ast.For) -> None:
        match node.iter:
            case ast.Call(ast.Name("range"), bounds):
                limits = [self.value(each) for each in bounds]
                self._counted(node, limits)
            case _:
                for each in self.items(self.value(node.iter)):
                    self.bind(node.target, self.local(each))
                    self.block(node.body)
                    if self.over:
                        return

    def _counted(self, node: ast.For, limits: list[Value]) -> None:
        first, last = (Static(0), limits[0]) if len(limits) == 1 else limits[:2]
        step = self.static(limits[2]) if len(limits) > 2 else 1  # noqa: PLR2004
        if not isinstance(node.target, ast.Name):
            raise NotTranslatable(ast.unparse(node.target))
        name = self.fresh(node.target.id)
        last = self.local(self.number(last), "last")
        self.top.append(f"int {name};")
        sign, way = ("<", f"{name} += {step}") if step > 0 else (">", f"{name} -= {-step}")
        start, end = self.text(first, INT), self.text(last, INT)
        head = f"for ({name} = {start}; {name} {sign} {end}; {way}) {{"
        self._turns(node, head, {node.target.id: Scalar(name, INT)}, None)

    def _while(self, node: ast.While) -> None:
        self._turns(node, "for (;;) {", {}, node.test)

    def _turns(
        self, node: ast.For | ast.While, head: str, given: dict[str, Value], test: ast.expr | None
    ) -> None:
        """A loop in C: what it changes is stored at the end of each turn."""
        if node.orelse:
            raise NotTranslatable("else behind a loop")
        changed = {
            each.id
            for part in node.body
            for each in ast.walk(part)
            if isinstance(each, ast.Name) and isinstance(each.ctx, ast.Store)
        }
        types = {k: type_of(self.names[k]) for k in sorted(changed) if k in self.names}
        later = changed & {name for name, line in self.read if line > (node.end_lineno or 0)}
        before, outer = dict(self.names), self._loop
        for _ in range(_PASSES):
            top, names = list(self.top), self._names
            with self.collected():
                found = self._turn(node, types, given, test).found
            new = (later - types.keys()) & self.names.keys()
            found |= {k: type_of(self.names[k]) for k in sorted(new)}
            self.top[:], self._names, self.names, self.over = top, names, dict(before), False
            if found == types:
                break
            types = found
        targets = {k: self.storage(t, k) for k, t in types.items()}
        for name, wanted in types.items():
            if name in before:
                self.store(targets[name], before[name], wanted)
        with self.collected() as lines:
            self._turn(node, types, given, test, targets)
        self.lines += [head, *lines, "}"]
        self.names, self._loop, self.over = {**before, **targets}, outer, False

    def _turn(
        self,
        node: ast.For | ast.While,
        types: dict[str, Type],
        given: dict[str, Value],
        test: ast.expr | None,
        targets: dict[str, Value] | None = None,
    ) -> _Loop:
        """One turn, with the variables that the loop carries in their places."""
        outer = self._loop
        if targets is None:
            targets = {k: self.storage(t, k) for k, t in types.items()}
        loop = self._loop = _Loop(types, targets)
        self.names |= targets | given
        if test is not None:
            going = self.truth(self.value(test))
            if not isinstance(going, Static):
                self.lines.append(f"if (!{going.text}) {{")
                self.lines += ["break;", "}"]
        self.block(node.body)
        if not self.over:
            self._keep()
        self._loop = outer
        return loop

    def _keep(self) -> None:
        """Store what the loop carries."""
        loop = self._loop
        assert loop is not None
        waiting = []
        for name, wanted in loop.types.items():
            value = self.names[name]
            loop.found[name] = join(loop.found[name], type_of(value))
            if not same(value, loop.targets[name]):
                waiting.append((name, self.local(value, name), wanted))
        for name, value, wanted in waiting:
            if loop.found[name] == wanted:
                self.store(loop.targets[name], value, wanted)

    def _break(self, node: ast.Break) -> None:
        self._keep()
        self.lines.append("break;")
        self.over = True

    def _continue(self, node: ast.Continue) -> None:
        self._keep()
        self.lines.append("continue;")
        self.over = True
