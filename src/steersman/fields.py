"""The fields of a component as a user sees them: default, unit, bounds, meaning."""

from __future__ import annotations

import inspect
from pathlib import Path as FilePath
from typing import Any, Literal, NamedTuple, get_args, get_origin

from pydantic import BaseModel
from pydantic.fields import FieldInfo
from pydantic_core import PydanticUndefined

from steersman.config import Of, dump, field_unit
from steersman.core_yaml import dump as to_yaml

_SIGNS = {"gt": ">", "ge": ">=", "lt": "<", "le": "<=", "multiple_of": "multiple of"}
_SIGNS |= {"min_length": "length >=", "max_length": "length <="}
_TYPES = {bool: "true or false", int: "whole number", float: "number", str: "text"}
_TYPES |= {FilePath: "file"}
_LONGEST = 30


class Field(NamedTuple):
    """One line of ``steersman show``."""

    name: str
    type: str
    required: bool
    default: Any
    unit: str
    bounds: dict[str, Any]
    choices: list[Any]
    meaning: str

    def plain(self) -> dict[str, Any]:
        """As data for JSON."""
        return self._asdict()

    def cells(self) -> tuple[str, str, str, str, str]:
        """As text: name, default, unit, what is allowed, meaning."""
        limits = [f"{_SIGNS[name]} {_number(value)}" for name, value in self.bounds.items()]
        allowed = ", ".join(limits) or " | ".join(map(str, self.choices)) or self.type
        default = "(required)" if self.required else short(self.default)
        return self.name, default, self.unit, allowed, self.meaning


def fields_of(cls: type[BaseModel], default: BaseModel | None = None, prefix: str = "") -> Any:
    """All fields; those of a group of settings as ``group.field``."""
    out: list[Field] = []
    for name, info in cls.model_fields.items():
        value = info.get_default(call_default_factory=True) if default is None else None
        value = value if default is None else getattr(default, name)
        group = _group(info)
        if group is None:
            out.append(_field(prefix + name, info, value))
        else:
            inner = value if isinstance(value, BaseModel) else None
            out += fields_of(group, inner, f"{prefix}{name}.")
    return out


def _group(info: FieldInfo) -> type[BaseModel] | None:
    annotation = info.annotation
    plain = not any(isinstance(mark, Of) for mark in info.metadata)
    if plain and inspect.isclass(annotation) and issubclass(annotation, BaseModel):
        return annotation
    return None


def _field(name: str, info: FieldInfo, value: Any) -> Field:
    bounds = {
        sign: getattr(mark, sign)
        for mark in info.metadata
        for sign in _SIGNS
        if getattr(mark, sign, None) is not None
    }
    default = None if value is PydanticUndefined else _plain(value)
    choices = list(_choices(info.annotation))
    unit, meaning = field_unit(info), info.description or ""
    return Field(name, _type(info), info.is_required(), default, unit, bounds, choices, meaning)


def _plain(value: Any) -> Any:
    if isinstance(value, BaseModel):
        return dump(value)
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    return str(value) if isinstance(value, FilePath) else value


def _choices(annotation: Any) -> tuple[Any, ...]:
    if get_origin(annotation) is Literal:
        return get_args(annotation)
    return tuple(choice for inner in get_args(annotation) for choice in _choices(inner))


def _type(info: FieldInfo) -> str:
    mark = next((mark for mark in info.metadata if isinstance(mark, Of)), None)
    if mark is not None:
        return _component(mark) + (" or null" if mark.optional else "")
    return _type_text(info.annotation)


def _component(mark: Of) -> str:
    return f"{'an' if mark.family[0] in 'aeiou' else 'a'} {mark.family}"


def _type_text(annotation: Any) -> str:
    of = next((m for m in getattr(annotation, "__metadata__", ()) if isinstance(m, Of)), None)
    if of is not None:
        return _component(of)
    if annotation is type(None):
        return "null"
    if inspect.isclass(annotation) and issubclass(annotation, BaseModel):
        return "settings"
    origin, inner = get_origin(annotation), [a for a in get_args(annotation) if a is not ...]
    if origin in {tuple, list}:
        return f"list of {' or '.join(dict.fromkeys(map(_type_text, inner)))}"
    if origin is not None and origin is not Literal:
        return " or ".join(map(_type_text, inner))
    return "one of the choices" if origin is Literal else _TYPES.get(annotation, "value")


def _number(value: Any) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)


def short(value: Any) -> str:
    """A default on one short line, as it would be written in YAML."""
    if isinstance(value, dict) and "kind" in value:
        return str(value["kind"])
    if isinstance(value, list):
        text = f"[{', '.join(map(short, value))}]"
    elif isinstance(value, dict):
        text = f"{{{', '.join(f'{key}: {short(item)}' for key, item in value.items())}}}"
    elif isinstance(value, float):
        text = f"{value:.6g}"
    else:
        text = "null" if value is None else to_yaml(value).removesuffix("\n...\n").strip()
    return text if len(text) <= _LONGEST else f"{text[: _LONGEST - 4]} ..."
