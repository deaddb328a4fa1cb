"""The figures of the documentation: drawn by the code, and as the code draws them today."""

from __future__ import annotations

import importlib.util
import re
from types import ModuleType

import numpy as np
import pytest

from .pages import PAGES, ROOT

IMAGES = ROOT / "docs" / "images"
SHOWN = re.compile(r"!\[[^\]]*\]\((?:\.\./)?images/(\w+)\.svg\)")
# Rounding differs between processors; a change of what is shown moves lines by more [px].
CLOSE = 2.0
REDRAW = "if the change is meant: python docs/images/draw.py"


def load() -> ModuleType:
    spec = importlib.util.spec_from_file_location("draw", IMAGES / "draw.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


DRAW = load()


def numbers(svg: str) -> np.ndarray:
    """Every number, that is every place on the drawing."""
    return np.array([float(n) for n in re.findall(r"-?\d+\.?\d*", svg)])


@pytest.mark.parametrize("name", DRAW.FIGURES)
def test_the_figure_is_what_the_code_draws(name: str) -> None:
    kept = (IMAGES / f"{name}.svg").read_text(encoding="utf-8")
    drawn = DRAW.drawn(name)
    assert re.sub(r"[\d.-]+", "", drawn) == re.sub(r"[\d.-]+", "", kept), (
        "python docs/images/draw.py"
    )
    assert numbers(drawn) == pytest.approx(numbers(kept), abs=CLOSE), "python docs/images/draw.py"


def test_every_figure_is_shown_and_every_one_shown_is_drawn() -> None:
    shown = {n for page in PAGES for n in SHOWN.findall(page.read_text(encoding="utf-8"))}
    assert shown == set(DRAW.FIGURES)
