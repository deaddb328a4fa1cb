"""Derivatives of formulas follow from their declarations alone."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from steersman.config import components
from steersman.encoding import Layout
from steersman.features.base import Feature
from steersman.features.past import LateralErrorIntegral, PastErrors
from steersman.features.road import Waypoints
from steersman.kernels import encode as enc
from steersman.kernels import encode_slopes as kernel
from steersman.kernels import observe as obs
from steersman.kernels.formula import call
from steersman.kernels.formula_slopes import hands_on, reads
from steersman.types import Observation

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


class _Branches(Feature):
    """Formulas that decide by what is known beforehand, and by what is not."""

    def value(self, seen: Observation, memory: Sequence[float], i: int) -> float:
        """Of the first number one side, of the others the other."""
        if i == 0:
            return seen.v_x
        return memory[i - 1] if i < 3 else seen.v_y * seen.v_x

    def advance(self, seen: Observation, memory: Sequence[float], i: int) -> float:
        """By what is seen."""
        return seen.steer if seen.v_x > 1.0 else memory[i]

    def begin(self, seen: Observation, i: int) -> float:
        """By branches within branches."""
        if i > 0:
            if i > 1:
                return seen.v_x
            return seen.v_y
        return seen.steer

    def remember(self, memory: Sequence[float], i: int) -> float:
        """By an index of its own."""
        i = (i + 1) % 2
        return memory[i]


def test_of_a_branch_that_is_known_beforehand_one_side_is_read() -> None:
    found, sizes = _Branches().formulas, (obs.O_PREVIEW, enc.CELLS, 4)
    value = [reads(found["value"], [], i, sizes) for i in range(4)]
    assert value == [
        [[obs.O_VX], [], []],
        [[], [], [0]],
        [[], [], [1]],
        [sorted([obs.O_VX, obs.O_VY]), [], []],
    ]
    assert [hands_on(found["value"], [], i) for i in range(4)] == [True, True, True, False]
    assert reads(found["advance"], [], 2, sizes)[2] == [2]
    assert not hands_on(found["advance"], [], 2)
    begin = [reads(found["begin"], [], i, sizes)[0] for i in range(3)]
    assert begin == [[obs.O_STEER], [obs.O_VY], [obs.O_VX]]
    assert all(hands_on(found["begin"], [], i) for i in (0, 2))
    assert reads(found["remember"], [], 0, sizes)[2] == [0, 1, 2, 3]
    assert not hands_on(found["remember"], [], 0)


def test_past_values_are_handed_on() -> None:
    layout = Layout((PastErrors(count=3), LateralErrorIntegral()), SPACING, DT)
    numbers, cells = np.split(layout.slopes.hands_on, [4])
    assert numbers.all()
    # Begin and remember of the errors; the integral adds something up.
    assert cells.reshape(4, 3).tolist() == [[True, False, True]] * 3 + [[False] * 3]
