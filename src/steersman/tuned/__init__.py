"""Classical controllers as tuned on the suite ``tuning``, all with the same budget.

``results/tune`` has how each was found. On the command line ``tuned/NAME`` stands for the file.
"""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path

_PREFIX = "tuned/"
VEHICLE = "carla_model3"
"""The kind of vehicle on which all of them were tuned."""


def names() -> list[str]:
    """``tuned/NAME`` of every tuned controller of the package."""
    found = (f.name for f in files(__name__).iterdir())
    return sorted(f"{_PREFIX}{name[:-5]}" for name in found if name.endswith(".yaml"))


def locate(name: str) -> Path | None:
    """The YAML file of ``tuned/NAME``; None if there is none of that name."""
    if name not in names():
        return None
    return Path(str(files(__name__).joinpath(f"{name.removeprefix(_PREFIX)}.yaml")))
