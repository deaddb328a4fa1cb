"""The Gymnasium environment ``steersman/PathFollowing-v0``: one vehicle of a Problem."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from steersman.config import build, merge
from steersman.kernels import observe
from steersman.kernels import world as kernel
from steersman.kernels.encode import FEATURE_LIMIT
from steersman.kernels.vehicle import VX, VY
from steersman.learning.fleet import FleetDriver
from steersman.learning.problem import Problem

Features = NDArray[np.float32]


class PathFollowingEnv(gymnasium.Env[Features, Features]):
    """Follow a path; the action is the steering, its rate, or a correction of it.

    Observation: (features,) float32, about unit size; named in ``observation_names``.
    Action: (1,) in [-1, 1], left positive. Leaving the corridor or rolling over terminates;
    time and the end of a road truncate. ``info`` holds the true lateral error [m], heading error
    [rad], speed [m/s], arc length [m], and for the returned observation the base's steering (if
    there is a base) and the demonstrator's steering and action (if there is one, and the episode
    goes on).
    """

    metadata: dict[str, Any] = {"render_modes": [], "render_fps": 20}  # noqa: RUF012 - Gymnasium's

    def __init__(self, problem: Problem | Mapping[str, Any] | None = None) -> None:
        """Make the environment from a Problem, or from the fields that differ from its default."""
        if not isinstance(problem, Problem):
            problem = build(Problem, merge({}, problem or {}))
        self.problem = problem
        self.driver = FleetDriver(problem, 1)
        self._fleet = self.driver.fleet
        features = self._fleet.inputs.shape[1]
        self.observation_space = spaces.Box(-FEATURE_LIMIT, FEATURE_LIMIT, (features,), np.float32)
        self.action_space = spaces.Box(-1.0, 1.0, (1,), np.float32)
        self.observation_names = problem.layout.names
        self._seeded = False

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Features, dict[str, Any]]:
        """Begin a new episode; ``seed`` makes it and those that follow repeatable."""
        super().reset(seed=seed)
        if seed is not None or not self._seeded:
            fresh = int(self.np_random.integers(2**31)) if seed is None else seed
            self.driver.seed(fresh)
            self._seeded = True
        self.driver.reset(0)
        return self._fleet.inputs[0].astype(np.float32), self._info()

    def step(self, action: Any) -> tuple[Features, float, bool, bool, dict[str, Any]]:
        """Drive one control period."""
        self.driver.step(np.asarray(action, dtype=np.float64).reshape(1))
        fleet = self._fleet
        reason = int(fleet.ended[0])
        failed = reason in kernel.FAILED
        truncated = reason != kernel.RUNNING and not failed
        features = fleet.inputs[0].astype(np.float32)
        return features, float(fleet.reward[0, 0]), failed, truncated, self._info()

    def close(self) -> None:
        """Release the plant, if there is one."""
        self.driver.close()

    def _info(self) -> dict[str, Any]:
        fleet, driver = self._fleet, self.driver
        tracking = fleet.tracking[0].tolist()
        v_x, v_y = fleet.state[0, VX], fleet.state[0, VY]
        info = {
            "lateral_error": tracking[observe.D],
            "heading_error": tracking[observe.HEADING],
            "s": tracking[observe.S],
            "speed": float(np.hypot(v_x, v_y)),
        }
        if driver.demonstrates and fleet.ended[0] == kernel.RUNNING:
            info["demo_steer"] = float(fleet.demo[0])
            info["demo_action"] = float(driver.demonstrated_actions()[0])
        if self.problem.base is not None:
            info["base_steer"] = float(fleet.base[0])
        return info
