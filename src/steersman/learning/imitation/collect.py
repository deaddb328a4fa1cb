"""Samples of what a demonstrator does, in states that it or its pupil visits."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from steersman.kernels import observe
from steersman.kernels import world as kernel
from steersman.learning.fleet import FleetDriver
from steersman.learning.noise import OrnsteinUhlenbeck

_LOST = (kernel.LEFT_CORRIDOR, kernel.ROLLED)


class Dataset(NamedTuple):
    """What a network is fitted to, wherever it comes from."""

    features: Any
    """(n, k) float32, the network's input: scaled and clipped."""
    actions: Any
    """(n,) float32 in [-1, 1], what it should answer."""

    @classmethod
    def empty(cls, features: int) -> Dataset:
        """No samples yet."""
        return cls(np.zeros((0, features), np.float32), np.zeros(0, np.float32))

    def joined(self, other: Dataset) -> Dataset:
        """These samples, then the other's."""
        return Dataset(*(np.concatenate(pair) for pair in zip(self, other, strict=True)))


class Drives(NamedTuple):
    """What was seen in a round of driving."""

    data: Dataset
    mean_error: float
    """Mean |lateral error| of all steps [m]."""
    off_track: int
    """Episodes that ended off the road or rolled over."""
    difference: float
    """RMS difference between the pupil's action and the demonstrator's in the states visited [-]:
    the error of the fit on samples that it has not seen. NaN without a pupil."""
    demonstrated: float
    """Share of the steps in which the demonstrator's action was executed."""


class Driving(NamedTuple):
    """Who drives in a round."""

    pupil: Callable[[Any], Any] | None
    """Maps features (n, k) to actions (n,); None: there is none yet."""
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
    seed: np.random.SeedSequence,
    tick: Callable[[float], None],
) -> Drives:
    """Drive ``steps`` control steps with every vehicle, from new episodes on.

    The label of a state is the demonstrator's action in just that state, whoever acts next.
    ``tick`` is told the share done. The same arguments collect the same samples.
    """
    fleet, n = driver.fleet, driver.n
    seeds = seed.generate_state(3)
    rng = np.random.default_rng(int(seeds[0]))
    noise = OrnsteinUhlenbeck(n, driving.theta, lambda: driving.sigma, 1.0, int(seeds[1]))
    driver.seed(int(seeds[2]))
    for i in range(n):
        driver.reset(i)
    features = np.empty((steps, n, fleet.inputs.shape[1]), np.float32)
    actions = np.empty((steps, n), np.float32)
    error, off_track, squares, demonstrated = 0.0, 0, 0.0, 0
    for k in range(steps):
        labels = driver.demonstrated_actions()
        features[k], actions[k] = fleet.inputs, labels
        demonstrates = rng.random(n) < driving.beta
        chosen = labels
        if driving.pupil is not None:
            own = driving.pupil(fleet.inputs)
            squares += float(((own - labels) ** 2).sum())
            chosen = np.where(demonstrates, labels, own)
        demonstrated += int(demonstrates.sum()) if driving.pupil is not None else n
        driver.step(np.clip(chosen + noise()[:, 0], -1.0, 1.0))
        error += float(np.abs(fleet.tracking[:, observe.D]).sum())
        for i in np.flatnonzero(fleet.ended != kernel.RUNNING).tolist():
            off_track += int(fleet.ended[i]) in _LOST
            driver.reset(i)
            noise.reset(i)
        tick((k + 1) / steps)
    count = steps * n
    return Drives(
        Dataset(features.reshape(count, -1), actions.reshape(count)),
        error / count,
        off_track,
        float("nan") if driving.pupil is None else (squares / count) ** 0.5,
        demonstrated / count,
    )
