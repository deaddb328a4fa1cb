"""Training presets of the package: ``steersman train demo`` reads ``demo.yaml`` here."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path


def names() -> list[str]:
    """Name of every preset; what several have in common is in files that begin with _."""
    return sorted(name for name in _files() if not name.startswith("_"))


def locate(name: str) -> Path | None:
    """The YAML file of a preset; None if there is none of that name."""
    return _files().get(name)


def _files() -> dict[str, Path]:
    found = (Path(str(file)) for file in files(__name__).iterdir())
    return {file.stem: file for file in found if file.suffix == ".yaml"}
