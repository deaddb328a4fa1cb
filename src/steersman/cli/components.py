"""``steersman list`` and ``steersman show``: what there is, and what can be set."""

from __future__ import annotations

import inspect
from typing import TYPE_CHECKING, Annotated, Any

import typer

from steersman.cli import settings
from steersman.cli.output import note, show, show_json, table, write
from steersman.errors import ConfigError, one_line, suggestion

if TYPE_CHECKING:
    from pydantic import BaseModel

    from steersman.fields import Field

LIST_EXAMPLES = (
    "\b\nExamples:\n  steersman list\n  steersman list controller\n  steersman list path --json"
)
SHOW_EXAMPLES = (
    "\b\nExamples:\n"
    "  steersman show controller mpc_pid\n"
    "  steersman show tuned/mpc_pid\n"
    "  steersman show path circle --json\n"
    "  steersman show vehicle my_car.yaml\n"
    "  steersman show drive\n"
    "  steersman show train apg"
)
CHECK_EXAMPLES = (
    "\b\nExamples:\n"
    "  steersman check controller.lqr\n"
    "  steersman check vector_field k_heading=2\n"
    "  steersman check track.csv\n"
    "  steersman check controller\n"
    "\n"
    "The exit code is 1 if anything is found."
)
# Whole commands whose settings can be shown, beside the components.
_COMMANDS = ("drive", "train", "imitate", "tune", "falsify", "bench")


def list_components(
    kind: Annotated[
        str | None,
        typer.Argument(
            metavar="[KIND]",
            help="Only these, e.g. controller.",
            autocompletion=settings.component,
        ),
    ] = None,
    as_json: settings.AsJson = False,
) -> None:
    """List the components that can be named in a configuration."""
    from steersman import policies, tuned
    from steersman.config import components, families

    wanted = families() if kind is None else [kind]
    found = {
        family: {name: paragraphs(cls)[0] for name, cls in components(family).items()}
        for family in wanted
    }
    if "controller" in found:
        text = "With the gains that were found for it on the suite 'tuning'."
        found["controller"] |= dict.fromkeys(tuned.names(), text)
        found["controller"] |= dict.fromkeys(policies.names(), "A trained policy of the package.")
    if as_json:
        show_json(found)
        return
    rows = table("kind", "name", "what it is")
    for family, names in found.items():
        for name, text in names.items():
            rows.add_row(family, name, text)
    show(rows)


def show_component(
    kind: Annotated[
        str,
        typer.Argument(
            metavar="KIND",
            help=f"E.g. controller, or a component, e.g. tuned/lqr; or {', '.join(_COMMANDS)}",
            autocompletion=settings.component,
        ),
    ],
    name: Annotated[
        str | None,
        typer.Argument(metavar="NAME", help="E.g. mpc_pid.", autocompletion=settings.component),
    ] = None,
    as_json: settings.AsJson = False,
) -> None:
    """Show the fields of a component, or all settings of a command."""
    from steersman.config import families
    from steersman.fields import fields_of
    from steersman.words import family_of

    if name is None and kind not in (*families(), *_COMMANDS):
        kind, name = family_of(kind)
    cls, tuned = _find(kind, name)
    fields = fields_of(cls, tuned)
    about = paragraphs(cls)
    if as_json:
        show_json(
            {
                "kind": kind,
                "name": name,
                "meaning": "\n\n".join(about),
                "fields": [field.plain() for field in fields],
            }
        )
        return
    show(f"{kind} {name}" if name else f"settings of steersman {kind}")
    show(*(f"\n{text}" for text in about), "")
    if fields:
        show(_field_table(fields, "default" if tuned is None else f"in {name or kind}"))


def check_component(
    words: Annotated[
        list[str],
        typer.Argument(
            metavar="NAME|FAMILY.NAME|FAMILY [key=value ...]",
            help="A component, and fields of it; a family: each registered component of it.",
        ),
    ],
) -> None:
    """Check a component against the contract of its family, as the author of a plug-in does.

    Prints a line for each finding.
    """
    from steersman.commands import split
    from steersman.config import families
    from steersman.contracts import Checked, check, check_family

    name, assignments = split(words)
    if name is None:
        raise ConfigError(f"{words[0]!r} is a setting; first comes a name, e.g. controller.lqr")
    if name in families() and assignments:
        raise ConfigError(f"{assignments[0]}: fields go with one component, e.g. controller.lqr")
    whole = name in families()
    faulty = False
    for each in check_family(name) if whole else [Checked(*check(name, assignments))]:
        faulty |= bool(each.findings)
        for text in each.findings:
            write(f"{each.name}: {text}\n")
        count = len(each.findings)
        result = f"{count or 'no'} finding{'' if count == 1 else 's'}"
        note(f"{each.name}: {result if each.left_out is None else f'left out: {each.left_out}'}")
    if faulty:
        raise typer.Exit(1)


def _find(kind: str, name: str | None) -> tuple[type[BaseModel], BaseModel | None]:
    """The class; and the component or settings themselves, of a word that is not just its kind."""
    from steersman.bench.suites import suite
    from steersman.command_table import settings_of
    from steersman.commands import configuration
    from steersman.config import components, families, lookup, resolve

    if kind in _COMMANDS:
        if name is None:
            return settings_of(kind), None
        found = suite(name) if kind == "bench" else configuration(kind, [name])
        return type(found), found
    if kind not in families():
        known = [*families(), *_COMMANDS]
        raise ConfigError(f"unknown kind of component {kind!r}{suggestion(kind, known)}")
    if name is None:
        names = ", ".join(components(kind))
        raise ConfigError(f"show {kind}: which one? names: {names}")
    if name in components(kind):
        return lookup(kind, name), None
    component = resolve(kind, name)
    assert component is not None
    return type(component), component


def paragraphs(cls: type) -> list[str]:
    """The paragraphs of a class's docstring as plain text."""
    text = inspect.cleandoc(cls.__doc__ or "").replace("``", "")
    return [one_line(part) for part in text.split("\n\n")]


def _field_table(fields: list[Field], values: str) -> Any:
    """A row for each field; ``values`` is the title of what it has."""
    rows = table("field", values, "unit", "allowed", "meaning")
    for field in fields:
        rows.add_row(*field.cells())
    return rows
