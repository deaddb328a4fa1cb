"""The parameters of a controller in C as a table: names, units, limits, values."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from steersman.delivery.controller import DESIGN, Setting, Translated
from steersman.delivery.parameter_limits import limit_texts, limits
from steersman.delivery.translate.program import Parameter
from steersman.messages import field_unit

COLUMNS = ("index", "name", "unit", "minimum", "maximum", "value", "meaning")
# What a description says of null, which a number in C cannot be.
_NULL = re.compile(r"; null: .*?(?=;|\.?$)")


class Description(NamedTuple):
    """What a parameter, or a number of it, is."""

    unit: str
    low: float
    high: float
    meaning: str
    texts: tuple[str, str] = ("", "")
    """The limits as the table has them."""


def described(setting: Setting, parameter: Parameter) -> list[Description]:
    """What each number of a parameter is.

    A named tuple of a controller's state with a method ``number`` has unit and meaning of its
    arrays' numbers; one with a method ``setting`` the fields that they are, with their limits.
    """
    first, *rest = parameter.path.split(".")
    owner: Any = setting.start() if first == DESIGN else setting.controller
    *way, name = rest if first == DESIGN else (first, *rest)
    for each in way:
        owner = owner[int(each)] if each.isdecimal() else getattr(owner, each)
    if first == DESIGN:
        made = "-", "Made from vehicle, control period and settings."
        count, told = np.size(parameter.value), hasattr(owner, "number")
        if hasattr(owner, "setting"):
            return [_of_field(*owner.setting(name, i)) for i in range(count)]
        pairs = [owner.number(name, i) if told else made for i in range(count)]
        return [Description(unit, -np.inf, np.inf, meaning) for unit, meaning in pairs]
    return [_of_field("", type(owner).model_fields[name])]


def _of_field(name: str, field: Any) -> Description:
    """What a field declares, with its name where the table's is another."""
    meaning = _NULL.sub("", field.description or "")
    meaning = f"{name}: {meaning}" if name else meaning
    return Description(field_unit(field), *limits(field), meaning, limit_texts(field))


class ParameterEntry(NamedTuple):
    """A number of the table of parameters."""

    name: str
    unit: str
    minimum: float
    maximum: float
    value: float
    meaning: str
    limits: tuple[str, str]
    """As text."""


def entries(made: Translated) -> list[ParameterEntry]:
    """The table of parameters, in the order in which they lie in memory."""
    return [entry for each in made.parameters for entry in entries_of(made.setting, each)]


def entries_of(setting: Setting, parameter: Parameter) -> Iterator[ParameterEntry]:
    """The rows of one parameter."""
    numbers = np.asarray(parameter.value, dtype=float).ravel().tolist()
    for i, (number, of) in enumerate(zip(numbers, described(setting, parameter), strict=True)):
        place = f"[{i}]" if isinstance(parameter.value, np.ndarray) else ""
        name = parameter.path + place
        yield ParameterEntry(name, of.unit, of.low, of.high, number, of.meaning, of.texts)


def table_text(made: Translated) -> str:
    """The parameters as CSV."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(COLUMNS)
    for i, each in enumerate(entries(made)):
        writer.writerow([i, each.name, each.unit, *each.limits, repr(each.value), each.meaning])
    return out.getvalue()
