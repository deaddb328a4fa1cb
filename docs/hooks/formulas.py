"""Formulas as MathML, which browsers draw by themselves; figures as part of the page.

And docstrings' references (``:func:`name```), which the reader of a page takes as code.
"""

from __future__ import annotations

import html
import re
from pathlib import Path
from typing import Any

from latex2mathml.converter import convert

IMAGES = Path(__file__).resolve().parents[1] / "images"
FORMULA = re.compile(
    r'<(?P<tag>div|span) class="arithmatex">\\(?P<open>[\[(])(?P<latex>.*?)\\[\])]</(?P=tag)>',
    re.DOTALL,
)
FIGURE = re.compile(r'<img alt="(?P<alt>[^"]*)" src="(?:[^"]*/)?images/(?P<name>\w+\.svg)" ?/?>')
ROLE = re.compile(r":(?:func|class|mod|meth|data):(?=<code>)")


def on_page_content(content: str, **_: Any) -> str:
    """Replace what the Markdown extensions left."""
    return ROLE.sub("", FIGURE.sub(_figure, FORMULA.sub(_formula, content)))


def _formula(match: re.Match[str]) -> str:
    display = "block" if match["open"] == "[" else "inline"
    mathml = convert(html.unescape(match["latex"]).strip(), display=display)
    return f'<div class="formula">{mathml}</div>' if display == "block" else mathml


def _figure(match: re.Match[str]) -> str:
    """The drawing itself: text and grid take the page's colour, light or dark."""
    svg = (IMAGES / match["name"]).read_text(encoding="utf-8")
    svg = svg.replace('fill="#808080"', 'fill="currentColor"')
    svg = svg.replace('stroke="#808080"', 'stroke="currentColor"')
    return f'<span class="figure" aria-label="{match["alt"]}">{svg.strip()}</span>'
