"""Trained policies of the package; on the command line each is known by its name."""

from __future__ import annotations

from importlib.resources import files


def names() -> list[str]:
    """Name of every policy of the package."""
    return sorted(f.name[:-5] for f in files(__name__).iterdir() if f.name.endswith(".onnx"))
