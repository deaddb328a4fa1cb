"""Where a result came from: versions and commit."""

from __future__ import annotations

import platform
import subprocess
from collections.abc import Mapping
from functools import cache
from importlib.metadata import PackageNotFoundError, entry_points, version
from pathlib import Path as FilePath
from typing import Any

_PACKAGES = ("steersman", "numpy", "numba", "daqp", "onnxruntime", "stable-baselines3", "torch")


@cache
def provenance() -> dict[str, Any]:
    """Versions of the packages that matter for numbers, plug-ins too, and the commit."""
    versions = {"python": platform.python_version(), **_plugins()}
    for name in _PACKAGES:
        try:
            versions[name] = version(name)
        except PackageNotFoundError:
            continue
    return {"versions": versions, "commit": _commit()}


def _plugins() -> dict[str, str]:
    found = [point.dist for point in entry_points(group="steersman.components")]
    return {dist.name: dist.version for dist in found if dist is not None}


def missing_plugins(versions: Mapping[str, str]) -> list[str]:
    """Names and versions of the plug-ins in ``versions`` that are not installed here."""
    here = {"python", *_PACKAGES, *_plugins()}
    return [f"{name} {number}" for name, number in versions.items() if name not in here]


def _commit() -> str | None:
    """Commit of the source tree this package is imported from; "-dirty" with changes in it."""
    here = FilePath(__file__).resolve().parent
    command = ["git", "describe", "--always", "--dirty", "--abbrev=40", "--exclude=*"]
    try:
        done = subprocess.run(
            command, cwd=here, capture_output=True, text=True, timeout=10, check=True
        )
    except (OSError, subprocess.SubprocessError):
        return None
    return done.stdout.strip() or None
