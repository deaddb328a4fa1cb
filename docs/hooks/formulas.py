"""Formulas as MathML, which browsers draw by themselves; figures as part of the page.

State diagrams, which GitHub draws, become tables: drawing them here would take a script from
elsewhere. And docstrings' references (``:func:`name```), which the reader of a page takes as code.
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
# Brackets of a matrix, which the converter leaves small.
OPEN = re.compile(r"<mo>(&#x0005B;|&#x00028;)</mo>(?=<mtable)")
CLOSE = re.compile(r"(?<=</mtable>)<mo>(&#x0005D;|&#x00029;)</mo>")
# The converter sets no space around functions: "v sin e" would be read as one word.
BEFORE = re.compile(r"(?<=\w) (?=\\(?:sin|cos|tan) )")
AFTER = re.compile(r"\\(sin|cos|tan) (?=\w)")
DIAGRAM = re.compile(r"^```mermaid\nstateDiagram-v2\n(.*?)^```$", re.MULTILINE | re.DOTALL)
CHANGE = re.compile(r"^\s*(\w+) --> (\w+): (.*)$", re.MULTILINE)
ROLE = re.compile(r":(?:func|class|mod|meth|data):(?=<code>)")


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Replace state diagrams."""
    return DIAGRAM.sub(_table, markdown)


def _table(match: re.Match[str]) -> str:
    rows = [f"| `{a}` | `{b}` | {when} |" for a, b, when in CHANGE.findall(match[1])]
    return "\n".join(["| from | to | when |", "|---|---|---|", *rows])


def on_page_content(content: str, **_: Any) -> str:
    """Replace what the Markdown extensions left."""
    return ROLE.sub("", FIGURE.sub(_figure, FORMULA.sub(_formula, content)))


def _formula(match: re.Match[str]) -> str:
    display = "block" if match["open"] == "[" else "inline"
    # What GitHub draws and what the converter knows go by two names; names with digits it slants.
    latex = html.unescape(match["latex"]).strip().replace("{aligned}", "{align*}")
    latex = latex.replace(r"\operatorname{atan2}", r"\text{atan2}")
    latex = AFTER.sub(r"\\\1\\, ", BEFORE.sub(r"\\, ", latex))
    mathml = convert(latex, display=display)
    mathml = OPEN.sub(r'<mo stretchy="true" fence="true" form="prefix">\1</mo>', mathml)
    mathml = CLOSE.sub(r'<mo stretchy="true" fence="true" form="postfix">\1</mo>', mathml)
    return f'<div class="formula">{mathml}</div>' if display == "block" else mathml


def _figure(match: re.Match[str]) -> str:
    """The drawing itself: text and grid take the page's colour, light or dark."""
    svg = (IMAGES / match["name"]).read_text(encoding="utf-8")
    svg = svg.replace('fill="#808080"', 'fill="currentColor"')
    svg = svg.replace('stroke="#808080"', 'stroke="currentColor"')
    return f'<span class="figure" aria-label="{match["alt"]}">{svg.strip()}</span>'
