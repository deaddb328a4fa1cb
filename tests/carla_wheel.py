"""CARLA's client, which comes as a wheel for some platforms only."""

from __future__ import annotations

import importlib
import platform
import sys
from typing import Any

import pytest

_HAS_WHEEL = (
    sys.platform in {"linux", "win32"}
    and platform.machine() in {"x86_64", "AMD64"}
    and sys.version_info < (3, 13)
)


def load() -> Any:
    """The module ``carla``; skips the test where there is no build of it, and only there."""
    if not _HAS_WHEEL:
        pytest.skip("there is no wheel of carla for this platform and version of Python")
    return importlib.import_module("carla")
