"""How strong automatic smoothing is, where points make that hard to say."""

from __future__ import annotations

import numpy as np
import pytest

from steersman.paths.smoothing import smoothed


@pytest.mark.parametrize("count", [6, 20, 40])
@pytest.mark.parametrize("closed", [False, True])
def test_an_outlier_has_a_smooth_curve(count: int, closed: bool) -> None:
    """Wherever it lies: weak smoothing has no cross-validation there, and is not asked for one."""
    step = 10.0 * np.arange(count)
    angle = 2.0 * np.pi * np.arange(count) / count
    round_course = 60.0 * np.stack([np.cos(angle), np.sin(angle)], 1)
    whole = round_course if closed else np.stack([step, 0.002 * step**2], 1)
    for at in range(count):
        for away in (3.0, 300.0):
            place = whole.copy()
            place[at] += away, -away
            found = smoothed(place, closed, None)
            assert np.isfinite(found.place).all()
            assert np.isfinite(found.noise)
