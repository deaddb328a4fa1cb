"""The report's sections: tables, figures, and sentences made from the numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path as FilePath
from typing import Any

import numpy as np

from ddpg_mpc_pid.page import counted, interval, number, ratio
from ddpg_mpc_pid.plan import FULL_METHOD
from ddpg_mpc_pid.results import StudyResult
from ddpg_mpc_pid.section_driving import (
    circle_section,
    monza_section,
    robustness_section,
)
from ddpg_mpc_pid.section_learning import learning_section, method_row, over_steps
from ddpg_mpc_pid.section_length import length_section
from ddpg_mpc_pid.section_mpc import away_section, timing_section
from steersman import article

TITLE = "The paper's experiments on the embedded simulator"
# Where c_track settles to the letter, and where the larger share begins.
_SETTLED, _HALF = 2.0 / 3.0, 0.5
_SMOKE = (
    "A smoke run (--quick): it shows that every stage runs. Trainings and drives are far too short "
    "to say anything about a method, so the figures on this page mean nothing, and nothing is "
    "concluded from them."
)


def sections(results: StudyResult) -> list[article.Section]:
    """All sections, from what ``results.json`` holds; those of a smoke run conclude nothing."""
    made = [
        setup_section(results),
        learning_section(results),
        length_section(results.learning.methods),
        coefficient_section(results),
        circle_section(results.circle),
        robustness_section(results.robustness),
        monza_section(results.monza),
        away_section(results.away),
        timing_section(results.timing),
        ablation_section(results),
    ]
    there = [section for section in made if section is not None]
    return [section._replace(findings=[]) for section in there] if _smoke(results) else there


def _smoke(results: StudyResult) -> bool:
    """Whether its trainings were cut down until they only show that everything runs."""
    return bool(_cuts(results.plan))


def _cuts(plan: Mapping[str, Any]) -> list[str]:
    """Settings beside the departures, which records of the first version hold among them."""
    known = {row["setting"] for row in plan["departures"]}
    return [word for word in plan["words"] if word not in known]


def _departures(plan: Mapping[str, Any]) -> list[dict[str, str]]:
    """What was set over the preset, with reasons; settings of a smoke run come last and win."""
    rows = [*plan["departures"], *({"setting": w, "why": "smoke run"} for w in _cuts(plan))]
    return list({row["setting"].partition("=")[0]: row for row in rows}.values())


def write_page(results: StudyResult, out: FilePath) -> FilePath:
    """Write the page of the study, its figures into ``plots`` and its tables into ``tables``.

    Raises:
        SteersmanError: the extra ``report`` is not installed.
        DataError: the files cannot be written.
    """
    source = f"Commit {', '.join(results.made_by)}."
    made = sections(results)
    article.write_tables(made, out.parent / "tables")
    return article.write_article(made, out, TITLE, source)


def setup_section(results: StudyResult) -> article.Section:
    """What was run, and in what it differs from the published method."""
    plan = results.plan
    made, departures = ", ".join(results.made_by), _departures(plan)
    differs = "with the departures below" if departures else "with nothing else set"
    return article.Section(
        "What was run",
        [
            f"{counted(len(plan['trainings']), 'training')}; made by commit {made}.{_joined(plan)}",
            "The trainings are those of the preset 'paper' (where the paper is silent, "
            f"Stable-Baselines3's defaults), {differs}. Intervals are 95 % "
            "bootstrap intervals over seeds, each method resampled within itself; with so few "
            "seeds they are rough. IQM: interquartile mean over seeds. 'agrees' and 'differs' "
            "are decided by the rule that the sentence gives.",
        ],
        tables=[
            article.Table("Departures from the preset", departures),
            article.Table(
                "Parts",
                [
                    {"methods": ", ".join(one["methods"]), "made by": ", ".join(one["made_by"])}
                    for one in plan.get("parts", ())
                ],
            ),
        ],
        warnings=[_SMOKE] if _smoke(results) else [],
    )


def _joined(plan: Mapping[str, Any]) -> str:
    """That a study was put together, and where its drives are from."""
    if "parts" not in plan:
        return ""
    return (
        " Put together from the parts below: methods are compared over all of them, from figures "
        "that are rounded to four digits; robustness, Monza, MPC-PID away from home and computing "
        "times are those of one part, that with the full method if there is one."
    )


def coefficient_section(results: StudyResult) -> article.Section:
    """The paper's figure of c_track and c_diff."""
    methods = results.learning.methods
    shown = [methods[name] for name in (FULL_METHOD, "normalised") if name in methods]
    unit = "mean over the steps since the last validation"
    figures = [
        over_steps(column, f"{column} over training", unit, shown, column, False)
        for column in ("c_track", "c_diff")
    ]
    findings = []
    for method in shown:
        track: Sequence[float] = method.curves["c_track"].median
        if not track:
            continue
        agrees = track[0] > _HALF > track[-1]
        tenth = max(len(track) // 10, 1)
        first, last = float(np.mean(track[:tenth])), float(np.mean(track[-tenth:]))
        trend = "rises" if last > first + 0.01 else "falls" if last < first - 0.01 else "stays"
        findings.append(
            article.PageFinding(
                agrees,
                f"'{method.label}': c_track {trend} from {number(first)} to {number(last)} "
                "(means of its first and last tenth), "
                f"between {number(min(track))} and {number(max(track))} (the paper: first the "
                "larger share, later the smaller).",
            )
        )
    if FULL_METHOD in methods and methods[FULL_METHOD].curves["c_track"].median:
        last = methods[FULL_METHOD].curves["c_track"].median[-1]
        findings.append(
            article.PageFinding(
                None,
                "Why: S(r_diff) is 1/2 when agent and demonstrator agree and never less; "
                "S(r_track) tends to 1 as soon as the car tracks at speed (r_track is in m/s) and "
                "to 0 when it is lost. To the letter c_track therefore tends to 2/3 = "
                f"{number(_SETTLED)} for an agent that drives; measured at the last validation: "
                f"{number(last)}. It weighs how well the car drives, not how far it has learned.",
            )
        )
    return article.Section(
        "Coefficients (the paper's figure of c_track and c_demo)",
        ["Means over all vehicles and steps; median and quartiles over seeds."],
        findings,
        figures=figures,
    )


def ablation_section(results: StudyResult) -> article.Section:
    """What the paper leaves open, one by one against the full method."""
    methods = results.learning.methods
    full = methods.get(FULL_METHOD)
    chosen = {k: m for k, m in methods.items() if m.ablation or k in (FULL_METHOD, "direct")}
    findings = []
    for name, method in chosen.items():
        if full is None or name == FULL_METHOD:
            continue
        mine, base = method.best_iqm, full.best_iqm
        factor = ratio(mine.value, base.value)
        findings.append(
            article.PageFinding(
                None,
                f"'{method.label}': best error {interval(mine)} mm against {interval(base)} mm "
                f"of the full method, {number(factor)} times; the intervals "
                f"{'are apart' if mine.apart(base) else 'overlap'}.",
            )
        )
    title, error = "Mean error on the validation set", "validation_error_mm"
    return article.Section(
        "What the paper leaves open",
        [
            "Each option alone against the full method (both, adaptive, indirect action). The "
            "validation drives are the same for all."
        ],
        findings,
        [article.Table("Options", [method_row(m) for m in chosen.values()])],
        [over_steps("ablations", title, "mm", chosen.values(), error, True)],
    )
