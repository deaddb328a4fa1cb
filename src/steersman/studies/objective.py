"""What a run costs in a tuning: its tracking error, smoothness and failure.

The cost of a run is its RMS lateral error [m] plus a price on the RMS steering rate; behind
another car also prices on the RMS of the gap's error and of the longitudinal jerk. A run that
ends early is charged the corridor's half width, and as much again for the share that it did not
drive. The cost of several runs is their mean. Beside the cost stand the two figures that it
trades for each other, as the benchmark defines them: pooled RMS error with failures charged, and
pooled steering activity.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from steersman.bench.drive import charged_rms, driven_share
from steersman.episode import Episode
from steersman.metrics.driving import rms_lateral_error, steer_change_rms
from steersman.metrics.following import rms_gap_error, rms_longitudinal_jerk
from steersman.rollout import RunConfig, attempt

# Share of a failed run that is charged at least, and of one that never got going.
_LEAST = 0.05
# The most that a command can change in a step, from one lock to the other.
_MOST_CHANGE = 2.0
# The error of a gap that is not known [m].
_FARTHEST = 100.0


class Prices(NamedTuple):
    """What costs beside the lateral error."""

    smoothness: float = 0.0
    """Price of the RMS steering rate [m s]."""
    gap: float = 0.0
    """Price of the RMS error of the gap to a car ahead [m/m]."""
    jerk: float = 0.0
    """Price of the RMS longitudinal jerk behind a car ahead [m/(m/s^3)]."""


class RunCost(NamedTuple):
    """A run's cost in its three parts, and its figures."""

    tracking: float
    """RMS lateral error while it drove, and the price of the gap's, weighted with the share driven
    [m]."""
    smoothness: float
    """Price of the RMS steering rate, and of jerk, weighted in the same way [m]."""
    failure: float
    """Charge for what was not driven [m]; 0 if the run reached its end."""
    rms_error: float
    """RMS lateral error over the plan [m], what was not driven at the corridor's half width."""
    steer_change: float
    """RMS change of the command from one control step to the next [-]."""
    failed: bool
    """Whether the run ended early."""
    seconds: float
    """Simulated time [s]."""

    @property
    def total(self) -> float:
        """The run's cost [m]."""
        return self.tracking + self.smoothness + self.failure


class TrialCost(NamedTuple):
    """Several runs together; names and units are those of the study's journal."""

    cost_m: float
    """Mean cost of the runs [m], the sum of the next three."""
    tracking_m: float
    smoothness_m: float
    failure_m: float
    rms_error_m: float
    """Root of the mean of the runs' squared RMS errors [m]."""
    steer_change_rms: float
    """Root of the mean of the runs' squared RMS changes of the command in a step [-]."""
    failures: int
    """Runs that ended early."""
    simulated_seconds: float
    """Simulated time of all runs [s]; the currency of a training's cost, too."""


def measure(config: RunConfig, prices: Prices) -> RunCost:
    """Drive one run; every figure is finite whatever the controller does.

    Args:
        config: the run.
        prices: of what costs beside the lateral error.

    Raises:
        ConfigError: the controller does not fit the run.
        PlantError: the plant failed.
    """
    return _priced(config, attempt(config).of_controller(), prices)


def _priced(config: RunConfig, episode: Episode, prices: Prices) -> RunCost:
    error = _finite(rms_lateral_error(episode), config.corridor)
    change = _finite(steer_change_rms(episode), _MOST_CHANGE)
    gap, jerk = 0.0, 0.0
    if config.lead is not None:
        gap = prices.gap * _finite(rms_gap_error(episode), _FARTHEST)
        jerk = prices.jerk * _finite(rms_longitudinal_jerk(episode), 0.0)
    left = 0.0
    if not episode.completed:
        left = min(max(1.0 - driven_share(config, episode), _LEAST), 1.0)
    return RunCost(
        tracking=(error + gap) * (1.0 - left),
        smoothness=(prices.smoothness * change / episode.dt + jerk) * (1.0 - left),
        failure=config.corridor * (1.0 + left) if left else 0.0,
        rms_error=charged_rms(
            episode["lateral_error"], driven_share(config, episode), config.corridor
        ),
        steer_change=change,
        failed=not episode.completed,
        seconds=len(episode) * episode.dt,
    )


def together(costs: Sequence[RunCost]) -> TrialCost:
    """The runs of one trial.

    >>> run = RunCost(0.1, 0.02, 0.0, 0.1, 0.03, False, 60.0)
    >>> round(together([run, run]).cost_m, 6), together([run, run]).simulated_seconds
    (0.12, 120.0)
    """
    table = np.array(costs, dtype=np.float64)
    tracking, smoothness, failure = np.mean(table[:, :3], axis=0).tolist()
    error, change = np.sqrt(np.mean(table[:, 3:5] ** 2, axis=0)).tolist()
    return TrialCost(
        tracking + smoothness + failure,
        *(tracking, smoothness, failure),
        error,
        change,
        sum(c.failed for c in costs),
        float(np.sum(table[:, 6])),
    )


def _finite(value: float, instead: float) -> float:
    return value if math.isfinite(value) else instead
