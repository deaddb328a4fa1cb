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
from typing import Any, ClassVar, TypeVar, cast

import yaml
from pydantic import BaseModel, ConfigDict, Field, GetCoreSchemaHandler, ValidationError
from pydantic_core import core_schema

from steersman.errors import ConfigError, DataError, suggestion

C = TypeVar("C", bound="Component")
M = TypeVar("M", bound=BaseModel)

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
    "encoding": "steersman.encoding",
    "task": "steersman.learning.task",
    "schedule": "steersman.learning.schedules",
}
_REGISTRY: dict[str, dict[str, type[Component]]] = {family: {} for family in FAMILIES}


class Component(BaseModel):
    """Base of everything that can be named in a configuration."""

    model_config = ConfigDict(frozen=True, extra="forbid", validate_default=True)
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
        cls.family, cls.kind = family, kind
        other = _REGISTRY.setdefault(family, {}).get(kind)
        if other is not None and other.__module__ != cls.__module__:
            raise ConfigError(f"{family} {kind!r} is declared twice: {other} and {cls}")
        _REGISTRY[family][kind] = cls
        return cls

    return add


@cache
def _import_family(family: str) -> None:
    module = importlib.import_module(FAMILIES[family]) if family in FAMILIES else None
    for info in pkgutil.iter_modules(getattr(module, "__path__", ())):
        if module is not None and not info.name.startswith("_"):
            importlib.import_module(f"{module.__name__}.{info.name}")
    for point in entry_points(group=ENTRY_POINT_GROUP):
        if point.name == family or point.name.startswith(f"{family}."):
            point.load()


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
        raise ConfigError(f"unknown {family} {kind!r}{suggestion(kind, known)}")
    return known[kind]


def resolve(family: str, value: Any, *, optional: bool = False) -> Component | None:
    """A component from its name, its mapping (``kind`` and fields) or itself."""
    if value is None and optional:
        return None
    if isinstance(value, Component):
        if value.family != family:
            raise ConfigError(f"a {value.family} was given where a {family} is expected")
        return value
    if isinstance(value, str):
        value = {"kind": value}
    if not isinstance(value, Mapping) or "kind" not in value:
        raise ConfigError(f"a {family} is a name or a mapping with 'kind', not {value!r}")
    fields = {k: v for k, v in value.items() if k != "kind"}
    return build(lookup(family, str(value["kind"])), fields)


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
    """A model as plain data; ``resolve(family, dump(x)) == x``."""
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
        raise ConfigError(_one_line(cls, error)) from None


def _one_line(cls: type[BaseModel], error: ValidationError) -> str:
    first, *rest = error.errors(include_url=False)
    where = ".".join(str(part) for part in first["loc"])
    text = _describe(cls, cast("dict[str, Any]", first))
    more = f" (and {len(rest)} more)" if rest else ""
    return f"{where}: {text}{more}" if not text.startswith(".") else f"{where}{text}{more}"


def _describe(cls: type[BaseModel], error: dict[str, Any]) -> str:
    name = str(error["loc"][-1]) if error["loc"] else ""
    owner = getattr(cls, "kind", "") or cls.__name__
    if error["type"] == "extra_forbidden":
        return f"unknown field of {owner}{suggestion(name, cls.model_fields)}"
    if isinstance(error.get("ctx", {}).get("error"), ConfigError):
        inner = str(error["ctx"]["error"])
        head = inner.split(": ", 1)[0]
        return f".{inner}" if head and " " not in head else inner
    field = cls.model_fields.get(str(error["loc"][0])) if error["loc"] else None
    unit = field_unit(field) if field is not None else "-"
    message = error["msg"].removeprefix("Value error, ")
    message = message[0].lower() + message[1:]
    given = "" if error["type"] == "missing" else f"; given {error['input']!r}"
    return f"{message}{given}" + (f" [{unit}]" if unit != "-" else "")


def field_unit(field: Any) -> str:
    """The unit that was declared for a field, "-" if it has none."""
    extra = getattr(field, "json_schema_extra", None)
    return str(extra.get("unit", "-")) if isinstance(extra, dict) else "-"


def merge(base: Mapping[str, Any], change: Mapping[str, Any]) -> dict[str, Any]:
    """``base`` with ``change`` laid over it; a mapping that names a ``kind`` replaces whole."""
    out = dict(base)
    for key, value in change.items():
        old = out.get(key)
        if isinstance(value, Mapping) and "kind" not in value and isinstance(old, Mapping):
            out[key] = merge(old, value)
        else:
            out[key] = value
    return out


def override(tree: Mapping[str, Any], assignments: Iterable[str]) -> dict[str, Any]:
    """Apply ``key.sub=value`` assignments; naming a component replaces its whole subtree.

    Raises:
        ConfigError: an assignment without "=" or into something that has no fields.
    """
    out = merge({}, tree)
    for text in assignments:
        key, sign, raw = text.partition("=")
        if not sign or not key:
            raise ConfigError(f"{text!r} is not an assignment; write key=value")
        _assign(out, key.split("."), _parse(raw), text)
    return out


def _assign(tree: dict[str, Any], keys: list[str], value: Any, text: str) -> None:
    for depth, key in enumerate(keys[:-1]):
        below = tree.get(key)
        if below is None:
            below = {}
        elif isinstance(below, str):
            below = {"kind": below}
        elif not isinstance(below, Mapping):
            name = ".".join(keys[: depth + 1])
            raise ConfigError(f"{text!r}: {name} is a value and has no fields")
        tree[key] = dict(below)
        tree = tree[key]
    old = tree.get(keys[-1])
    is_component = isinstance(old, Mapping) and "kind" in old and isinstance(value, str)
    tree[keys[-1]] = {"kind": value} if is_component else value


def _parse(raw: str) -> Any:
    try:
        return float(raw) if "e" in raw.lower() else yaml.safe_load(raw)
    except ValueError:
        pass
    except yaml.YAMLError:
        return raw
    try:
        return yaml.safe_load(raw)
    except yaml.YAMLError:
        return raw


def read_yaml(file: FilePath) -> dict[str, Any]:
    """A YAML file that holds one mapping.

    Raises:
        DataError: the file is missing, not YAML, or not a mapping.
    """
    try:
        data = yaml.safe_load(file.read_text(encoding="utf-8"))
    except OSError as error:
        raise DataError(f"{file}: cannot be read ({error.strerror})") from None
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        line = " ".join(str(error).split())
        raise DataError(f"{file}: not valid YAML: {line}") from None
    if data is None:
        return {}
    if not isinstance(data, dict):
        raise DataError(f"{file}: holds a {type(data).__name__}, expected key: value pairs")
    return data


def to_yaml(model: BaseModel) -> str:
    """The resolved configuration as YAML."""
    return yaml.safe_dump(dump(model), sort_keys=False, allow_unicode=True)
