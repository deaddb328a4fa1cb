"""Demonstrations: a problem's demonstrator drives its roads, with a little noise."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from steersman.errors import ConfigError
from steersman.kernels import world as kernel
from steersman.learning.datasets.recorder import Recorder
from steersman.learning.datasets.trajectory import Trajectory, Who
from steersman.learning.fleet import FleetDriver
from steersman.learning.noise import OrnsteinUhlenbeck
from steersman.learning.problem import Problem

SIGMA, THETA = 0.1, 0.15
"""Noise on what is executed (Ornstein-Uhlenbeck, of the action's range) and its return to zero."""


def demonstrate(
    problem: Problem,
    steps: int,
    seed: int,
    *,
    vehicles: int = 16,
    sigma: float = SIGMA,
    tick: Callable[[float], None] | None = None,
) -> list[Trajectory]:
    """Episodes of at least ``steps`` steps together, the demonstrator at the wheel.

    Noise on what is executed shows how it comes back (Laskey et al., DART, CoRL 2017); the
    demonstrated actions are without it. The same arguments give the same episodes.

    Raises:
        ConfigError: the problem has no demonstrator.
    """
    if not problem.demonstration.enabled:
        raise ConfigError("is false: nobody demonstrates", ("problem", "demonstration", "enabled"))
    n = vehicles if problem.plant.embedded else 1
    driver = FleetDriver(problem, n)
    seeds = np.random.SeedSequence(seed).generate_state(2)
    noise = OrnsteinUhlenbeck(n, THETA, lambda: sigma, 1.0, int(seeds[0]))
    recorder, nobody = Recorder(driver), np.full(n, np.nan)
    driver.seed(int(seeds[1]))
    try:
        for i in range(n):
            driver.reset(i)
        count = -(-steps // n)
        for k in range(count):
            actions = np.clip(driver.demonstrated_actions() + noise()[:, 0], -1.0, 1.0)
            recorder.choose(actions, nobody, np.full(n, Who.DEMONSTRATOR))
            driver.step(actions)
            recorder.stepped()
            for i in np.flatnonzero(driver.fleet.ended != kernel.RUNNING).tolist():
                driver.reset(i)
                noise.reset(i)
            if tick is not None:
                tick((k + 1) / count)
    finally:
        driver.close()
    return recorder.take()
