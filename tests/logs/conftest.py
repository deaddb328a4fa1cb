"""A short run, and recordings of it."""

from __future__ import annotations

from pathlib import Path as FilePath

import pytest

from steersman.config import build
from steersman.episode import Episode
from steersman.logs.write import write_episode
from steersman.rollout import RunConfig, run

RUN = build(
    RunConfig,
    {
        "path": "circle",
        "duration": 4.0,
        "start": 300.0,
        "vehicle": {"kind": "bmw_320i", "steer_bias": 0.01},
        "speed": {"kind": "constant_throttle", "throttle": 0.5},
    },
)


@pytest.fixture(scope="session")
def episode() -> Episode:
    """Four seconds on a circle, from a place where the yaw is beyond a half turn."""
    return run(RUN)


@pytest.fixture(scope="session")
def recording(episode: Episode, tmp_path_factory: pytest.TempPathFactory) -> FilePath:
    """The episode as MCAP."""
    file = tmp_path_factory.mktemp("logs") / "run.mcap"
    car = RUN.vehicle
    write_episode(file, episode, car.table, RUN.path, (car.body_length, car.width))
    return file
