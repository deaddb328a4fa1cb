"""What an expression of the translated Python is: known, a number in C, an array, a tuple."""

from __future__ import annotations

import dataclasses
import enum
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any, TypeAlias

import numpy as np

REAL, INT, BOOL = "real", "int", "bool"


class NotTranslatable(Exception):
    """The Python holds what C cannot be made of."""


class Pinned(Exception):
    """A shape or a count depends on parameters, which are therefore constants."""

    def __init__(self, names: frozenset[str]) -> None:
        """Keep their names."""
        super().__init__(", ".join(sorted(names)))
        self.names = names


@dataclass(frozen=True, eq=False)
class Static:
    """Known at translation. A number or an array with a ``path`` is a parameter of the C code."""

    value: Any
    path: str | None = None


@dataclass(frozen=True)
class Scalar:
    """A number in C. ``known`` is its value if it depends on the parameters ``of`` alone."""

    text: str
    kind: str
    known: Any = None
    of: frozenset[str] = frozenset()


@dataclass
class Root:
    """The memory that arrays lie in."""

    name: str
    written: bool = False


@dataclass(frozen=True, eq=False)
class Array:
    """Numbers in C: the first one's address is ``text``; ``strides`` in numbers, not bytes."""

    text: str
    shape: tuple[int, ...]
    root: Root = field(default_factory=lambda: Root(""))
    strides: tuple[int, ...] = ()
    kind: str = REAL

    def __post_init__(self) -> None:
        """Without strides the numbers lie row by row."""
        if not self.strides:
            object.__setattr__(self, "strides", row_by_row(self.shape))

    @property
    def size(self) -> int:
        """How many numbers."""
        return int(np.prod(self.shape, dtype=int))

    @property
    def dense(self) -> bool:
        """Whether they lie row by row without gaps."""
        return self.strides == row_by_row(self.shape)

    def element(self, *at: str) -> str:
        """The number at these indices, as something that C can read and assign."""
        terms = [
            i if step == 1 else f"{i} * {step}"
            for i, step in zip(at, self.strides, strict=True)
            if step != 0
        ]
        return f"{self.text}[{' + '.join(each for each in terms if each != '0') or '0'}]"


def field_names(cls: type) -> tuple[str, ...]:
    """Names of what a named tuple, or a dataclass, holds."""
    if dataclasses.is_dataclass(cls):
        return tuple(each.name for each in dataclasses.fields(cls))
    return tuple(getattr(cls, "_fields", ()))


def row_by_row(shape: tuple[int, ...]) -> tuple[int, ...]:
    """Strides of numbers without gaps."""
    return tuple(int(np.prod(shape[i + 1 :], dtype=int)) for i in range(len(shape)))


@dataclass(frozen=True, eq=False)
class Bundle:
    """A tuple; ``cls`` is its NamedTuple, or ``tuple``."""

    cls: type
    items: tuple[Value, ...]

    def __getitem__(self, name: str) -> Value:
        """The field of that name."""
        return self.items[field_names(self.cls).index(name)]


@dataclass(frozen=True, eq=False)
class Maybe:
    """A value, or None while ``there`` is zero."""

    there: Scalar
    item: Value


Value: TypeAlias = Static | Scalar | Array | Bundle | Maybe


@dataclass(frozen=True)
class Type:
    """What is known of a value at translation; two values of one type go through the same C."""

    form: str
    """``static``, ``scalar``, ``array``, ``record``, ``maybe``, or ``never`` (no value yet)."""
    detail: Any = None
    parts: tuple[Type, ...] = ()
    example: Any = field(default=None, compare=False)


NEVER = Type("never")


def key(value: Any) -> Any:
    """A hashable stand-in of a known value."""
    if isinstance(value, np.ndarray):
        return ("array", value.shape, value.dtype.str, value.tobytes())
    if isinstance(value, enum.Enum):
        return (type(value), value.name)
    if isinstance(value, float):
        return (float, repr(value))
    if isinstance(value, bool | int | str | bytes | None):
        return (type(value), value)
    if isinstance(value, tuple):
        return (type(value), tuple(key(each) for each in value))
    return ("object", id(value))


def type_of(value: Value) -> Type:
    """The type of a value."""
    match value:
        case Static():
            return Type("static", (key(value.value), value.path), example=value)
        case Scalar():
            return Type("scalar", value.kind)
        case Array():
            return Type("array", (value.shape, value.kind))
        case Bundle():
            return Type("record", value.cls, tuple(type_of(each) for each in value.items))
        case Maybe():
            return Type("maybe", None, (type_of(value.item),))


