"""Sections about coefficients, and about what the paper leaves open."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ddpg_mpc_pid.plan import FULL_METHOD
from ddpg_mpc_pid.section_learning import COLUMNS, figure, line, method_row
from ddpg_mpc_pid.words import finding, interval, number, ratio

# Where c_track settles to the letter, and where the larger share begins.
_SETTLED, _HALF = 2.0 / 3.0, 0.5


def coefficient_section(results: Mapping[str, Any]) -> dict[str, Any]:
    """The paper's figure of c_track and c_diff."""
    methods = results["learning"]["methods"]
    shown = [methods[name] for name in (FULL_METHOD, "normalised") if name in methods]
    figures = [
        figure(
            column,
            f"{column} over training",
            "environment steps",
            "mean over the steps since the last validation",
            [line(m, column) for m in shown],
            False,
        )
        for column in ("c_track", "c_diff")
    ]
    findings = []
    for method in shown:
        track: Sequence[float] = method["curves"]["c_track"]["median"]
        if not track:
            continue
        agrees = track[0] > _HALF > track[-1]
        tenth = max(len(track) // 10, 1)
        first, last = float(np.mean(track[:tenth])), float(np.mean(track[-tenth:]))
        trend = "rises" if last > first + 0.01 else "falls" if last < first - 0.01 else "stays"
        findings.append(
            finding(
                agrees,
                f"'{method['label']}': c_track {trend} from {number(first)} to {number(last)}, "
                f"between {number(min(track))} and {number(max(track))} (the paper: first the "
                "larger share, later the smaller).",
            )
        )
    if FULL_METHOD in methods and methods[FULL_METHOD]["curves"]["c_track"]["median"]:
        last = methods[FULL_METHOD]["curves"]["c_track"]["median"][-1]
        findings.append(
            finding(
                None,
                "Why: S(r_diff) is 1/2 when agent and demonstrator agree and never less; "
                "S(r_track) tends to 1 as soon as the car tracks at speed (r_track is in m/s) and "
                "to 0 when it is lost. To the letter c_track therefore tends to 2/3 = "
                f"{number(_SETTLED)} for an agent that drives; measured at the end: "
                f"{number(last)}. It weighs how well the car drives, not how far it has learned.",
            )
        )
    return {
        "title": "Coefficients (the paper's figure of c_track and c_demo)",
        "text": ["Means over all vehicles and steps; median and quartiles over seeds."],
        "findings": findings,
        "figures": figures,
    }


def ablation_section(results: Mapping[str, Any]) -> dict[str, Any]:
    """What the paper leaves open, one by one against the full method."""
    methods = results["learning"]["methods"]
    full = methods.get(FULL_METHOD)
    chosen = {k: m for k, m in methods.items() if m["ablation"] or k in (FULL_METHOD, "direct")}
    findings = []
    for name, method in chosen.items():
        if full is None or name == FULL_METHOD:
            continue
        mine, base = method["best_iqm"], full["best_iqm"]
        factor = ratio(mine["value"], base["value"])
        apart = mine["high"] < base["low"] or mine["low"] > base["high"]
        findings.append(
            finding(
                None,
                f"'{method['label']}': best error {interval(mine)} mm against {interval(base)} mm "
                f"of the full method, {number(factor)} times; the intervals "
                f"{'are apart' if apart else 'overlap'}.",
            )
        )
    return {
        "title": "What the paper leaves open",
        "text": [
            "Each option alone against the full method (both, adaptive, indirect action). The "
            "validation drives are the same for all."
        ],
        "findings": findings,
        "tables": [
            {
                "title": "Options",
                "columns": COLUMNS,
                "rows": [method_row(m) for m in chosen.values()],
            }
        ],
        "figures": [
            figure(
                "ablations",
                "Mean error on the validation set",
                "environment steps",
                "mm",
                [line(m, "validation_error_mm") for m in chosen.values()],
                True,
            )
        ],
    }
