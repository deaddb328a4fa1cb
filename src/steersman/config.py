"""One declaration for each component: a frozen model that Python, YAML and the shell all read.

A component is a class decorated with ``@register(family, kind)``. Fields are declared with
:func:`param`: default, unit, meaning; one that holds a component as ``Annotated[C, Of("family")]``.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cache, partial
from typing import Any, ClassVar, Generic, Literal, TypeVar, get_args

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    GetCoreSchemaHandler,
    ValidationError,
    ValidationInfo,
    field_validator,
)
from pydantic_core import PydanticKnownError, core_schema

from steersman import core_yaml, registry, words
from steersman.bounds import DEEPEST
from steersman.core_yaml import read_yaml
from steersman.errors import ConfigError, shortened
from steersman.messages import config_error, field_unit
from steersman.registry import ENTRY_POINT_GROUP, FAMILIES, components, families, register

__all__ = [
    "ENTRY_POINT_GROUP",
    "FAMILIES",
    "Component",
    "Of",
    "Settings",
    "build",
    "components",
    "dump",
    "families",
    "field_unit",
    "lay_over",
    "lookup",
    "merge",
    "override",
    "param",
    "read_yaml",
    "register",
    "required",
    "resolve",
    "to_yaml",
]

M = TypeVar("M", bound=BaseModel)
T = TypeVar("T")


class Settings(BaseModel):
    """Base of every group of fields: frozen, no unknown field, numbers finite and no booleans."""

    model_config = ConfigDict(
        frozen=True,
        extra="forbid",
        validate_default=True,
        allow_inf_nan=False,
        ser_json_inf_nan="constants",  # where a field may be infinite, null would not read back
    )

    @field_validator("*", mode="before")
    @classmethod
    def _check_and_complete(cls, value: Any, info: ValidationInfo) -> Any:
        # pydantic takes True for 1.0; where a number is meant, "throttle: yes" is a mistake.
        if (number := _number(cls, str(info.field_name))) and _holds_boolean(value):
            raise PydanticKnownError(number)
        # Some fields of a group keep the others as this field's default has them, which need
        # not be what the group's own class has.
        if isinstance(value, Mapping):
            field = cls.model_fields[str(info.field_name)]
            default = field.get_default(call_default_factory=True)
            if isinstance(default, BaseModel):
                return merge(dump(default) or {}, value)
            if any(isinstance(mark, Of) for mark in field.metadata):
                return merge(_fields(default), value)
        return value


@cache
def _number(cls: type[BaseModel], field: str) -> Literal["float_type", "int_type"] | None:
    """The error of a boolean in a field that is meant for numbers; None for any other field."""
    types = _types_in(cls.model_fields[field].annotation)
    if not types & {int, float} or bool in types:
        return None
    return "float_type" if float in types else "int_type"


def _types_in(annotation: Any) -> set[Any]:
    return {annotation}.union(*(_types_in(inner) for inner in get_args(annotation)))


def _holds_boolean(value: Any) -> bool:
    if isinstance(value, list | tuple):
        return any(_holds_boolean(item) for item in value)
    return isinstance(value, bool)


class Component(Settings):
    """Base of everything that can be named in a configuration."""

    family: ClassVar[str] = ""
    kind: ClassVar[str] = ""
    suffixes: ClassVar[tuple[str, ...]] = ()
    """Endings of files that stand for the component on their own: ``file`` is then such a file."""
    bare_number: ClassVar[str] = ""
    """The field that a number stands for, where one is given in place of the component."""
    answers: ClassVar[dict[str, str]] = {}
    """What to give instead of figures that data sheets have."""

    @property
    def given_as(self) -> str:
        """The word that it was given by; else its kind."""
        return str(self.__dict__.get("_given_as", self.kind))


def param(default: Any, unit: str, meaning: str, **bounds: Any) -> Any:
    """A field with default, unit ("-" for none) and one line of meaning; bounds as pydantic's."""
    return Field(default, description=meaning, json_schema_extra={"unit": unit}, **bounds)


def required(unit: str, meaning: str, **bounds: Any) -> Any:
    """Like :func:`param` for a field that has no default."""
    return Field(description=meaning, json_schema_extra={"unit": unit}, **bounds)


def _a(noun: str) -> str:  # with its article
    return f"{'an' if noun[:1] in 'aeiou' else 'a'} {noun}"


def lookup(family: str, kind: str) -> type[Component]:
    """The class registered as ``family=kind``.

    Raises:
        ConfigError: no such component; the message names the nearest match.
    """
    known = components(family)
    if kind not in known:
        raise words.unknown(family, kind)
    return known[kind]


