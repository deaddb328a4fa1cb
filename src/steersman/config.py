"""One declaration for each component: a frozen model that Python, YAML and the shell all read.

A component is a class decorated with ``@register(family, kind)``. Its fields are declared with
:func:`param`, which holds the default, the unit and one line of meaning. A field that holds
another component is annotated ``Annotated[SomeProtocol, Of("family")]``.
"""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import cache, partial
from importlib.metadata import entry_points
from pathlib import Path as FilePath
from typing import Any, ClassVar, TypeVar, get_args

import yaml
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

from steersman import core_yaml, tuned
from steersman.errors import ConfigError, DataError, suggestion
from steersman.messages import config_error, field_unit

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

C = TypeVar("C", bound="Component")
M = TypeVar("M", bound=BaseModel)

# The family whose members come with the package as tuned, too.
_CONTROLLER = "controller"
ENTRY_POINT_GROUP = "steersman.components"
# Where each family's components live; importing the module (or all modules of the package)
# registers them. Entry points of other packages add to this.
FAMILIES: dict[str, str] = {
    "path": "steersman.paths",
    "vehicle": "steersman.vehicles",
    "plant": "steersman.plants",
    "controller": "steersman.controllers",
    "speed": "steersman.speed",
    "sensor": "steersman.sensing",
    "feature": "steersman.features",
    "encoding": "steersman.encoding",
    "reward": "steersman.learning.task",
    "task": "steersman.learning.task",
    "agent": "steersman.learning.algorithms",
    "schedule": "steersman.learning.schedules",
    "metric": "steersman.metrics",
}
_REGISTRY: dict[str, dict[str, type[Component]]] = {family: {} for family in FAMILIES}


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
        field = cls.model_fields[str(info.field_name)]
        # pydantic takes True for 1.0; where a number is meant, "throttle: yes" is a mistake.
        types = _types_in(field.annotation)
        if types & {int, float} and bool not in types and _holds_boolean(value):
            raise PydanticKnownError("float_type" if float in types else "int_type")
        # Some fields of a group keep the others as this field's default has them, which need
        # not be what the group's own class has.
        if isinstance(value, Mapping):
            default = field.get_default(call_default_factory=True)
            if isinstance(default, BaseModel):
                return merge(dump(default) or {}, value)
            if any(isinstance(mark, Of) for mark in field.metadata):
                return merge(_fields(default), value)
        return value


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


def param(default: Any, unit: str, meaning: str, **bounds: Any) -> Any:
    """A field with default, unit ("-" for none) and one line of meaning; bounds as pydantic's."""
    return Field(default, description=meaning, json_schema_extra={"unit": unit}, **bounds)


def required(unit: str, meaning: str, **bounds: Any) -> Any:
    """Like :func:`param` for a field that has no default."""
    return Field(description=meaning, json_schema_extra={"unit": unit}, **bounds)


def register(family: str, kind: str) -> Callable[[type[C]], type[C]]:
    """Class decorator: make the component known as ``family=kind``."""

    def add(cls: type[C]) -> type[C]:
        other = _REGISTRY.setdefault(family, {}).get(kind)
        # The same name is the same class, loaded anew.
        if other is not None and _full_name(other) != _full_name(cls):
            raise ConfigError(
                f"{family} {kind!r} is declared twice: {_full_name(other)} and {_full_name(cls)}"
            )
        cls.family, cls.kind = family, kind
        _REGISTRY[family][kind] = cls
        return cls

    return add


def _full_name(cls: type) -> str:
    return f"{cls.__module__}.{cls.__qualname__}"


@cache
def _import_family(family: str) -> None:
    module = importlib.import_module(FAMILIES[family]) if family in FAMILIES else None
    for info in pkgutil.iter_modules(getattr(module, "__path__", ())):
        if module is not None and not info.name.startswith("_"):
            importlib.import_module(f"{module.__name__}.{info.name}")
    for point in entry_points(group=ENTRY_POINT_GROUP):
        if point.name == family or point.name.startswith(f"{family}."):
            try:
                point.load()
            except Exception as error:  # another package's code may raise anything
                raise ConfigError(
                    f"entry point {point.name} = {point.value} cannot be loaded: {error}"
                ) from error