def opened(value: Value) -> Value:
    """A known tuple as a record of known values; others as they are."""
    if isinstance(value, Static) and isinstance(value.value, tuple):
        names = getattr(type(value.value), "_fields", range(len(value.value)))
        parts = zip(names, value.value, strict=True)
        items = (Static(each, _below(value.path, str(name))) for name, each in parts)
        return Bundle(type(value.value), tuple(items))
    return value


def _below(path: str | None, name: str) -> str | None:
    return None if path is None else f"{path}.{name}".lstrip(".")


def scalar_kind(value: Any) -> str | None:
    """The kind of a known number; None if it is none."""
    if isinstance(value, bool | np.bool_):
        return BOOL
    if isinstance(value, int | np.integer):
        return INT
    return REAL if isinstance(value, float | np.floating) else None


def holds_reals(value: Any) -> bool:
    """Whether it is a floating-point number, or an array of them."""
    return scalar_kind(value) == REAL or (isinstance(value, np.ndarray) and value.dtype.kind == "f")


def may_be_written(value: Any) -> bool:
    """Whether it is, or holds, an array that is no constant."""
    if isinstance(value, tuple):
        return any(may_be_written(each) for each in value)
    return isinstance(value, np.ndarray) and value.flags.writeable


def join(a: Type, b: Type) -> Type:
    """The type that holds values of both.

    Raises:
        NotTranslatable: there is none.
    """
    if b in {a, NEVER}:
        return a
    if a == NEVER:
        return b
    for one, other in ((a, b), (b, a)):
        if one.form == "static" and one.example.value is None:
            return other if other.form == "maybe" else Type("maybe", None, (_loose(other),))
    if a.form == b.form == "static" and _empty(a) and _empty(b) and a.detail[0] == b.detail[0]:
        return type_of(Static(a.example.value))  # whatever it is called
    if "maybe" in {a.form, b.form}:
        inside = join(*(each.parts[0] if each.form == "maybe" else each for each in (a, b)))
        return inside if inside.form == "maybe" else Type("maybe", None, (inside,))
    return _joined(_loose(a), _loose(b))


def _empty(given: Type) -> bool:
    return isinstance(given.example.value, np.ndarray) and given.example.value.size == 0


def _joined(a: Type, b: Type) -> Type:
    """The type of values that are there, known or not."""
    if a == b:
        return a
    if a.form == b.form == "array" and 0 in {*a.detail[0], *b.detail[0]}:  # none, until there are
        return Type("maybe", None, (b if 0 in a.detail[0] else a,))
    if a.form == b.form == "scalar":
        order = (BOOL, INT, REAL)
        return Type("scalar", max(a.detail, b.detail, key=order.index))
    if a.form == b.form == "record" and len(a.parts) == len(b.parts) and a.detail == b.detail:
        pairs = zip(a.parts, b.parts, strict=True)
        return Type("record", a.detail, tuple(join(x, y) for x, y in pairs))
    raise NotTranslatable(f"one variable for {a.form} {a.detail} and {b.form} {b.detail}")


def _loose(given: Type) -> Type:
    """The type that also holds other numbers than the known ones."""
    if given.form != "static":
        return given
    value = opened(given.example)
    if isinstance(value, Bundle):
        return type_of(value)
    known = value.value  # type: ignore[union-attr]
    kind = scalar_kind(known)
    if kind is not None:
        return Type("scalar", kind)
    if isinstance(known, np.ndarray):
        return Type("array", (known.shape, REAL))
    return given


def leaves(value: Value) -> Iterator[Scalar | Array]:
    """What of a value has to be handed over in C."""
    match value:
        case Scalar() | Array():
            yield value
        case Bundle():
            for each in value.items:
                yield from leaves(each)
        case Maybe():
            yield value.there
            yield from leaves(value.item)


def converted(value: Value, wanted: Type) -> Value:
    """A value in the form of a type that was joined from its own; leaves keep their text.

    A missing item of a ``maybe`` stays ``Static(None)``, for which nothing is stored.
    """
    if wanted.form == "maybe":
        if isinstance(value, Static) and (value.value is None or np.size(value.value) == 0):
            return Maybe(Scalar("0", BOOL), Static(None))
        if not isinstance(value, Maybe):
            value = Maybe(Scalar("1", BOOL), value)
        return Maybe(value.there, converted(value.item, wanted.parts[0]))
    if wanted.form == "record":
        whole = opened(value)
        if not isinstance(whole, Bundle):
            return value
        pairs = zip(whole.items, wanted.parts, strict=True)
        return Bundle(whole.cls, tuple(converted(each, part) for each, part in pairs))
    return value


def same(a: Value, b: Value) -> bool:
    """Whether two values are one."""
    return a is b or (
        type_of(a) == type_of(b)
        and [each.text for each in leaves(a)] == [each.text for each in leaves(b)]
    )
