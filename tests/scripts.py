"""Python files outside the packages, as modules."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

ROOT = Path(__file__).resolve().parents[1]


def script(place: str) -> ModuleType:
    """The module in a file of the repository, e.g. ``benchmarks/golden.py``; executed once."""
    name = Path(place).stem
    if name not in sys.modules:
        spec = importlib.util.spec_from_file_location(name, ROOT / place)
        assert spec is not None
        assert spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        sys.modules[name] = module
        spec.loader.exec_module(module)
    return sys.modules[name]