def families() -> list[str]:
    """Every family of components."""
    return sorted(_REGISTRY)


def components(family: str) -> dict[str, type[Component]]:
    """All registered kinds of a family.

    Raises:
        ConfigError: the family is unknown.
    """
    if family not in _REGISTRY:
        raise ConfigError(f"unknown kind of component {family!r}{suggestion(family, _REGISTRY)}")
    _import_family(family)
    return dict(sorted(_REGISTRY[family].items()))


def lookup(family: str, kind: str) -> type[Component]:
    """The class registered as ``family=kind``.

    Raises:
        ConfigError: no such component; the message names the nearest match.
    """
    known = components(family)
    if kind not in known:
        more = tuned.names() if family == _CONTROLLER else []
        if more and kind.strip("/") == "tuned":
            raise ConfigError(f"unknown {family} {kind!r}; write one of {', '.join(more)}")
        raise ConfigError(f"unknown {family} {kind!r}{suggestion(kind, [*known, *more])}")
    return known[kind]


def _a(noun: str) -> str:
    """The noun with its article."""
    return f"{'an' if noun[:1] in 'aeiou' else 'a'} {noun}"


def resolve(family: str, value: Any, *, optional: bool = False) -> Component | None:
    """A component from its name, its mapping (``kind`` and fields) or itself.

    ``tuned/NAME`` stands for a controller of the package with its fields as tuned.
    """
    if value is None and optional:
        return None
    if isinstance(value, Component):
        if value.family != family:
            given = value.family or type(value).__name__
            raise ConfigError(f"{_a(given)} was given where {_a(family)} is expected")
        return value
    if isinstance(value, str):
        value = {"kind": value}
    if not isinstance(value, Mapping) or "kind" not in value:
        raise ConfigError(
            f"{_a(family)} is a name, or fields among them 'kind'; given {value!r};"
            f" names: {', '.join(components(family))}"
        )
    kind, fields = str(value["kind"]), {k: v for k, v in value.items() if k != "kind"}
    file = tuned.locate(kind) if family == _CONTROLLER else None
    if file is not None:
        base = read_yaml(file)["controller"]
        kind, fields = base.pop("kind"), merge(base, fields)
    return build(lookup(family, kind), fields)


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
    """
    if "kind" in change:
        return dict(change)
    out = dict(base)
    for key, value in change.items():
        out[key] = merge(_fields(out.get(key)), value) if isinstance(value, Mapping) else value
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
        if not sign or not all(key.strip().split(".")):
            raise ConfigError(f"{text!r} is not an assignment; write key=value or key.field=value")
        out = lay_over(out, key, core_yaml.value(raw))
    return out


def read_yaml(file: FilePath) -> dict[str, Any]:
    """A YAML file that holds one mapping.

    Raises:
        DataError: the file is missing, not YAML, or not a mapping.
    """
    try:
        data = core_yaml.load(file.read_text(encoding="utf-8"))
    except OSError as error:
        raise DataError(f"{file}: cannot be read ({error.strerror})") from None
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark
        line = f"line {mark.line + 1}: " if mark is not None else ""
        raise DataError(f"{file}: {line}not valid YAML: {error.problem}") from None
    except (yaml.YAMLError, ValueError) as error:  # not UTF-8, or control characters
        line = " ".join(str(error).split())
        raise DataError(f"{file}: not valid YAML: {line}") from None
    if data is None:
        return {}
    if not isinstance(data, dict):
        raise DataError(f"{file}: holds a {type(data).__name__}, expected key: value pairs")
    return data


def to_yaml(model: BaseModel) -> str:
    """The resolved configuration as YAML."""
    return core_yaml.dump(dump(model))
