"""Drives to report."""

import numpy as np
import pytest

from steersman.episode import COLUMNS, Episode


def circle(n=200, radius=50.0, speed=10.0, offset=0.01, start=0.0, end="duration", meta=None):
    """A drive around a circle, a little to the left of it."""
    columns = {name: np.zeros(n) for name in COLUMNS}
    time = 0.05 * np.arange(n)
    s = start + speed * time
    angle, length = s / radius, 2 * np.pi * radius
    error = offset * np.cos(time)
    columns |= {
        "time": time,
        "s": s % length,
        "path_x": radius * np.sin(angle),
        "path_y": radius - radius * np.cos(angle),
        "x": (radius - error) * np.sin(angle),
        "y": radius - (radius - error) * np.cos(angle),
        "psi": angle,
        "lateral_error": error,
        "v_x": np.full(n, speed),
        "control_time": np.full(n, 20e-6),
    }
    return Episode(columns, end, speed * 0.05 * n, 0.05, length, True, meta or {})


@pytest.fixture
def drive():
    return circle


@pytest.fixture(scope="module")
def drive_factory():
    return circle
