"""Whether a delivered network answers as the one it was made from."""

from __future__ import annotations

import numpy as np

from steersman.delivery.graph import Network, Single, activated, normalised
from steersman.types import FloatArray

# Largest difference of an action that float64 and a careful float32 may have.
TOLERANCE = 1e-6
# Sizes of scaled features; a car at speed has about 0.1 to 1, 100 is where they are clipped.
SIZES = (0.0, 1e-42, 1e-30, 1e-10, 1e-4, 0.01, 0.1, 1.0, 10.0, 100.0, 1e4, 1e12, 1e30)


def random_features(scale: Single, count: int, seed: int = 0) -> Single:
    """Raw features (count, n), extremes included: every size, all sizes mixed, signed bounds."""
    rng = np.random.default_rng(seed)
    sizes = np.resize(np.array(SIZES), count)[:, None] * np.ones(scale.size)
    mixed = np.arange(count) % 4 == 3  # noqa: PLR2004 - every fourth row
    sizes[mixed] = 10.0 ** rng.uniform(-8.0, 4.0, (int(mixed.sum()), scale.size))
    rows = rng.normal(size=(count, scale.size)) * sizes / scale
    largest = np.arange(count) % 101 == 100  # noqa: PLR2004 - now and then, out of step
    limit = float(np.finfo(np.float32).max)
    rows[largest] = rng.choice([-limit, 0.0, limit], (int(largest.sum()), scale.size))
    return np.clip(rows, -limit, limit).astype(np.float32)


def rounding(network: Network, features: Single) -> FloatArray:
    """How far any float32 evaluation of a row may be from the exact action, to first order.

    The classical bound: a sum of n products errs by at most n u sum |w x|, and errors before are
    carried on by |w| (Higham, "Accuracy and Stability of Numerical Algorithms", 2002, sec. 3.1).
    """
    unit = float(np.finfo(np.float32).eps) / 2.0
    flow = normalised(network, features).astype(np.float64)
    error = np.zeros_like(flow)
    for layer in network.layers:
        weights = abs(layer.weights).T.astype(np.float64)
        size = abs(flow) @ weights + abs(layer.bias)
        error = error @ weights + (len(weights) + 1) * unit * size
        flow = flow @ layer.weights.T.astype(np.float64) + layer.bias
        flow = activated(layer.activation, flow)
        error = error + 4.0 * unit * abs(flow)
    bound: FloatArray = error.max(axis=1)
    return bound