def resolve(family: str, value: Any, *, optional: bool = False) -> Component | None:
    """A component from a word, its mapping (``kind`` and fields) or itself.

    :mod:`steersman.words` says which words there are; ``kind`` may be any of them.
    """
    if value is None and optional:
        return None
    if isinstance(value, Component):
        if value.family != family:
            given = value.family or type(value).__name__
            raise ConfigError(f"{_a(given)} was given where {_a(family)} is expected")
        return value
    value = registry.as_fields(family, value)
    if not isinstance(value, Mapping) or "kind" not in value:
        raise ConfigError(
            f"{_a(family)} is a name, or fields among them 'kind'; given {value!r}"
            + (words.for_number(family, value) or f"; names: {', '.join(components(family))}")
        )
    word = str(value["kind"])
    base = words.fields_of(family, word)
    cls = lookup(family, str(base.pop("kind")))
    made = build(cls, merge(base, {k: v for k, v in value.items() if k != "kind"}))
    made.__dict__["_given_as"] = word  # no field: neither compared nor written
    return made


@dataclass(eq=False)
class Built(Generic[T]):
    """Holds what a component computed from its fields, without taking part in its comparison.

    Pydantic first compares all that an instance holds and looks at the fields alone if that
    differs; arrays cannot be compared so, this object (by identity) can.
    """

    value: T


@dataclass(frozen=True)
class Of:
    """Annotation of a field that holds a component of ``family``."""

    family: str
    optional: bool = False

    def __get_pydantic_core_schema__(
        self, source: Any, handler: GetCoreSchemaHandler
    ) -> core_schema.CoreSchema:
        """Validate through the registry, serialise with the kind."""
        return core_schema.no_info_plain_validator_function(
            partial(resolve, self.family, optional=self.optional),
            serialization=core_schema.plain_serializer_function_ser_schema(dump),
        )


def dump(model: BaseModel | None) -> dict[str, Any] | None:
    """A model as plain data, which :func:`resolve` turns into an equal model."""
    if model is None:
        return None
    data = model.model_dump(mode="json")
    return {"kind": model.kind, **data} if isinstance(model, Component) and model.kind else data


def build(cls: type[M], data: Mapping[str, Any]) -> M:
    """Validate ``data`` as ``cls``.

    Raises:
        ConfigError: one line that names the field, what was given and what is allowed.
    """
    try:
        return cls.model_validate(dict(data))
    except ValidationError as error:
        raise config_error(cls, error) from None


def merge(base: Mapping[str, Any], change: Mapping[str, Any]) -> dict[str, Any]:
    """``base`` with ``change`` laid over it, field by field.

    A change that names a ``kind`` replaces the whole, so that no field of one component is ever
    handed to another.

    >>> merge({"path": "circle"}, {"path": {"radius": 50}})
    {'path': {'kind': 'circle', 'radius': 50}}
    >>> merge({"path": {"kind": "circle", "radius": 50}}, {"path": {"kind": "straight"}})
    {'path': {'kind': 'straight'}}

    Raises:
        ConfigError: fields are laid over a number, which would be lost.
    """
    if "kind" in change:
        return dict(change)
    out = dict(base)
    for key, value in change.items():
        if isinstance(value, Mapping):
            before = out.get(key)
            if isinstance(before, int | float) and value and "kind" not in value:
                names = " and ".join(map(str, value))
                raise ConfigError(
                    f"given as {before}, and {names} of it too; give fields alone", (str(key),)
                )
            out[key] = merge(_fields(before), value)
        else:
            out[key] = value
    return out


def lay_over(tree: Mapping[str, Any], key: str, value: Any) -> dict[str, Any]:
    """``tree`` with ``value`` at the dotted ``key``, as :func:`merge` does.

    >>> lay_over({"path": "circle"}, "path.radius", 50)
    {'path': {'kind': 'circle', 'radius': 50}}
    """
    for name in reversed(key.strip().split(".")):
        value = {name: value}
    return merge(tree, value)


def _fields(value: Any) -> Mapping[str, Any]:
    if isinstance(value, str):
        return {"kind": value}
    if isinstance(value, BaseModel):
        return dump(value) or {}
    return value if isinstance(value, Mapping) else {}


def override(tree: Mapping[str, Any], assignments: Iterable[str]) -> dict[str, Any]:
    """Apply ``key.sub=value`` assignments in their order, each as :func:`merge` does.

    >>> override({"path": "circle"}, ["path.radius=50", "duration=1e1"])
    {'path': {'kind': 'circle', 'radius': 50}, 'duration': 10.0}

    Raises:
        ConfigError: an assignment is not of the form key=value.
    """
    out = dict(tree)
    for text in assignments:
        key, sign, raw = text.partition("=")
        names = key.strip().split(".")
        if not sign or not all(names) or len(names) > DEEPEST:
            told = f"{shortened(text)!r} is not an assignment; write key=value or key.field=value"
            raise ConfigError(told + ", without blanks" * (not (raw and all(names))))
        out = lay_over(out, key, core_yaml.value(raw))
    return out


def to_yaml(model: BaseModel) -> str:
    """The resolved configuration as YAML."""
    return core_yaml.dump(dump(model))
