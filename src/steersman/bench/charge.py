"""What a run that was not finished is charged: the corridor's half width for all that is left.

A controller that leaves the road early would otherwise be judged by the little that it drove.
"""

from __future__ import annotations

import math

import numpy as np

from steersman.episode import Episode
from steersman.rollout import RunConfig
from steersman.types import FloatArray


def driven_share(run: RunConfig, episode: Episode) -> float:
    """Share in [0, 1] of the planned time or distance that was driven; 1 if it was completed."""
    if episode.completed:
        return 1.0
    if run.duration is not None or (run.laps is None and run.path.closed):
        share = len(episode) * episode.dt / (60.0 if run.duration is None else run.duration)
    else:
        share = episode.distance / ((run.laps or 1.0) * run.path.length - _start(run))
    # Whoever failed has something left to be charged for.
    return min(max(share, 0.0), 1.0 - 1e-9)


def _start(run: RunConfig) -> float:
    return 0.0 if run.path.closed else run.start


def charged_rms(errors: FloatArray, share: float, corridor: float) -> float:
    """Root mean square of |d| over the plan [m]: driven for ``share``, else ``corridor``.

    >>> charged_rms(np.array([0.3, 0.4]), 1.0, 1.5) == math.sqrt(0.125)
    True
    >>> charged_rms(np.zeros(9), 0.75, 1.0)
    0.5
    """
    driven = float(np.mean(np.square(_bounded(errors, corridor)))) if errors.size else 0.0
    share = share if errors.size else 0.0
    return math.sqrt(share * driven + (1.0 - share) * corridor * corridor)


def charged_mean(errors: FloatArray, share: float, corridor: float) -> float:
    """Mean of |d| over the plan [m], charged in the same way."""
    driven = float(np.mean(_bounded(errors, corridor))) if errors.size else 0.0
    share = share if errors.size else 0.0
    return share * driven + (1.0 - share) * corridor


def charged_quantile(errors: FloatArray, share: float, corridor: float, q: float) -> float:
    """Quantile ``q`` in [0, 1] of |d| over the plan [m], charged in the same way."""
    if not errors.size or q > share:
        return corridor
    return float(np.quantile(_bounded(errors, corridor), min(q / share, 1.0)))


def _bounded(errors: FloatArray, corridor: float) -> FloatArray:
    """|d|, at most the corridor's half width; what is not finite counts as that."""
    size = np.abs(np.nan_to_num(errors, nan=corridor, posinf=corridor, neginf=corridor))
    return np.minimum(size, corridor)
