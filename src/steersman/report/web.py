"""What pages are made of: templates, styles, and the script that replays drives.

Names of runs, paths and controllers come from users' files. The template engine escapes all of
them; data for the script are compressed and in letters of base64, so they hold no character that
HTML knows; the script puts names into the page as text, never as HTML. A content security policy
allows the page's own script, by its digest, and no connection to anywhere.
"""

from __future__ import annotations

import base64
import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from importlib import resources
from typing import TYPE_CHECKING, Any

from steersman.errors import SteersmanError, how_to_install
from steersman.report.pack import Blob, packed
from steersman.report.scene import BUDGET, RoadGroup, scenes
from steersman.report.signals import signals_of

if TYPE_CHECKING:
    from jinja2 import Template

_MISSING = f"a report needs {how_to_install('report')}"
# In the order in which they need each other.
SCRIPTS = (
    "unpack", "theme", "axes", "drive", "view", "car", "map", "miniature", "panels", "marks",
    "lane", "controls", "player", "keys", "training",
)  # fmt: skip
# Rows are halved at most so often to keep a page within its limit.
_HALVINGS = 6


def resource(name: str) -> str:
    """A file of the folder ``page``."""
    return resources.files(__package__).joinpath("page", name).read_text(encoding="utf-8")


@cache
def script(*last: str) -> str:
    """The page's script: its files behind each other, ``last`` ones in a scope of their own."""
    parts = "\n".join(resource(f"{name}.js") for name in (*SCRIPTS, *(last or ("main",))))
    return f'"use strict";\n(() => {{\n{parts}}})();\n'


def policy(content: str) -> str:
    """A content security policy that lets this script run, and nothing else."""
    own = "'none'"
    if content:
        digest = hashlib.sha256(content.encode()).digest()
        own = f"'sha256-{base64.b64encode(digest).decode()}'"
    return (
        f"default-src 'none'; script-src {own}; style-src 'unsafe-inline'; img-src data: blob:; "
        "base-uri 'none'; form-action 'none'"
    )


def template(name: str) -> Template:
    """A template that escapes whatever is put into it.

    Raises:
        SteersmanError: the extra ``report`` is not installed.
    """
    try:
        from jinja2 import Environment, FunctionLoader, StrictUndefined
    except ModuleNotFoundError:
        raise SteersmanError(_MISSING) from None
    environment = Environment(
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        loader=FunctionLoader(resource),
    )
    return environment.get_template(name)


def parts(
    groups: Sequence[RoadGroup], training: Mapping[str, Any] | None = None, budget: int = BUDGET
) -> dict[str, Any]:
    """What templates need for the script: itself, its policy, its data and columns.

    Without drives and training there is no script at all.
    """
    content = script() if groups or training else ""
    if not content:
        return {"script": "", "policy": policy(""), "data": "", "columns_data": ""}
    blob = Blob()
    data = {
        "groups": scenes(groups, blob, budget),
        "signals": [
            {"key": s.key, "title": s.title, "unit": s.unit, "step": s.step, "shown": s.shown}
            for s in signals_of(drive.episode for group in groups for drive in group.drives)
        ],
        "training": training,
    }
    return {
        "script": content,
        "policy": policy(content),
        "data": packed(json.dumps(data, separators=(",", ":"), allow_nan=False)),
        "columns_data": blob.packed(),
    }


def within(limit: int, render: Callable[[int], str]) -> str:
    """The page of ``render(rows)`` with as many rows as the limit [bytes] lets it keep."""
    budget = BUDGET
    page = render(budget)
    for _ in range(_HALVINGS):
        if len(page.encode()) <= limit:
            break
        budget //= 2
        page = render(budget)
    return page
