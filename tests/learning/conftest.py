"""Trainings must not change how later tests compute."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
import torch


@pytest.fixture(autouse=True)
def _denormals() -> Iterator[None]:
    """Training flushes denormal numbers to zero, a setting of the whole process."""
    yield
    torch.set_flush_denormal(False)
