"""Checks that every component of a family has to pass, for the authors of plug-ins too.

Each module is the contract of the family of its name: ``check(component)`` returns a sentence for
each finding, none if the component passes. ``steersman check controller.lqr`` runs it.
"""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Callable, Iterable, Iterator
from typing import Any, Generic, NamedTuple, TypeVar

from steersman.config import Component, components, dump, families, lookup, override, resolve
from steersman.controllers.base import ControllerComponent as Controller
from steersman.controllers.base import raised
from steersman.errors import ConfigError, DataError, SteersmanError, one_line
from steersman.words import family_of

T = TypeVar("T")
Check = Callable[[T], Iterator[str]]


class Checked(NamedTuple):
    """What came of the check of one component."""

    name: str
    """``family.kind``."""
    findings: list[str]
    """A sentence for each finding."""
    left_out: str | None = None
    """Why it was not checked; None if it was."""


class Contract(Generic[T]):
    """The checks of a family. Called with a component, it returns a sentence for each finding.

    Every contract begins with :func:`loading_undoes_dumping`. What a check raises is a finding,
    too, since a component of another package may raise anything.
    """

    def __init__(
        self,
        *checks: Check[T],
        also: Callable[[T], Iterable[Check[T]]] = lambda _: (),
        of_classes: bool = False,
    ) -> None:
        """The checks in their order.

        Args:
            checks: generators of sentences.
            also: the checks that depend on what the component is.
            of_classes: whether the checks take a class instead of a component.
        """
        self.checks = checks
        self.also = also
        self.of_classes = of_classes

    def __call__(self, component: T) -> list[str]:
        """What the checks find; each sentence begins with the name of its check."""
        out = []
        for each in (loading_undoes_dumping, *self.checks, *self.also(component)):
            name = each.__name__.strip("_").replace("_", " ")
            try:
                out += [f"{name}: {one_line(text)}" for text in each(component)]
            except Exception as error:  # noqa: BLE001 - a plug-in's component may raise anything
                what = one_line(f"raises {type(error).__name__}: {error}")
                if isinstance(component, Controller) and not isinstance(error, SteersmanError):
                    what = raised(component, error)
                out.append(f"{name}: {what}")
        return out


def loading_undoes_dumping(component: Any) -> Iterator[str]:
    """As plain data and back a component of a registered kind is equal."""
    if not isinstance(component, Component) or not component.kind:
        return
    if component.kind not in components(component.family):
        return
    if resolve(component.family, dump(component)) != component:
        yield "its plain data give another one"


def contracts() -> list[str]:
    """The families that have a contract."""
    modules = (info.name for info in pkgutil.iter_modules(__path__))
    return sorted(name for name in modules if name in families())


def check(word: str, assignments: Iterable[str] = ()) -> tuple[str, list[str]]:
    """Run the contract of a component.

    Args:
        word: ``family.word`` (``controller.lqr``), or the word alone where only one family has it.
        assignments: fields of the component, ``key=value``.

    Returns:
        ``family.kind``, and a sentence for each finding; none if the component passes.

    Raises:
        ConfigError: there is no such component, no contract of its family, or a field is wrong.
        DataError: a file that the component reads is missing or malformed.
    """
    family, name = family_of(word)
    run = _contract(family)
    if run.of_classes and name in components(family):
        cls = lookup(family, name)
        return f"{family}.{cls.kind}", run(cls)
    found: Any = resolve(family, override({"kind": name}, assignments))
    return f"{family}.{found.kind}", run(found)


def check_family(family: str) -> Iterator[Checked]:
    """Run the contract of each registered component of a family, with its default fields.

    Components that need a file or a server are left out.

    Raises:
        ConfigError: the family has no contract.
    """
    run = _contract(family)
    for kind, cls in components(family).items():
        name = f"{family}.{kind}"
        try:
            made: Any = cls if run.of_classes else resolve(family, kind)
        except (ConfigError, DataError) as error:
            yield Checked(name, [], one_line(str(error)))
            continue
        if family == "plant" and not made.computed:
            yield Checked(name, [], f"needs a server; steersman check {name} uses it")
            continue
        yield Checked(name, run(made))


def _contract(family: str) -> Contract[Any]:
    if family not in contracts():
        others = ", ".join(contracts())
        raise ConfigError(f"{family}: has no contract; families that have: {others}")
    found: Contract[Any] = importlib.import_module(f"{__name__}.{family}").check
    return found
