"""``dir(steersman)`` is the table of contents of docs/api: each name, with its first line."""

from __future__ import annotations

import inspect
import re

import pytest

import steersman as sm

from .pages import ROOT

PAGE = ROOT / "docs" / "api" / "README.md"
BEGIN, END = "<!-- the front door -->\n", "<!-- end -->\n"


def line(name: str) -> str:
    """A name and the first line of its docstring, as a row."""
    found = getattr(sm, name)
    text = inspect.cleandoc(found.__doc__ or "").split("\n")[0] if callable(found) else ""
    if inspect.ismodule(found):
        text = inspect.cleandoc(found.__doc__ or "").split("\n")[0]
    text = re.sub(r":\w+:`~?([^`]*)`", r"`\1`", text).replace("``", "`").replace("|", "/")
    return f"| `sm.{name}` | {text} |"


def table() -> str:
    names = sorted((n for n in dir(sm) if not n.startswith("_")), key=lambda n: (n.lower(), n))
    return "\n".join(["| name | what it is |", "|---|---|", *map(line, names)]) + "\n"


def test_the_page_lists_the_front_door() -> None:
    text = PAGE.read_text(encoding="utf-8")
    written = text.partition(BEGIN)[2].partition(END)[0].strip()
    assert written == table().strip(), f"write this between the marks of {PAGE.name}:\n{table()}"


@pytest.mark.parametrize("name", [n for n in dir(sm) if callable(getattr(sm, n))])
def test_every_name_has_a_docstring(name: str) -> None:
    assert (getattr(sm, name).__doc__ or "").strip(), name
