"""Checks that every component of a family has to pass, for the authors of plug-ins too.

Each module is the contract of the family of its name, with one function ``check(component)`` that
returns a sentence for each finding. ``steersman check controller.lqr`` runs it.
"""

from __future__ import annotations

import importlib
import inspect
import pkgutil
from collections.abc import Callable, Iterable, Iterator
from typing import Any, TypeVar

from steersman.config import components, families, lookup, override, resolve
from steersman.errors import ConfigError, one_line, suggestion
from steersman.words import means

T = TypeVar("T")
_SHARED = "scenes"


def contracts() -> list[str]:
    """The families that have a contract."""
    modules = (info.name for info in pkgutil.iter_modules(__path__))
    return sorted(name for name in modules if name in families())


def check(word: str, assignments: Iterable[str] = ()) -> tuple[str, list[str]]:
    """Run the contract of a component.

    Args:
        word: ``family.word`` (``controller.lqr``), or the word alone where one family knows it.
        assignments: fields of the component, ``key=value``.

    Returns:
        ``family.kind``, and a sentence for each finding; none if the component passes.

    Raises:
        ConfigError: there is no such component, no contract of its family, or a field is wrong.
    """
    family, name = _family(word)
    if family not in contracts():
        others = ", ".join(contracts())
        raise ConfigError(f"{family}: has no contract; families that have: {others}")
    run = importlib.import_module(f"{__name__}.{family}").check
    wanted = next(iter(inspect.signature(run).parameters.values())).annotation
    if str(wanted).startswith("type[") and name in components(family):
        cls: Any = lookup(family, name)
        return f"{family}.{cls.kind}", list(run(cls))
    found: Any = resolve(family, override({"kind": name}, assignments))
    return f"{family}.{found.kind}", list(run(found))


def _family(word: str) -> tuple[str, str]:
    first, _, rest = word.partition(".")
    if rest and first in families() and means(first, rest):
        return first, rest
    found = [family for family in families() if means(family, word)]
    if len(found) == 1:
        return found[0], word
    if found:
        ways = " or ".join(f"{family}.{word}" for family in found)
        raise ConfigError(f"{word!r} is in several families; write {ways}")
    names = [f"{family}.{kind}" for family in families() for kind in components(family)]
    raise ConfigError(f"unknown component {word!r}{suggestion(word, names)}")


def findings(checks: Iterable[Callable[[T], Iterator[str]]], component: T) -> list[str]:
    """What all checks find, each with its name; what a check raises is a finding too."""
    out = []
    for each in checks:
        name = each.__name__.replace("_", " ")
        try:
            out += [f"{name}: {one_line(text)}" for text in each(component)]
        except Exception as error:  # noqa: BLE001 - a plug-in's component may raise anything
            out.append(one_line(f"{name}: raises {type(error).__name__}: {error}"))
    return out
