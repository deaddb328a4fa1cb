"""Expressions: known ones are computed, others become C text."""

from __future__ import annotations

import ast
import dataclasses
import inspect
from collections.abc import Sequence
from typing import Any

import numpy as np

from steersman.delivery.translate import arrays
from steersman.delivery.translate.functions import CALLS, METHODS
from steersman.delivery.translate.operators import Operators
from steersman.delivery.translate.values import (
    INT,
    REAL,
    Array,
    Bundle,
    Maybe,
    NotTranslatable,
    Scalar,
    Static,
    Value,
    field_names,
    key,
    may_be_written,
    opened,
)


class Expressions(Operators):
    """Turns expressions into values; ``names`` are the function's variables."""

    names: dict[str, Value]
    world: dict[str, Any]
    """What the function's module holds."""

    def value(self, node: ast.expr) -> Value:
        """The value of an expression."""
        method = getattr(self, f"_{type(node).__name__.lower()}", None)
        if method is None:
            raise NotTranslatable(ast.unparse(node))
        return method(node)  # type: ignore[no-any-return]

    def _constant(self, node: ast.Constant) -> Value:
        return Static(node.value)

    def _name(self, node: ast.Name) -> Value:
        if node.id in self.names:
            return self.names[node.id]
        if node.id in self.world:
            return Static(self.world[node.id])
        builtin = self.world["__builtins__"]
        found = builtin if isinstance(builtin, dict) else vars(builtin)
        if node.id not in found:
            raise NotTranslatable(f"{node.id} before it has a value")
        return Static(found[node.id])

    def _tuple(self, node: ast.Tuple | ast.List) -> Value:
        return Bundle(tuple, tuple(self.values(node.elts)))

    _list = _set = _tuple

    def values(self, nodes: Sequence[ast.expr]) -> list[Value]:
        """Of several expressions, of which some may be starred."""
        out: list[Value] = []
        for each in nodes:
            if isinstance(each, ast.Starred):
                out += self.items(self.value(each.value))
            else:
                out.append(self.value(each))
        return out

    def items(self, value: Value) -> list[Value]:
        """What a loop over it meets, one after the other."""
        whole = opened(value)
        match whole:
            case Bundle():
                return list(whole.items)
            case Array():
                return [arrays.at(self, whole, [Static(i)]) for i in range(whole.shape[0])]
            case Maybe():
                return self.items(whole.item)
            case Static():
                return [Static(each) for each in whole.value]
        raise NotTranslatable(f"a loop over {value}")

    def _binop(self, node: ast.BinOp) -> Value:
        return self.operate(type(node.op), self.value(node.left), self.value(node.right))

    def _one_of(self, place: Scalar, known: Sequence[Any]) -> Value:
        """One of several known objects of a class: their arrays on a stack, the rest alike."""
        fields: list[Value] = []
        for name in field_names(type(known[0])):
            each = [getattr(one, name) for one in known]
            if all(key(one) == key(each[0]) for one in each):
                fields.append(Static(each[0]))
            else:
                fields.append(arrays.at(self, self.array(Static(np.stack(each))), [place]))
        return Bundle(type(known[0]), tuple(fields))

    def counted(self, there: Scalar, count: int) -> Scalar:
        """How many rows an array has that may be empty."""
        return Scalar(f"({there.text} ? {count} : 0)", INT)

    def _chosen(self, place: Scalar, items: Sequence[Value]) -> Value:
        """One of several numbers."""
        kinds = {self.number(each).kind for each in items}
        kind = REAL if REAL in kinds else INT
        out = self.text(items[-1], kind)
        for i in range(len(items) - 2, -1, -1):
            out = f"({place.text} == {i} ? {self.text(items[i], kind)} : {out})"
        return Scalar(out, kind)

    def _attribute(self, node: ast.Attribute) -> Value:
        return self.attribute(self.value(node.value), node.attr)

    def attribute(self, owner: Value, name: str) -> Value:
        """A field, a property or a constant."""
        match owner:
            case Maybe(there, Array(_, shape)) if name == "shape":
                return Bundle(tuple, (self.counted(there, shape[0]), *map(Static, shape[1:])))
            case Maybe():
                return self.attribute(owner.item, name)
            case Static():
                return self._part_of(owner, name)
            case Bundle() if name in field_names(owner.cls):
                return owner[name]
            case Bundle():
                found = inspect.getattr_static(owner.cls, name, None)
                if not isinstance(found, property):
                    raise NotTranslatable(f"{name} of {owner.cls.__name__}")
                return self.call(found.fget, [owner])
        return arrays.attribute(self.array(owner), name)

    def _part_of(self, owner: Static, name: str) -> Value:
        """What is known of something known; properties of what has parameters are computed in C."""
        found = inspect.getattr_static(type(owner.value), name, None)
        if isinstance(found, property) and owner.path is not None:
            return self.call(found.fget, [owner])
        path = None if owner.path is None else f"{owner.path}.{name}".lstrip(".")
        return Static(getattr(owner.value, name), path)

    def _subscript(self, node: ast.Subscript) -> Value:
        owner = opened(self.value(node.value))
        if isinstance(owner, Maybe):
            owner = opened(owner.item)
        places = node.slice.elts if isinstance(node.slice, ast.Tuple) else [node.slice]
        if isinstance(owner, Array) or (
            isinstance(owner, Static) and isinstance(owner.value, np.ndarray)
        ):
            return self._element(owner, places)
        place = self.place(places[0])
        if isinstance(owner, Static):
            if isinstance(place, Scalar):
                return self._one_of(place, owner.value)
            return Static(owner.value[self.static(place)])
        if not isinstance(owner, Bundle):
            raise NotTranslatable(ast.unparse(node))
        if isinstance(place, Scalar):
            whole = [each for each in owner.items if isinstance(each, Static)]
            if whole and dataclasses.is_dataclass(whole[0].value):
                return self._one_of(place, [each.value for each in whole])
            return self._chosen(place, owner.items)
        at = self.static(place)
        return Bundle(tuple, owner.items[at]) if isinstance(at, slice) else owner.items[at]

    def _element(self, owner: Value, places: Sequence[ast.expr]) -> Value:
        at = [self.place(each) for each in places]
        if self.fixed(owner) and all(isinstance(each, Static) for each in at):
            known = tuple(each.value for each in at)  # type: ignore[union-attr]
            return Static(owner.value[known if len(known) > 1 else known[0]])  # type: ignore[union-attr]
        return arrays.at(self, self.array(owner), at)

    def place(self, node: ast.expr) -> Value:
        """An index; slices are known, or start anywhere and have a known length."""
        if not isinstance(node, ast.Slice):
            found = self.value(node)
            return found if isinstance(found, Static) else self.number(found)
        first, last = node.lower, node.upper
        match first, last:
            case ast.Name(), ast.BinOp(ast.Name(), ast.Add(), count) if ast.unparse(
                last.left
            ) == ast.unparse(first):
                start = self.value(first)
                if isinstance(start, Scalar):
                    return Bundle(slice, (start, Static(self.static(self.value(count)))))
        three = (first, last, node.step)
        return Static(slice(*(each and self.static(self.value(each)) for each in three)))

    def _listcomp(self, node: ast.ListComp | ast.GeneratorExp) -> Value:
        (loop,) = node.generators
        out, before = [], dict(self.names)
        for each in self.items(self.value(loop.iter)):
            self.bind(loop.target, each)
            tests = [self.static(self.truth(self.value(test))) for test in loop.ifs]
            if all(tests):
                out.append(self.local(self.value(node.elt)))
        self.names = before
        return Bundle(tuple, tuple(out))

    _generatorexp = _listcomp

    def bind(self, target: ast.expr, value: Value) -> None:
        """Give a value to a name, or to several."""
        match target:
            case ast.Name(name):
                self.names[name] = value
            case ast.Tuple(targets) | ast.List(targets):
                values = self.items(value)
                stars = [i for i, each in enumerate(targets) if isinstance(each, ast.Starred)]
                if stars:
                    i, rest = stars[0], len(targets) - stars[0] - 1
                    end = len(values) - rest
                    values[i:end] = [Bundle(tuple, tuple(values[i:end]))]
                for one, each in zip(targets, values, strict=True):
                    self.bind(one.value if isinstance(one, ast.Starred) else one, each)
            case _:
                raise NotTranslatable(ast.unparse(target))

    def _call(self, node: ast.Call) -> Value:
        named = {
            str(each.arg): self.value(each.value) for each in node.keywords if each.arg is not None
        }
        for each in node.keywords:
            if each.arg is None:
                whole = self.static(self.value(each.value))
                named |= {name: Static(known) for name, known in whole.items()}
        if isinstance(node.func, ast.Attribute):
            owner = self.value(node.func.value)
            if isinstance(owner, Maybe):
                owner = owner.item
            given = self.values(node.args)
            if isinstance(owner, Static) and hasattr(owner.value, "_fields"):
                owner = opened(owner)
            name, known = node.func.attr, isinstance(owner, Static)
            if arrays.is_array(owner) and (name == "copy" or not self.fixed(owner)):
                known = False  # what is copied is written to
            if not known or not isinstance(owner, Static):
                return self.method(owner, name, given, named)
            function = inspect.getattr_static(type(owner.value), name, None)
            if inspect.isfunction(function):
                return self.call(function, [owner, *given], named)
            return self.call(getattr(owner.value, name), given, named)
        function = self.static(self.value(node.func))
        return self.call(function, self.values(node.args), named)

    def method(self, owner: Value, name: str, given: list[Value], named: dict[str, Value]) -> Value:
        """A call of a method of a tuple or an array."""
        if isinstance(owner, Bundle):
            if name == "_replace":
                fields = owner.cls._fields  # type: ignore[attr-defined]
                pairs = zip(fields, owner.items, strict=True)
                return Bundle(owner.cls, tuple(named.get(key, old) for key, old in pairs))
            found = inspect.getattr_static(owner.cls, name, None)
            if inspect.isfunction(found):
                return self.call(found, [owner, *given], named)
        if name in METHODS:
            return METHODS[name](self, [owner, *given], named)
        raise NotTranslatable(f"the method {name}")

    def call(
        self, function: Any, given: list[Value], named: dict[str, Value] | None = None
    ) -> Value:
        """A call of a function."""
        named = named or {}
        function = getattr(function, "py_func", function)
        whole = [*given, *named.values()]
        if not whole and (inspect.isbuiltin(function) or function is super):  # a clock, for one
            raise NotTranslatable(f"a call of {function.__name__}")
        special = CALLS.get(function) if function.__hash__ is not None else None
        fresh = special is not None and special.always
        if not fresh and all(self.known(each) for each in whole):
            known = [each.value for each in given if isinstance(each, Static)]
            more = {k: v.value for k, v in named.items() if isinstance(v, Static)}
            with np.errstate(all="ignore"):
                made = function(*known, **more)
            if not (hasattr(function, "cache_info") and may_be_written(made)):
                return Static(made)
        if special is not None:
            return special.write(self, given, named)
        if isinstance(function, type):
            return self._made(function, given, named)
        function = inspect.unwrap(function)
        if inspect.ismethod(function):
            given, function = [Static(function.__self__), *given], function.__func__
        if not inspect.isfunction(function) or function.__module__.startswith("numpy"):
            raise NotTranslatable(f"a call of {getattr(function, '__name__', function)}")
        return self.program.call(self, function, given, named)

    def _made(self, cls: type, given: list[Value], named: dict[str, Value]) -> Value:
        """A named tuple, or a dataclass."""
        names = field_names(cls)
        if not names:
            return self.local(given[0])  # an enumeration, whose numbers stay numbers
        rest = {k: Static(getattr(cls, "_field_defaults", {}).get(k)) for k in names}
        by_name = dict(zip(names, given, strict=False)) | named
        return Bundle(cls, tuple((rest | by_name)[each] for each in names))
