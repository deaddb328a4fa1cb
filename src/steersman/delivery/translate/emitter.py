"""Lines of one C function: its local variables, and what is stored where."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import numpy as np

from steersman.delivery.translate.lines import bare
from steersman.delivery.translate.values import (
    BOOL,
    INT,
    REAL,
    Array,
    Bundle,
    Maybe,
    NotTranslatable,
    Pinned,
    Root,
    Scalar,
    Static,
    Type,
    Value,
    converted,
    holds_reals,
    leaves,
    scalar_kind,
)

if TYPE_CHECKING:
    from steersman.delivery.translate.program import Program

_ATOM = re.compile(r"[A-Za-z_]\w*|\d+")


def c_type(kind: str) -> str:
    """The C type of a kind of number."""
    return "real" if kind == REAL else "int"


class Emitter:
    """Collects lines, and turns values into C text."""

    def __init__(self, program: Program) -> None:
        """Begin with no lines."""
        self.program = program
        self.lines: list[str] = []
        self.top: list[str] = []
        self._names = 0

    def fresh(self, hint: str) -> str:
        """A new name."""
        self._names += 1
        return f"{re.sub(r'[^a-z0-9_]', '', hint.lower()) or 't'}_{self._names}"

    @contextmanager
    def collected(self) -> Iterator[list[str]]:
        """Lines that are written meanwhile."""
        before, self.lines = self.lines, []
        try:
            yield self.lines
        finally:
            self.lines = before

    def number(self, value: Value) -> Scalar:
        """A value as a number in C."""
        if isinstance(value, Maybe):
            return self.number(value.item)
        if isinstance(value, Scalar):
            return value
        if isinstance(value, Static):
            kind = scalar_kind(value.value)
            if kind is not None:
                return self._known(value, kind)
        raise NotTranslatable(f"{value} where a number is expected")

    def _known(self, value: Static, kind: str) -> Scalar:
        if kind == REAL and self.program.is_parameter(value.path):
            assert value.path is not None
            text = self.program.parameter(value.path, value.value)
            return Scalar(text, REAL, float(value.value), frozenset({value.path}))
        plain = value.value if kind == REAL else int(value.value)
        return Scalar(self.program.literal(plain), kind, value.value)

    def real(self, value: Value) -> str:
        """A value as floating-point text."""
        if isinstance(value, Static) and scalar_kind(value.value) in {INT, BOOL}:
            value = Static(float(value.value))
        one = self.number(value)
        return one.text if one.kind == REAL else f"(real){one.text}"

    def text(self, value: Value, kind: str) -> str:
        """A value as a number of that kind."""
        return self.real(value) if kind == REAL else self.number(value).text

    def array(self, value: Value) -> Array:
        """A value as an array in C."""
        if isinstance(value, Maybe):
            return self.array(value.item)
        if isinstance(value, Array):
            return value
        if isinstance(value, Static) and isinstance(value.value, np.ndarray):
            return self.program.constant(value)
        raise NotTranslatable(f"{value} where an array is expected")

    def dense(self, value: Value) -> Array:
        """The same, with its numbers row by row."""
        given = self.array(value)
        return given if given.dense else self.copied(given)

    def static(self, value: Value) -> Any:
        """What is known of a value that C has to know when it is compiled.

        Raises:
            Pinned: it depends on parameters.
            NotTranslatable: it depends on more.
        """
        if isinstance(value, Static):
            if scalar_kind(value.value) == REAL and self.program.is_parameter(value.path):
                raise Pinned(frozenset({str(value.path)}))
            return value.value
        if isinstance(value, Scalar) and value.known is not None:
            if not value.of:
                return value.known
            raise Pinned(value.of)
        if isinstance(value, Bundle):
            return tuple(self.static(each) for each in value.items)
        what = getattr(value, "text", value)
        raise NotTranslatable(f"{what}, which changes, where C needs a constant")

    def fixed(self, value: Value) -> bool:
        """Whether a value is known and no parameter."""
        return isinstance(value, Static) and not (
            self.program.is_parameter(value.path) and holds_reals(value.value)
        )

    def known(self, value: Value) -> bool:
        """Whether Python can compute with it: known, and without parameters in it."""
        return isinstance(value, Static) and (
            value.path is None or (self.fixed(value) and scalar_kind(value.value) is not None)
        )

    def local(self, value: Value, hint: str = "t") -> Value:
        """The value at this moment: its numbers in local constants."""
        match value:
            case Scalar(text, kind) if not _ATOM.fullmatch(text) or "store" in text:
                name = self.fresh(hint)
                self.lines.append(f"const {c_type(kind)} {name} = {bare(text)};")
                return Scalar(name, kind, value.known, value.of)
            case Bundle(cls, items):
                names = getattr(cls, "_fields", range(len(items)))
                pairs = zip(items, names, strict=True)
                return Bundle(cls, tuple(self.local(x, f"{hint}_{name}") for x, name in pairs))
            case Maybe():
                there = self.local(value.there, hint)
                assert isinstance(there, Scalar)
                return Maybe(there, self.local(value.item, hint))
        return value

    def new_array(
        self,
        shape: tuple[int, ...],
        hint: str = "a",
        kind: str = REAL,
        lines: list[str] | None = None,
    ) -> Array:
        """An array of this function's, with whatever is in it."""
        name = self.fresh(hint)
        made = Array(name, shape, Root(name), (), kind)
        (self.top if lines is None else lines).append(
            f"{c_type(kind)} {name}[{max(made.size, 1)}];"
        )
        return made

    def storage(self, wanted: Type, hint: str, target: list[str] | None = None) -> Value:
        """Variables for any value of a type."""
        lines = self.top if target is None else target
        match wanted.form:
            case "static":
                return wanted.example  # type: ignore[no-any-return]
            case "scalar":
                name = self.fresh(f"{hint}_store")
                zero = self.program.literal(0.0) if wanted.detail == REAL else "0"
                lines.append(f"{c_type(wanted.detail)} {name} = {zero};")
                return Scalar(name, wanted.detail)
            case "array":
                return self.new_array(wanted.detail[0], f"{hint}_store", wanted.detail[1], lines)
            case "record":
                names = getattr(wanted.detail, "_fields", range(len(wanted.parts)))
                parts = zip(names, wanted.parts, strict=True)
                items = [self.storage(each, f"{hint}_{name}", lines) for name, each in parts]
                return Bundle(wanted.detail, tuple(items))
            case "maybe":
                there = self.storage(Type("scalar", BOOL), f"{hint}_there", lines)
                assert isinstance(there, Scalar)
                item = self.storage(wanted.parts[0], hint, lines)
                for part in leaves(item):
                    if isinstance(part, Array):  # it may be copied while there is nothing in it
                        size = f"{part.text}[{max(part.size, 1)}]"
                        at = next(i for i, each in enumerate(lines) if size in each)
                        lines[at] = lines[at].replace(f"{size};", f"{size} = {{0}};")
                return Maybe(there, item)
        raise NotTranslatable(f"a variable {hint} without a value")

    def store(self, target: Value, value: Value, wanted: Type) -> None:
        """Write a value to variables of a type that holds it."""
        if wanted.form in {"static", "never"}:
            return
        self._store(target, converted(value, wanted))

    def _store(self, target: Value, value: Value) -> None:
        match target, value:
            case Scalar(), _:
                if not (isinstance(value, Static) and value.value is None):
                    self.lines.append(f"{target.text} = {bare(self.text(value, target.kind))};")
            case Array(), _:
                if not (isinstance(value, Static) and value.value is None):
                    self.copy(target, self.array(value))
            case Bundle(), Bundle():
                for one, other in zip(target.items, value.items, strict=True):
                    self._store(one, other)
            case Maybe(), Maybe():
                self._store(target.there, value.there)
                if not (isinstance(value.item, Static) and value.item.value is None):
                    self._store(target.item, value.item)

    def copied(self, source: Array, hint: str = "copy") -> Array:
        """A copy of an array, row by row."""
        made = self.new_array(source.shape, hint, source.kind)
        self.copy(made, source)
        return made

    def copy(self, target: Array, source: Array) -> None:
        """Copy numbers."""
        if target.shape != source.shape:
            raise NotTranslatable(f"shape {source.shape} where {target.shape} is expected")
        if target.text == source.text:
            return
        target.root.written = True
        if target.dense and source.dense and target.kind == source.kind == REAL:
            copied = self.program.helper("copied")
            self.lines.append(f"{copied}({target.text}, {source.text}, {target.size});")
            return
        at = self.loops(target.shape)
        self.lines.append(f"{target.element(*at)} = {source.element(*at)};")
        self.ended(at)

    def loops(self, shape: tuple[int, ...]) -> list[str]:
        """Open a loop for each axis; their indices."""
        indices = [self.fresh("k") for _ in shape]
        for name, count in zip(indices, shape, strict=True):
            self.top.append(f"int {name};")
            self.lines.append(f"for ({name} = 0; {name} < {count}; ++{name}) {{")
        return indices

    def ended(self, indices: list[str]) -> None:
        """Close them."""
        self.lines.extend("}" for _ in indices)


def texts(value: Value) -> list[str]:
    """The text of each leaf."""
    return [each.text for each in leaves(value)]
