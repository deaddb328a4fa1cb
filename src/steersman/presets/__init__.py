"""Training presets of the package: ``steersman train demo`` reads ``demo.yaml`` here."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path


def names() -> list[str]:
    """Name of every preset."""
    return sorted(f.name[:-5] for f in files(__name__).iterdir() if f.name.endswith(".yaml"))


def locate(name: str) -> Path | None:
    """The YAML file of a preset; None if there is none of that name."""
    return Path(str(files(__name__).joinpath(f"{name}.yaml"))) if name in names() else None
