"""Derivatives of formulas follow from their declarations alone."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from steersman.config import components
from steersman.encoding import Layout
from steersman.features.base import Feature
from steersman.features.road import Waypoints
from steersman.kernels import encode as enc
from steersman.kernels import encode_slopes as kernel
from steersman.kernels import observe as obs
from steersman.kernels.formula import call

SPACING, DT, COUNT = 2.0, 0.05, 15
# Those of a joint action, which no algorithm with analytic gradients takes, are left out.
FEATURES: list[Feature] = [  # type: ignore[misc]
    each() for _, each in sorted(components("feature").items()) if not each.joint
]


def numbers(layout: Layout, memory: Any, row: Any) -> Any:
    """All features of a memory and an observation."""
    table = layout.table
    return np.array(
        [
            call(a, row, memory, table.own, own, cells, i)
            for a, i, own, cells in table.numbers.tolist()
        ]
    )


@pytest.mark.parametrize("feature", FEATURES, ids=lambda feature: feature.kind)
def test_every_features_slopes_are_its_differences(feature: Feature) -> None:
    layout = Layout((Waypoints(count=4), feature), SPACING, DT)
    rng = np.random.default_rng(0)
    memory = rng.normal(size=enc.memory_size(layout.table))
    memory[[enc.DT, enc.SPACING]] = DT, SPACING
    row = rng.normal(size=obs.O_PREVIEW + 2 * COUNT)
    weights = rng.normal(size=enc.feature_count(layout.table))
    work = kernel.scratch(layout.slopes, len(row))
    kernel.put(memory, row, work)
    adjoint = np.zeros(len(memory) + len(row))
    kernel.pull_features(layout.slopes, weights, work, adjoint)
    for k in range(len(adjoint)):
        if k in (enc.STARTED, enc.DT, enc.SPACING, enc.LAST_COMMAND, enc.BASE_COMMAND):
            continue
        if k in (enc.GAP, enc.RELATIVE_SPEED, enc.WISHED_GAP):  # data: pedals have no derivative
            continue
        ends = []
        for h in (1e-5, -1e-5):
            places = np.concatenate([memory, row])
            places[k] += h
            ends.append(weights @ numbers(layout, places[: len(memory)], places[len(memory) :]))
        assert adjoint[k] == pytest.approx((ends[0] - ends[1]) / 2e-5, rel=1e-6, abs=1e-6)
    assert not work[:, 1:][: len(adjoint)].any()


def test_only_what_a_formula_reads_is_tried() -> None:
    layout = Layout((Waypoints(count=4), *FEATURES), SPACING, DT)
    slopes = layout.slopes
    per_number = np.diff(slopes.first)[: len(layout.scale)]
    assert per_number.max() <= 7  # an acceleration: two waypoints, heading error, v_x, spacing
    assert slopes.reads.max() < enc.memory_size(layout.table) + obs.O_PREVIEW + 2 * COUNT
