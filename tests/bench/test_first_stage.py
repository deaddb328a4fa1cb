"""The first stage's suite stays what it was, so that its figures can be compared."""

from __future__ import annotations

import hashlib
import json
from typing import Any

from steersman.bench.first_stage import core_1, standard_1
from steersman.bench.suite import Scenario
from steersman.config import dump

# Of all names and plans of ``standard``, without controllers, at commit 9d5b14a.
DIGEST = "1286273df496f7aa90cb1fa45f9744bf11bf6fb0751bf95de1a5841a5465fdf6"
# Fields that came later, and what they have to be for a scenario to be the old one.
LATER: dict[str, Any] = {
    **dict.fromkeys(("fault", "estimator", "predictor", "lead")),
    "disturbances": [],
}
LATER_OF_SENSOR = {"latency": 0.0, "v_y_noise": None}
LATER_OF_SPEED = {"end": None, "acceleration": None}
LATER_OF_VEHICLE = {
    "map_drag_area": 0.33,
    "roll_arm": None,
    "rotating_mass": 0.0,
    "stiffness_load_limit": None,
}


def without(data: dict[str, Any], later: dict[str, Any]) -> dict[str, Any]:
    for name, neutral in later.items():
        assert data.pop(name) == neutral, name
    return data


def old_plan(scenario: Scenario) -> dict[str, Any]:
    """The scenario's plan in the words of the first stage."""
    plan = without(dump(scenario.run) or {}, LATER)
    del plan["controller"]
    without(plan["sensor"], LATER_OF_SENSOR)
    without(plan["speed"], LATER_OF_SPEED)
    assert plan["start"] == {"s": 0.0, "offset": 0.0, "heading": 0.0}
    plan["start"] = 0.0
    for name in ("vehicle", "nominal"):
        if plan[name] is not None:
            assert without(plan[name], LATER_OF_VEHICLE)["kind"] == "carla_model3_v1"
            plan[name]["kind"] = "carla_model3"
    return plan


def test_its_scenarios_are_what_they_were() -> None:
    found = [[scenario.name, old_plan(scenario)] for scenario in standard_1().scenarios()]
    assert len(found) == 1515
    assert hashlib.sha256(json.dumps(found, sort_keys=True).encode()).hexdigest() == DIGEST


def test_its_core_is_a_part_of_it() -> None:
    whole = {scenario.name: scenario for scenario in standard_1().scenarios()}
    part = core_1().scenarios()
    assert len(part) == 315
    assert all(whole[scenario.name] == scenario for scenario in part)
