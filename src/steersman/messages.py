"""Pydantic's validation errors as one line: where, what was given, what is allowed."""

from __future__ import annotations

import inspect
import math
import re
from collections.abc import Iterable, Iterator, Mapping
from typing import Any, NamedTuple, get_args, get_origin

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from steersman.errors import ConfigError, one_line, shortened, suggestion

# What a value of the wrong type should have been, by pydantic's error type.
_NOT_A = {
    "bool_parsing": "true or false",
    "bool_type": "true or false",
    "dict_type": "a set of key: value pairs",
    "float_parsing": "a number",
    "float_type": "a number",
    "int_from_float": "a whole number",
    "int_parsing": "a whole number",
    "int_type": "a whole number",
    "list_type": "a list",
    "model_type": "a set of key: value pairs",
    "path_type": "a file name",
    "string_type": "text",
    "tuple_type": "a list",
}
# What is allowed, filled in with the error's context.
_MUST = {
    "enum": "must be {expected}",
    "finite_number": "must be finite",
    "greater_than": "must be greater than {gt}",
    "greater_than_equal": "must be at least {ge}",
    "less_than": "must be less than {lt}",
    "less_than_equal": "must be at most {le}",
    "literal_error": "must be {expected}",
    "multiple_of": "must be a multiple of {multiple_of}",
    "string_pattern_mismatch": "must match {pattern}",
    "string_too_long": "must have at most {max_length} characters",
    "string_too_short": "must have at least {min_length} characters",
    "too_long": "must have at most {max_length} values",
    "too_short": "must have at least {min_length} values",
}
_NUMBER_AND_REST = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(.*?)\s*")
_COMMA = re.compile(r"\s*[-+]?\d+,\d+\s*")


class _Place(NamedTuple):
    names: tuple[str, ...]
    owner: type[BaseModel]
    field: Any


def config_error(cls: type[BaseModel], error: ValidationError) -> ConfigError:
    """The first fault of ``error``, and where the others are."""
    faults: dict[tuple[str, ...], ConfigError] = {}
    # An unknown name comes first: a misspelt field is also a missing one.
    details = sorted(
        error.errors(include_url=False), key=lambda detail: detail["type"] != "extra_forbidden"
    )
    for detail in details:  # a union reports a fault for each of its branches: keep the first
        fault = _fault(cls, detail)
        faults.setdefault(fault.where, fault)
    first, *others = faults.values()
    if others:
        more = ", ".join(".".join(fault.where) for fault in others)
        return ConfigError(f"{first.what} (also at fault: {more})", first.where)
    return first


def field_unit(field: Any) -> str:
    """The unit that was declared for a field, "-" if it has none."""
    extra = getattr(field, "json_schema_extra", None)
    return str(extra.get("unit", "-")) if isinstance(extra, dict) else "-"


def _fault(cls: type[BaseModel], detail: ErrorDetails) -> ConfigError:
    names, owner, field = _locate(cls, detail["loc"])
    cause = detail.get("ctx", {}).get("error")
    if isinstance(cause, ConfigError):
        return ConfigError(cause.what, names + cause.where)
    return ConfigError(_describe(detail, names, owner, field), names)


def _elsewhere(owner: type[BaseModel], name: str) -> str | None:
    """The field of a part that is called so, or one that holds components of this family."""
    parts = {f"{part}.": field.annotation for part, field in owner.model_fields.items()}
    for before, cls in {"": owner, **parts}.items():
        fields = getattr(cls, "model_fields", {}) if isinstance(cls, type) else {}
        if name in fields:
            return f"{before}{name}"
        for field, info in fields.items():
            if name in (*_families(info.metadata), *_held(info.annotation)):
                return f"{before}{field}"
    return None


def _instead(owner: type[BaseModel], name: str) -> str:
    """The end of a message about an unknown field: what to give for it."""
    if told := getattr(owner, "answers", {}).get(name.lower().replace(" ", "_")):
        return f"; {told}"
    place = _elsewhere(owner, name)
    return f"; did you mean {place!r}?" if place else suggestion(name, owner.model_fields)


def _held(annotation: Any) -> Iterator[str]:
    """The families of components that a type holds, in a tuple or mapping."""
    yield from _families(getattr(annotation, "__metadata__", ()))
    for inner in get_args(annotation):
        yield from _held(inner)


def _families(marks: Iterable[Any]) -> Iterator[str]:
    return (mark.family for mark in marks if hasattr(mark, "family"))


