"""The state of a controller in C: its fields, and what they hold before the first step."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from steersman.delivery.translate.values import (
    Array,
    Bundle,
    Maybe,
    Root,
    Scalar,
    Static,
    Type,
    Value,
    join,
)


class StateField(NamedTuple):
    """A number, or numbers, of the state."""

    name: str
    kind: str
    size: int | None
    """How many numbers; None: one that is no array."""
    start: tuple[float, ...]
    """Before the first step."""


def settled(found: Type) -> Type:
    """The type in which all numbers of a tuple may change once one does, as of a shifted window."""
    if found.form != "record" or found.detail is not tuple:
        parts = tuple(settled(each) for each in found.parts)
        return Type(found.form, found.detail, parts, found.example)
    changing = next((each for each in found.parts if each.form == "scalar"), None)
    if changing is None:
        return found
    return Type("record", tuple, tuple(join(each, changing) for each in found.parts))


def named(known: Type, name: str) -> Value:
    """The state in C, by its type."""
    match known.form:
        case "scalar":
            return Scalar(name, known.detail)
        case "array":
            return Array(name, known.detail[0], Root("state", written=True), (), known.detail[1])
        case "record":
            fields = getattr(known.detail, "_fields", range(len(known.parts)))
            pairs = zip(fields, known.parts, strict=True)
            items = [
                named(part, f"{name}{'' if name.endswith('>') else '_'}{field}")
                for field, part in pairs
            ]
            return Bundle(known.detail, tuple(items))
        case "maybe":
            there = Scalar(f"{name}_known", "bool")
            return Maybe(there, named(known.parts[0], name))
    return known.example  # type: ignore[no-any-return]


def fields(value: Value, start: Value | None) -> Iterator[StateField]:
    """The fields of the C state, with what they are before the first step."""
    known = start.value if isinstance(start, Static) else None
    match value:
        case Scalar(text, kind):
            yield StateField(text.removeprefix("state->"), kind, None, (float(known or 0.0),))
        case Array(text):
            numbers = np.zeros(value.size) if known is None else np.asarray(known).ravel()
            yield StateField(text.removeprefix("state->"), value.kind, value.size, tuple(numbers))
        case Maybe(there, item):
            missing = isinstance(start, Static) and (known is None or np.size(known) == 0)
            yield StateField(
                there.text.removeprefix("state->"), "bool", None, (float(not missing),)
            )
            yield from fields(item, None if missing else start)
        case Bundle(_, items):
            parts = start.items if isinstance(start, Bundle) else [None] * len(items)
            for each, begun in zip(items, parts, strict=True):
                yield from fields(each, begun)
