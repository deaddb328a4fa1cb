"""``steersman version``: what a report of a fault, or a paper, should state."""

from __future__ import annotations

import platform
import re
from importlib.metadata import PackageNotFoundError, distribution, requires
from typing import Any

from steersman.cli import settings
from steersman.cli.output import show, show_json, table

EXAMPLES = "\b\nExamples:\n  steersman version\n  steersman version --json      (for a record)"
_EXTRA = re.compile(r"(?P<name>[A-Za-z0-9._-]+).*;.*extra == ['\"](?P<extra>\w+)['\"]")
# Extras for those who develop Steersman itself.
_INTERNAL = ("dev", "docs")


def version(as_json: settings.AsJson = False) -> None:
    """Print versions, commit and machine, and which extras are installed."""
    from steersman.provenance import provenance

    found: dict[str, Any] = {
        **provenance(),
        "platform": platform.platform(),
        "machine": platform.machine(),
        "extras": _extras(),
    }
    if as_json:
        show_json(found)
        return
    out = table("what", "here")
    for name, number in found["versions"].items():
        out.add_row(name, number)
    out.add_row("commit", found["commit"] or "not in a git checkout")
    out.add_row("platform", found["platform"])
    for name, missing in found["extras"].items():
        out.add_row(f"extra {name}", f"lacks {', '.join(missing)}" if missing else "installed")
    show(out)


def _extras() -> dict[str, list[str]]:
    """The packages that each extra lacks here."""
    out: dict[str, list[str]] = {}
    for text in requires("steersman") or ():
        match = _EXTRA.match(text)
        if match is None or match["extra"] in _INTERNAL:
            continue
        missing = out.setdefault(match["extra"], [])
        if not _installed(match["name"]):
            missing.append(match["name"])
    return out


def _installed(name: str) -> bool:
    try:
        distribution(name)
    except PackageNotFoundError:
        return False
    return True
