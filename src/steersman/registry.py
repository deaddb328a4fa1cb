"""The registry: families of components, the kinds in each, and plug-ins of other packages."""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Callable
from functools import cache
from importlib.metadata import entry_points
from typing import TYPE_CHECKING, Any, TypeVar

from steersman.errors import ConfigError, suggestion

if TYPE_CHECKING:
    from steersman.config import Component

C = TypeVar("C", bound="Component")
ENTRY_POINT_GROUP = "steersman.components"
# Where each family's components live; importing the module (or all modules of the package)
# registers them. Entry points of other packages add to this.
FAMILIES: dict[str, str] = {
    "path": "steersman.paths",
    "vehicle": "steersman.vehicles",
    "plant": "steersman.plants",
    "controller": "steersman.controllers",
    "estimator": "steersman.estimators",
    "predictor": "steersman.estimators",
    "speed": "steersman.speed",
    "sensor": "steersman.sensing",
    "disturbance": "steersman.disturbances",
    "feature": "steersman.features",
    "encoding": "steersman.encoding",
    "reward": "steersman.learning.rewards",
    "task": "steersman.learning.task",
    "agent": "steersman.learning.algorithms",
    "schedule": "steersman.learning.schedules",
    "metric": "steersman.metrics",
}
_REGISTRY: dict[str, dict[str, type[Component]]] = {family: {} for family in FAMILIES}


def register(family: str, kind: str) -> Callable[[type[C]], type[C]]:
    """Class decorator: make the component known as ``family=kind``.

    Raises:
        ConfigError: another class has the name: one of the package, of a plug-in, or of before.
    """

    def add(cls: type[C]) -> type[C]:
        if not _of_package(cls.__module__):
            # The package's own come first, else its module would fail when it is imported later.
            _import_own(family)
        other = _REGISTRY.setdefault(family, {}).get(kind)
        # The same name is the same class, loaded anew.
        if other is not None and _full_name(other) != _full_name(cls):
            if _of_package(other.__module__):
                what = f"is {_full_name(other)} of the package; give yours another name"
            else:
                what = f"is declared twice: {_full_name(other)} and {_full_name(cls)}"
            raise ConfigError(f"{family} {kind!r} {what}")
        cls.family, cls.kind = family, kind
        _REGISTRY[family][kind] = cls
        return cls

    return add


def _of_package(module: str) -> bool:
    return module.partition(".")[0] == __name__.partition(".")[0]


def _full_name(cls: type) -> str:
    return f"{cls.__module__}.{cls.__qualname__}"


@cache
def _import_own(family: str) -> None:
    """The family's components that come with the package."""
    module = importlib.import_module(FAMILIES[family]) if family in FAMILIES else None
    for info in pkgutil.iter_modules(getattr(module, "__path__", ())):
        if module is not None and not info.name.startswith("_"):
            importlib.import_module(f"{module.__name__}.{info.name}")


@cache
def _import_family(family: str) -> None:
    _import_own(family)
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


def as_fields(family: str, value: Any) -> Any:
    """A word or a number in place of a component as its fields; anything else as it is.

    Raises:
        ConfigError: a class stands for one of its instances.
    """
    if isinstance(value, type):
        name = value.__name__
        raise ConfigError(f"{name} is a class, where its instance is expected; write {name}()")
    if isinstance(value, str):
        return {"kind": value}
    if isinstance(value, int | float) and not isinstance(value, bool):
        meant = next((c for c in components(family).values() if c.bare_number), None)
        return value if meant is None else {"kind": meant.kind, meant.bare_number: value}
    return value
