"""The oracle: its drive is one that the plant makes, and no controller is expected to beat it."""

from __future__ import annotations

import math

import pytest

from steersman.bench.drive import measure
from steersman.bench.entrants import entrant
from steersman.bench.oracle import OracleCost, known, oracle, searched, short, stored
from steersman.bench.suite import Scenario
from steersman.bench.suites import suite

LQR = entrant("tuned/lqr")


def scenario(name: str) -> Scenario:
    """One of ``core``, cut to 8 s."""
    found = next(s for s in suite("core").scenarios() if s.name.startswith(name + "/"))
    return found._replace(run=found.run.model_copy(update={"duration": 8.0, "laps": None}))


@pytest.mark.parametrize("disturbance", ["clean", "delay_200ms", "friction_0.7"])
def test_it_costs_less_than_a_controller(disturbance: str) -> None:
    one = scenario(f"clothoid_0/changing/{disturbance}")
    found = oracle(one, LQR.controller)
    row = measure(one, LQR)
    own = OracleCost(row.charged_rms_m, row.number("steer_change_rms")).total(0.05)
    assert found is not None
    assert found.total(0.05) < 0.7 * own


def test_the_kernel_drives_as_a_rollout_does() -> None:
    """In side wind, on patches of ice, and late by a part of a control period."""
    whole = {each.name: each for each in suite("standard").scenarios()}
    for name in ("side_wind", "icy_edge", "mixed_1"):
        one = whole[f"clothoid_0/changing/{name}/carla_model3/0"]
        one = one._replace(run=one.run.model_copy(update={"duration": 6.0}))
        search = searched(one.run, LQR.controller)
        search.held = 0  # periods that are only shifted in time
        own = search.first["lateral_error"]
        assert search.replayed()[: len(own)] == pytest.approx(own, abs=1e-9)


def test_costs_are_found_by_all_that_a_scenario_is() -> None:
    one = suite("core").scenarios()[0]
    other = one._replace(run=one.run.model_copy(update={"duration": 7.0}))
    assert short(one) != short(other)
    assert not known([other])


def test_every_scenario_of_the_test_has_an_oracle() -> None:
    """But for some beyond grip, where no drive was found that stays on the road."""
    scenarios = suite("standard").scenarios()
    found = known(scenarios)
    assert {short(each) for each in scenarios} == set(stored().costs)
    without = {each.disturbance for each in scenarios if each.name not in found}
    assert all(name.endswith(("_beyond", "_floored")) for name in without)
    assert all(math.isfinite(one.total(0.05)) for one in found.values())
