"""A constant error of the odometry moves a car beside the road; it does not drive it off."""

from __future__ import annotations

import numpy as np
import pytest

import steersman as sm
from steersman import tuned

BIASES = {"v_y": 0.1, "yaw_rate": 0.01, "v_x_scale": 0.05}


@pytest.mark.parametrize("name", tuned.names())
@pytest.mark.parametrize("bias", BIASES)
def test_the_road_is_believed(name: str, bias: str) -> None:
    wrong = [{"kind": "sensor_bias", bias: BIASES[bias]}]
    drives = [
        sm.drive(name, path="circle", speed=15.0, duration=20.0, disturbances=disturbances)
        for disturbances in ([], wrong)
    ]
    moved = np.abs(drives[1]["lateral_error"] - drives[0]["lateral_error"])
    assert moved.max() < 0.2
    assert moved[-100:].max() < moved[-200:-100].max() + 0.005  # it has settled
