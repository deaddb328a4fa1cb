"""Arrays in C: indices, arithmetic number by number, products."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from steersman.delivery.translate.values import (
    BOOL,
    REAL,
    Array,
    Bundle,
    Maybe,
    NotTranslatable,
    Scalar,
    Static,
    Value,
    scalar_kind,
)

if TYPE_CHECKING:
    from steersman.delivery.translate.operators import Operators

_MATRIX = 2


def is_array(value: Value) -> bool:
    """Whether arithmetic with it goes number by number."""
    if isinstance(value, Maybe):
        return is_array(value.item)
    return isinstance(value, Array) or (
        isinstance(value, Static) and isinstance(value.value, np.ndarray)
    )


def attribute(owner: Array, name: str) -> Value:
    """A property of an array."""
    match name:
        case "shape":
            return Static(owner.shape)
        case "ndim":
            return Static(len(owner.shape))
        case "size":
            return Static(owner.size)
        case "dtype":
            return Static(np.dtype(np.float64))
        case "T":
            return Array(owner.text, owner.shape[::-1], owner.root, owner.strides[::-1], owner.kind)
    raise NotTranslatable(f"{name} of an array")


def at(out: Operators, owner: Array, places: Sequence[Value]) -> Value:
    """What stands at indices and slices: a number, or a part of the array."""
    offset, shape, strides = [], [], []
    for i, (count, step) in enumerate(zip(owner.shape, owner.strides, strict=True)):
        place = places[i] if i < len(places) else Static(slice(None))
        begin, length, jump = _part(out, place, count)
        offset.append(begin if step == 1 else f"{begin} * {step}")
        if length is not None:
            shape.append(length)
            strides.append(step * jump)
    moved = " + ".join(each for each in offset if not each.startswith("0 *") and each != "0")
    if not shape:
        return Scalar(f"{owner.text}[{moved or '0'}]", owner.kind)
    text = f"({owner.text} + {moved})" if moved else owner.text
    return Array(text, tuple(shape), owner.root, tuple(strides), owner.kind)


def _part(out: Operators, place: Value, count: int) -> tuple[str, int | None, int]:
    """First index as text, number of indices (None: an index alone), and step."""
    if isinstance(place, Bundle):  # a slice that begins anywhere
        return out.number(place.items[0]).text, out.static(place.items[1]), 1
    if isinstance(place, Static) and isinstance(place.value, slice):
        span = range(*place.value.indices(count))
        return str(span.start if span else 0), len(span), span.step
    if isinstance(place, Static):
        index = int(place.value)
        if not -count <= index < count:
            raise NotTranslatable(f"index {index} of {count} numbers")
        return str(index % count), None, 1
    return out.number(place).text, None, 1


def broadcast(shapes: Sequence[tuple[int, ...]]) -> tuple[int, ...]:
    """The common shape of arrays in arithmetic, as numpy has it."""
    return tuple(np.broadcast_shapes(*shapes))


def spread(given: Array, shape: tuple[int, ...]) -> Array:
    """The array in a larger shape, its numbers repeated."""
    missing = len(shape) - len(given.shape)
    strides = [0] * missing + [
        0 if count == 1 and count != wanted else step
        for count, step, wanted in zip(given.shape, given.strides, shape[missing:], strict=True)
    ]
    return Array(given.text, shape, given.root, tuple(strides), given.kind)


def elementwise(
    out: Operators,
    given: Sequence[Value],
    write: Callable[[list[Scalar]], str],
    kind: str = REAL,
) -> Array:
    """Compute each number of an array from those at its place in others."""
    sources = [out.array(each) if is_array(each) else out.number(each) for each in given]
    shape = broadcast([each.shape for each in sources if isinstance(each, Array)])
    made = out.new_array(shape, "each", kind)
    indices = out.loops(shape)
    numbers = [
        Scalar(spread(each, shape).element(*indices), each.kind)
        if isinstance(each, Array)
        else each
        for each in sources
    ]
    out.lines.append(f"{made.element(*indices)} = {write(numbers)};")
    out.ended(indices)
    return made


def total(out: Operators, given: Value, start: str, step: Callable[[str, str], str]) -> Scalar:
    """Fold the numbers of an array, in order."""
    source = out.array(given)
    name = out.fresh("total_store")
    whole = start in {"0", "1"}
    out.lines.append(f"{'int' if whole else 'real'} {name} = {start};")
    indices = out.loops(source.shape)
    out.lines.append(f"{name} = {step(name, source.element(*indices))};")
    out.ended(indices)
    return Scalar(name, BOOL if whole else REAL)


def product(out: Operators, a: Value, b: Value) -> Value:
    """The matrix product; vectors as numpy has them."""
    one, other = out.array(a), out.array(b)
    left = one if len(one.shape) == _MATRIX else _as_row(one)
    right = other if len(other.shape) == _MATRIX else _as_column(other)
    if left.shape[1] != right.shape[0]:
        raise NotTranslatable(f"a product of shapes {one.shape} and {other.shape}")
    made = out.new_array((left.shape[0], right.shape[1]), "product")
    row, column = out.loops((left.shape[0], right.shape[1]))
    cell = made.element(row, column)
    out.lines.append(f"{cell} = {out.program.literal(0.0)};")
    (k,) = out.loops((left.shape[1],))
    out.lines.append(f"{cell} += {left.element(row, k)} * {right.element(k, column)};")
    out.ended([row, column, k])
    if len(one.shape) == len(other.shape) == 1:
        return Scalar(f"{made.text}[0]", REAL)
    shape = (*one.shape[:-1], *(other.shape[1:] if len(other.shape) == _MATRIX else ()))
    return Array(made.text, shape, made.root)


def _as_row(given: Array) -> Array:
    return Array(given.text, (1, *given.shape), given.root, (0, *given.strides))


def _as_column(given: Array) -> Array:
    return Array(given.text, (*given.shape, 1), given.root, (*given.strides, 0))


def from_items(out: Operators, value: Value) -> Array:
    """An array of what stands in a tuple, of tuples maybe; a copy of an array."""
    if is_array(value):
        return out.copied(out.array(value))
    items = out.items(value)
    if items and all(isinstance(each, Scalar) or _is_number(each) for each in items):
        made = out.new_array((len(items),), "made")
        texts = [out.real(each) for each in items]
        out.lines += [f"{made.text}[{i}] = {text};" for i, text in enumerate(texts)]
        return made
    rows = [from_items(out, each) for each in items]
    made = out.new_array((len(rows), *rows[0].shape), "made")
    for i, each in enumerate(rows):
        part = at(out, made, [Static(i)])
        assert isinstance(part, Array)
        out.copy(part, each)
    return made


def _is_number(value: Value) -> bool:
    if isinstance(value, Maybe):
        return _is_number(value.item)
    return isinstance(value, Scalar) or (
        isinstance(value, Static) and scalar_kind(value.value) is not None
    )


def joined(out: Operators, parts: Sequence[Array], axis: int = 0) -> Array:
    """Arrays one behind the other along the first axis."""
    if axis != 0:
        raise NotTranslatable("arrays side by side")
    count = sum(each.shape[0] for each in parts)
    made = out.new_array((count, *parts[0].shape[1:]), "joined")
    first = 0
    for each in parts:
        place = Static(slice(first, first + each.shape[0]))
        target = at(out, made, [place])
        assert isinstance(target, Array)
        if each.size:
            out.copy(target, each)
        first += each.shape[0]
    return made