def _describe(
    detail: ErrorDetails, names: tuple[str, ...], owner: type[BaseModel], field: Any
) -> str:
    kind, context = detail["type"], detail.get("ctx", {})
    if kind == "extra_forbidden":
        of = getattr(owner, "kind", "")
        return f"unknown field{f' of {of}' if of else ''}{_instead(owner, names[-1])}"
    unit = field_unit(field)
    bracket = "" if unit == "-" else f" [{unit}]"
    if kind == "missing":
        meaning = getattr(field, "description", None)
        told = "required, but not given" + (f": {meaning}{bracket}" if meaning else bracket)
        ends = getattr(owner, "suffixes", ()) if names[-1] == "file" else ()
        family = getattr(owner, "family", "")
        return f"{told.rstrip('.')}; write {family}=NAME{ends[0]}" if ends else told
    if kind in {"value_error", "assertion_error"}:  # the component's author wrote the message
        return one_line(str(context.get("error") or detail["msg"]))
    given = _show(detail["input"])
    if kind in _NOT_A:
        return f"{given} is not {_NOT_A[kind]}{_how_to_write(kind, detail['input'], unit)}"
    if kind in _MUST:
        limits = {name: _short(limit) for name, limit in context.items()}
        told = f"{given} is not allowed; {_MUST[kind].format_map(limits)}{bracket}"
        return told + _from_degrees(kind, detail["input"], unit)
    message = one_line(detail["msg"])
    return f"{given} is not allowed; {message[:1].lower()}{message[1:]}{bracket}"


def _from_degrees(kind: str, given: Any, unit: str) -> str:
    """A hint at the unit, where an angle in radians is so large that it may be in degrees."""
    bounds = {"less_than", "less_than_equal", "greater_than", "greater_than_equal"}
    large = kind in bounds and isinstance(given, int | float) and abs(given) > math.pi
    return f"; {given:g} deg are {math.radians(given):.3g} rad" if large and unit == "rad" else ""


def _how_to_write(kind: str, given: Any, unit: str) -> str:
    """A hint at the number's unit, or at quotes around a text that looks like something else."""
    if _NOT_A[kind] == "a list":
        return f"; write [{', '.join(given.split())}]" if isinstance(given, str) else ""
    if kind == "string_type":
        return f"; put it in quotes: '{given}'" if isinstance(given, int | float) else ""
    number = kind.startswith(("float", "int"))
    if number and isinstance(given, str) and _COMMA.fullmatch(given):
        return f"; write {given.strip().replace(',', '.')}"
    if not number or unit == "-":
        return ""
    match = _NUMBER_AND_REST.fullmatch(given) if isinstance(given, str) else None
    if match is None:
        return f"; the unit is {unit}"
    # Only the very unit may be dropped: "50km" must not become 50 m.
    example = f", write e.g. {match[1]}" if match[2] == unit else f", write the value in {unit}"
    return f"; the unit is {unit}{example}"


def _locate(cls: type[BaseModel], loc: tuple[int | str, ...]) -> _Place:
    """The fields that pydantic's ``loc`` goes through, without its labels of union branches."""
    names: list[str] = []
    owner, field, annotation = cls, None, None
    inside: type[BaseModel] | None = cls
    for part in loc:
        if isinstance(part, int) and names:
            names[-1] += f"[{part}]"
        elif get_origin(annotation) in {dict, Mapping}:
            names.append(str(part))
            annotation = get_args(annotation)[1]
            inside = _model_in(annotation)
        elif inside is not None and (part != inside.__name__ or not names):
            names.append(str(part))
            owner, field = inside, inside.model_fields.get(str(part))
            annotation = getattr(field, "annotation", None)
            inside = _model_in(annotation)
    return _Place(tuple(names), owner, field)


def _model_in(annotation: Any) -> type[BaseModel] | None:
    if inspect.isclass(annotation) and issubclass(annotation, BaseModel):
        return annotation
    found = (_model_in(inner) for inner in get_args(annotation))
    return next((model for model in found if model is not None), None)


def _show(value: Any) -> str:
    return shortened(one_line(repr(value)))


def _short(limit: Any) -> Any:
    """A bound as it is read: whole numbers without a point, pi to six digits."""
    if not isinstance(limit, float):
        return limit
    return int(limit) if limit.is_integer() else float(f"{limit:.6g}")
