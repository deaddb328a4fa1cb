"""What a controller's drives cost beyond the oracle's."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from steersman.bench.oracle import OracleCost, cost
from steersman.bench.results import BenchRow, IntervalEstimate, Regret
from steersman.bench.statistics import Clusters


def clusters_of(rows: Sequence[BenchRow]) -> Clusters:
    """Draws of roads, and of what has the same name."""
    return Clusters([row.path for row in rows], [row.replicate for row in rows])


def regret(rows: Sequence[BenchRow], oracle: Mapping[str, OracleCost]) -> Regret | None:
    """A controller's regret over the rows whose scenario has an oracle's cost; None without any.

    Args:
        rows: the controller's.
        oracle: costs by the names of the scenarios.
    """
    kept = [row for row in rows if row.scenario in oracle]
    if not kept:
        return None
    least = np.array([oracle[row.scenario].total(row.dt_s) for row in kept])
    own = np.array(
        [cost(row.charged_rms_m, row.number("steer_change_rms"), row.dt_s) for row in kept]
    )
    clusters, beyond = clusters_of(kept), own - least
    return Regret(
        runs=len(kept),
        below=int(np.count_nonzero(beyond < 0.0)),
        oracle_m=float(least.mean()),
        mean_m=IntervalEstimate.of(clusters.interval(lambda mean: mean(beyond))),
        median_m=IntervalEstimate.of(clusters.median(beyond)),
    )
