"""The notebooks run cell by cell in this process: what they assert holds, results are shown."""

from __future__ import annotations

import ast
import json
import shlex
import sys
from collections.abc import Iterator
from pathlib import Path as FilePath
from types import ModuleType
from typing import Any

import pytest
from matplotlib import pyplot

from steersman import registry
from steersman.registry import components, families

from .pages import ROOT
from .world import steersman

NOTEBOOKS = sorted((ROOT / "docs" / "notebooks").glob("*.ipynb"))


def content(notebook: FilePath) -> Any:
    return json.loads(notebook.read_text(encoding="utf-8"))


def run(source: str, where: str, names: dict[str, Any]) -> None:
    """One cell of code, as Jupyter runs it: its last expression is shown."""
    if source.startswith("!"):
        for line in source.splitlines():
            program, *words = shlex.split(line.removeprefix("!"))
            assert program == "steersman", line
            steersman(*words)
        return
    tree = ast.parse(source, where)
    last = tree.body.pop() if isinstance(tree.body[-1], ast.Expr) else None
    exec(compile(tree, where, "exec"), names)
    if isinstance(last, ast.Expr):
        value = eval(compile(ast.Expression(last.value), where, "eval"), names)  # noqa: S307
        assert value is None or shown(value)


def shown(value: Any) -> str:
    """What a notebook displays of a value."""
    page = getattr(value, "_repr_html_", None)
    return str(repr(value) if page is None else page())


@pytest.fixture
def names(tmp_path: FilePath, monkeypatch: pytest.MonkeyPatch) -> Iterator[dict[str, Any]]:
    """Those of a notebook in an empty folder; what it registers is gone after it."""
    monkeypatch.chdir(tmp_path)
    for family in families():
        monkeypatch.setitem(registry._REGISTRY, family, dict(components(family)))
    module = ModuleType("cells")
    monkeypatch.setitem(sys.modules, "cells", module)
    yield module.__dict__
    pyplot.close("all")


@pytest.mark.parametrize("notebook", NOTEBOOKS, ids=lambda notebook: notebook.stem)
def test_a_notebook_runs(notebook: FilePath, names: dict[str, Any]) -> None:
    cells = [cell for cell in content(notebook)["cells"] if cell["cell_type"] == "code"]
    assert "assert " in str(cells)
    for number, cell in enumerate(cells):
        run("".join(cell["source"]), f"{notebook.name}, cell of code {number}", names)


@pytest.mark.parametrize("notebook", NOTEBOOKS, ids=lambda notebook: notebook.stem)
def test_a_notebook_is_kept_without_outputs_and_is_named(notebook: FilePath) -> None:
    cells = content(notebook)["cells"]
    assert len({cell["id"] for cell in cells}) == len(cells)
    code = [cell for cell in cells if cell["cell_type"] == "code"]
    assert not any(cell["outputs"] or cell["execution_count"] for cell in code)
    assert f"notebooks/{notebook.stem}.md" in (ROOT / "mkdocs.yml").read_text(encoding="utf-8")
    for page in ("README.md", "docs/README.md"):
        assert f"notebooks/{notebook.name})" in (ROOT / page).read_text(encoding="utf-8")


def test_the_sheet_of_the_exercises_has_no_solution() -> None:
    """What is left without the tagged cells: imports, tasks, and where to go on."""
    (notebook,) = [each for each in NOTEBOOKS if "exercises" in each.stem]
    cells = content(notebook)["cells"]
    left = [cell for cell in cells if "solution" not in cell["metadata"].get("tags", ())]
    assert [cell["cell_type"] for cell in left].count("code") == 1
    words = ["".join(c["source"]) for c in left if c["cell_type"] == "markdown"]
    assert [text.startswith("## ") for text in words] == [False, *[True] * 7, False]
    assert not any("solution" in text.lower() for text in words)
    assert words[-1].startswith("**Further.**")


def test_a_cell_that_fails_is_found() -> None:
    for source in ("x = 1\nassert x == 2", "x = 1\nx.y", "!steersman drive path=circel"):
        with pytest.raises((AssertionError, AttributeError)):
            run(source, "cell", {})
