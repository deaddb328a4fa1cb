"""The report's sections as plain data: tables, figures, and sentences made from the numbers."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ddpg_mpc_pid.section_driving import (
    circle_section,
    monza_section,
    robustness_section,
)
from ddpg_mpc_pid.section_learning import learning_section
from ddpg_mpc_pid.section_mpc import away_section, timing_section
from ddpg_mpc_pid.section_options import ablation_section, coefficient_section

TITLE = "The paper's experiments on the embedded simulator"


def sections(results: Mapping[str, Any]) -> list[dict[str, Any]]:
    """All sections, from what ``results.json`` holds."""
    return [
        setup_section(results),
        learning_section(results),
        coefficient_section(results),
        circle_section(results["circle"]),
        robustness_section(results["robustness"]),
        monza_section(results["monza"]),
        away_section(results["away"]),
        timing_section(results["timing"]),
        ablation_section(results),
    ]


def setup_section(results: Mapping[str, Any]) -> dict[str, Any]:
    """What was run, and in what it differs from the published method."""
    plan = results["plan"]
    made = ", ".join(results["made_by"])
    return {
        "title": "What was run",
        "text": [
            f"{len(plan['trainings'])} trainings; made by commit {made}.",
            "The trainings are those of the preset 'paper' (where the paper is silent, "
            "Stable-Baselines3's defaults), with the departures below. Intervals are 95 % "
            "bootstrap intervals over seeds, each method resampled within itself; with so few "
            "seeds they are rough. IQM: interquartile mean over seeds. 'agrees' and 'differs' "
            "are decided by the rule that the sentence gives.",
        ],
        "tables": [
            {
                "title": "Departures from the preset",
                "columns": {"setting": "setting", "why": "why"},
                "rows": plan["departures"],
            }
        ],
    }
