"""Driving with the demonstrator's action at hand: samples for a network, and demonstrations."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import closing
from typing import Any, NamedTuple

import numpy as np

from steersman.errors import ConfigError
from steersman.kernels import observe
from steersman.kernels import world as kernel
from steersman.learning.datasets.recorder import Recorder
from steersman.learning.datasets.trajectory import Trajectory
from steersman.learning.fleet import FleetDriver
from steersman.learning.least_squares import Dataset
from steersman.learning.noise import OrnsteinUhlenbeck
from steersman.learning.problem import Problem

SIGMA = 0.1
"""Noise on the actions of demonstrations."""
_THETA = 0.15


class Drives(NamedTuple):
    """What was seen in a round of driving."""

    data: Dataset
    mean_error: float
    """Mean |lateral error| of all steps [m]."""
    off_track: int
    """Episodes that ended off the road or rolled over."""
    difference: float
    """RMS difference between the network's action and the demonstrator's in the states visited [-]:
    the error of the fit on samples that it has not seen. NaN without a network."""
    demonstrated: float
    """Share of the steps in which the demonstrator's action was executed."""


class Driving(NamedTuple):
    """How the actions of a round are chosen."""

    network: Callable[[Any], Any] | None
    """Maps features (n, k) to actions (n, m); None: there is none yet."""
    beta: float
    """Probability that the demonstrator's action is executed; drawn for each vehicle and step."""
    sigma: float
    """Noise on what is executed (Ornstein-Uhlenbeck, of the action's range)."""
    theta: float
    """Its return to zero per step."""


def collect(
    driver: FleetDriver,
    driving: Driving,
    steps: int,
    seeds: Sequence[int],
    tick: Callable[[float], None],
    recorder: Recorder | None = None,
) -> Drives:
    """Drive ``steps`` control steps with every vehicle, from new episodes on.

    The label of a state is the demonstrator's action there, whichever is executed.
    The same arguments collect the same samples.

    Args:
        driver: the vehicles.
        driving: how actions are chosen.
        steps: control steps of each vehicle.
        seeds: of the choice between network and demonstrator, of the noise, of the vehicles.
        tick: called with the share done.
        recorder: records every step as well.
    """
    fleet, n, wide = driver.fleet, driver.n, len(driver.problem.turned)
    rng = np.random.default_rng(int(seeds[0]))
    noise = OrnsteinUhlenbeck((n, wide), driving.theta, lambda: driving.sigma, 1.0, int(seeds[1]))
    driver.seed(int(seeds[2]))
    for i in range(n):
        driver.reset(i)
    features = np.empty((steps, n, fleet.inputs.shape[1]), np.float32)
    actions = np.empty((steps, n, wide), np.float32)
    error, off_track, squares, demonstrated = 0.0, 0, 0.0, 0
    for k in range(steps):
        labels = driver.demonstrated_actions()
        features[k], actions[k] = fleet.inputs, labels
        own, demonstrates = np.full((n, wide), np.nan), np.ones(n, dtype=bool)
        if driving.network is not None:
            own, demonstrates = driving.network(fleet.inputs), rng.random(n) < driving.beta
            squares += float(((own - labels) ** 2).mean(axis=1).sum())
        demonstrated += int(demonstrates.sum())
        chosen = np.where(demonstrates[:, None], labels, own)
        executed = np.clip(chosen + noise(), -1.0, 1.0)
        if recorder is not None:
            recorder.choose(executed, own, demonstrates)  # the demonstrator's number is one
        driver.step(executed)
        if recorder is not None:
            recorder.stepped()
        error += float(np.abs(fleet.tracking[:, observe.D]).sum())
        for i in np.flatnonzero(fleet.ended != kernel.RUNNING).tolist():
            off_track += int(fleet.ended[i]) in kernel.FAILED
            driver.reset(i)
            noise.reset(i)
        tick((k + 1) / steps)
    count = steps * n
    return Drives(
        Dataset(features.reshape(count, -1), actions.reshape(count, wide)),
        error / count,
        off_track,
        float("nan") if driving.network is None else (squares / count) ** 0.5,
        demonstrated / count,
    )


def demonstrate(
    problem: Problem,
    steps: int,
    seed: int,
    *,
    vehicles: int = 16,
    sigma: float = SIGMA,
    tick: Callable[[float], None] | None = None,
) -> list[Trajectory]:
    """Episodes of at least ``steps`` steps together, driven by the problem's demonstrator.

    Noise on what is executed shows how the demonstrator comes back (Laskey et al., DART, CoRL
    2017); the demonstrated actions are without it. The same arguments give the same episodes.

    Args:
        problem: roads, cars and demonstrator.
        steps: environment steps of all vehicles together.
        seed: of starts, speeds, cars, sensor errors and noise.
        vehicles: vehicles that drive at the same time where they are computed here.
        sigma: noise (Ornstein-Uhlenbeck), of the action's range.
        tick: called with the share done.

    Raises:
        ConfigError: the problem has no demonstrator.
    """
    if not problem.demonstration.enabled:
        raise ConfigError("is false; set it to true", ("problem", "demonstration", "enabled"))
    n = vehicles if problem.plant.computed else 1
    seeds = [0, *np.random.SeedSequence(seed).generate_state(2).tolist()]
    shown = Driving(network=None, beta=1.0, sigma=sigma, theta=_THETA)
    with closing(FleetDriver(problem, n)) as driver:
        recorder = Recorder(driver)
        collect(driver, shown, -(-steps // n), seeds, tick or (lambda _: None), recorder)
        return recorder.take()
