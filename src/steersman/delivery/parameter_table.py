"""The parameters of a controller in C as a table: names, units, limits, values."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from steersman.delivery.controller import DESIGN, Setting, Translated
from steersman.delivery.translate.program import Parameter
from steersman.messages import field_unit

COLUMNS = ("index", "name", "unit", "minimum", "maximum", "value", "meaning")
# Limits below this are those above zero.
_TINY = 1e-300


class Description(NamedTuple):
    """What a parameter, or a number of it, is."""

    unit: str
    low: float
    high: float
    meaning: str


def described(setting: Setting, parameter: Parameter) -> list[Description]:
    """What each number of a parameter is.

    A named tuple of a controller's state with a method ``number`` has unit and meaning of its
    arrays' numbers.
    """
    first, *rest = parameter.path.split(".")
    owner: Any = setting.start() if first == DESIGN else setting.controller
    *way, name = rest if first == DESIGN else (first, *rest)
    for each in way:
        owner = owner[int(each)] if each.isdecimal() else getattr(owner, each)
    if first == DESIGN:
        made = "-", "Made from vehicle, control period and settings."
        count, told = np.size(parameter.value), hasattr(owner, "number")
        pairs = [owner.number(name, i) if told else made for i in range(count)]
        return [Description(unit, -np.inf, np.inf, meaning) for unit, meaning in pairs]
    field = type(owner).model_fields[name]
    return [Description(field_unit(field), *limits(field), field.description or "")]


def limits(field: Any) -> tuple[float, float]:
    """The least and the largest number that a field allows."""
    low, high = -math.inf, math.inf
    for bound in field.metadata:
        low = getattr(bound, "ge", low)
        high = getattr(bound, "le", high)
        low = math.nextafter(bound.gt, math.inf) if hasattr(bound, "gt") else low
        high = math.nextafter(bound.lt, -math.inf) if hasattr(bound, "lt") else high
    return low, high


class ParameterEntry(NamedTuple):
    """A number of the table of parameters."""

    name: str
    unit: str
    minimum: float
    maximum: float
    value: float
    meaning: str


def entries(made: Translated) -> list[ParameterEntry]:
    """The table of parameters, in the order in which they lie in memory."""
    return [entry for each in made.parameters for entry in entries_of(made.setting, each)]


def entries_of(setting: Setting, parameter: Parameter) -> Iterator[ParameterEntry]:
    """The rows of one parameter."""
    numbers = np.asarray(parameter.value, dtype=float).ravel().tolist()
    for i, (number, of) in enumerate(zip(numbers, described(setting, parameter), strict=True)):
        place = f"[{i}]" if isinstance(parameter.value, np.ndarray) else ""
        name = parameter.path + place
        yield ParameterEntry(name, of.unit, of.low, of.high, number, of.meaning)


def table_text(made: Translated) -> str:
    """The parameters as CSV."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(COLUMNS)
    for i, each in enumerate(entries(made)):
        bounds = [_shown(x) for x in (each.minimum, each.maximum)]
        writer.writerow([i, each.name, each.unit, *bounds, repr(each.value), each.meaning])
    return out.getvalue()


def _shown(limit: float) -> str:
    """A limit; what is next to zero, as zero."""
    if math.isinf(limit):
        return ""
    return repr(limit if abs(limit) > _TINY else 0 * limit)
