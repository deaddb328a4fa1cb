"""The equations pages: one for each controller, in the code's own names, each with a figure."""

from __future__ import annotations

import re
from pathlib import Path as FilePath

import pytest

from steersman.config import components

from .pages import ROOT

PAGES = sorted((ROOT / "docs" / "equations").glob("*.md"))
WORDS = re.compile(r"\w+")
CODE = {
    word
    for file in (ROOT / "src").rglob("*.py")
    for word in WORDS.findall(file.read_text(encoding="utf-8"))
}


@pytest.mark.parametrize("kind", components("controller"))
def test_every_controller_of_the_package_has_its_page(kind: str) -> None:
    if not components("controller")[kind].__module__.startswith("steersman."):
        pytest.skip("of another package")
    if kind == "process":
        pytest.skip("a program outside has equations of its own: docs/demonstration.md")
    text = (ROOT / "docs" / "equations" / f"{kind}.md").read_text(encoding="utf-8")
    assert f"controller={kind}" in text
    assert "$$" in text
    assert "../images/" in text
    assert f"equations/{kind}.md" in (ROOT / "mkdocs.yml").read_text(encoding="utf-8")


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_names_are_those_of_the_code(page: FilePath) -> None:
    text = page.read_text(encoding="utf-8")
    named = {word for span in re.findall(r"`([^`\n]+)`", text) for word in WORDS.findall(span)}
    # A name that ends in _ stands for all that begin so, as in `steer_curve_*`.
    given = {word for word in named if "_" in word.rstrip("_")}
    assert not {word for word in given if not (word in CODE or stem(word))}


def stem(word: str) -> bool:
    return word.endswith("_") and any(other.startswith(word) for other in CODE)
