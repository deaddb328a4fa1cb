"""Exploration noise."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from stable_baselines3.common.noise import ActionNoise, VectorizedActionNoise


class OrnsteinUhlenbeck(VectorizedActionNoise):
    """Ornstein-Uhlenbeck noise for n vehicles at once (Uhlenbeck and Ornstein, 1930).

    x += theta (0 - x) dt + sigma sqrt(dt) N(0, 1), in units of the action range, once a step.
    """

    def __init__(
        self, shape: tuple[int, int], theta: float, sigma: Callable[[], float], dt: float, seed: int
    ) -> None:
        """Noise of ``shape`` (vehicles, actions); ``sigma`` is called at every step."""
        ActionNoise.__init__(self)
        self.theta, self.sigma, self.dt = theta, sigma, dt
        self.rng = np.random.default_rng(seed)
        self.state = np.zeros(shape)

    def __call__(self) -> Any:
        """Noise of the next step, (vehicles, actions)."""
        kick = self.rng.standard_normal(self.state.shape)
        drift = -self.theta * self.dt * self.state
        self.state = self.state + drift + self.sigma() * math.sqrt(self.dt) * kick
        return self.state.astype(np.float32)

    def reset(self, indices: Any = None) -> None:
        """Start again from zero, for all vehicles or those named."""
        self.state[slice(None) if indices is None else indices] = 0.0
