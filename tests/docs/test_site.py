"""The site: complete, and silent towards the network."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path as FilePath

import pytest

from steersman.config import components, families

from .pages import ROOT

# What a browser would load by itself. Links that a reader may follow are none.
LOADED = re.compile(
    r"<(?:script|img|iframe|source)[^>]*\bsrc=[\"']([^\"']*)|<link[^>]*\bhref=\"([^\"]*)"
)


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> FilePath:
    """The site as ``make check`` builds it."""
    folder = tmp_path_factory.mktemp("site")
    words = [sys.executable, "-m", "mkdocs", "build", "--strict", "-d", str(folder)]
    environment = {**os.environ, "NO_MKDOCS_2_WARNING": "1"}
    done = subprocess.run(
        words, cwd=ROOT, env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return folder


def own_pages(site: FilePath) -> list[FilePath]:
    """All but copies of reports, which are pages of their own kind."""
    return [page for page in sorted(site.rglob("*.html")) if "files" not in page.parts]


def test_nothing_is_loaded_from_elsewhere(site: FilePath) -> None:
    for page in own_pages(site):
        for match in LOADED.finditer(page.read_text(encoding="utf-8")):
            to = match[1] or match[2] or ""
            assert "://" not in to, f"{page.name}: {to}"
            assert not to.startswith("//"), f"{page.name}: {to}"
    for sheet in site.rglob("*.css"):
        assert not re.search(r"url\(['\"]?(https?:)?//", sheet.read_text(encoding="utf-8"))


def test_whatever_is_loaded_is_there(site: FilePath) -> None:
    for page in own_pages(site):
        if page.name == "404.html":  # its addresses begin at the server's root
            continue
        for match in LOADED.finditer(page.read_text(encoding="utf-8")):
            to = (match[1] or match[2] or "").partition("?")[0].partition("#")[0]
            if to and not to.startswith("data:"):
                assert (page.parent / to).exists(), f"{page.relative_to(site)}: {to}"


def test_every_component_has_its_fields_told(site: FilePath) -> None:
    for family in families():
        # Other tests may have registered components of their own.
        ours = {k: c for k, c in components(family).items() if c.__module__[:10] == "steersman."}
        if not ours:
            continue
        text = (site / "reference" / f"{family}.html").read_text(encoding="utf-8")
        for name, cls in ours.items():
            assert f'id="{name}"' in text
            for field in cls.model_fields:
                assert field in text, f"{family} {name} {field}"


def test_every_page_of_the_repository_is_built(site: FilePath) -> None:
    for source in (ROOT / "docs").rglob("*.md"):
        page = source.relative_to(ROOT / "docs").with_suffix(".html")
        page = page.with_name("index.html") if page.stem == "README" else page
        assert (site / page).is_file(), page
    assert (site / "changelog.html").is_file()


def test_a_notebook_is_a_page_with_its_code_and_its_file(site: FilePath) -> None:
    for source in (ROOT / "docs" / "notebooks").glob("*.ipynb"):
        text = (site / "notebooks" / f"{source.stem}.html").read_text(encoding="utf-8")
        assert (site / "notebooks" / source.name).is_file()
        assert re.findall(r'href="([^"]*\.ipynb)"', text) == [source.name]
        code = source.read_text(encoding="utf-8").count('"cell_type": "code"')
        assert text.count('<div class="highlight">') == code > 3


def test_no_formula_is_left_as_it_was_written(site: FilePath) -> None:
    count = 0
    for page in own_pages(site):
        text = page.read_text(encoding="utf-8")
        assert 'class="arithmatex"' not in text, page.name
        assert ":func:" not in text, page.name
        for formula in re.findall(r"<math.*?</math>", text, re.DOTALL):
            assert "\\" not in formula, f"{page.name}: {formula}"
            assert "<mi>&</mi>" not in formula, f"{page.name}: {formula}"
            count += 1
    assert count > 200


def test_figures_take_the_colour_of_the_page(site: FilePath) -> None:
    text = (site / "equations" / "vehicle.html").read_text(encoding="utf-8")
    assert text.count('<span class="figure"') == 4
    assert 'fill="currentColor"' in text
    assert "#808080" not in text


def test_a_state_diagram_is_a_table(site: FilePath) -> None:
    text = (site / "supervisor.html").read_text(encoding="utf-8")
    assert "stateDiagram" not in text
    assert "<td>fault of the fallback</td>" in text
