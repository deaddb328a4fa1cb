"""The ranking of a benchmark's page: a row for each controller, and what its intervals rest on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from steersman.bench.pairs import FEW_PATHS
from steersman.bench.results import ControllerSummary, IntervalEstimate, Summary
from steersman.episode import COLLISION
from steersman.metrics.following import GAP_AND_JERK
from steersman.report.article import Section, Table
from steersman.report.charts import IntervalPlot, ShownEstimate
from steersman.report.tables import interval_text, scaled, text

_GROUPS = {"all": "all scenarios", "clean": "clean", "disturbed": "disturbed"}
_PERCENT, _MM = 100.0, 1000.0


def ranking(summary: Summary, shown: str | None) -> Section:
    """The section; ``shown`` is which seed of each method the rows are, None for all."""
    found, best = summary.controllers, summary.best_classical
    figures = []
    for group, words in _GROUPS.items():
        errors = {name: one.errors(group).rms_m.scaled(_MM) for name, one in found.items()}
        title = f"RMS lateral error, {words}"
        figures.append(IntervalPlot(f"rms_{group}", title, "mm", _points(found, errors)))
    if best is not None:
        title = f"RMS error over that of {best}"
        ratios = {name: one.ratio["all"].rms for name, one in found.items() if one.ratio}
        figures.append(IntervalPlot("ratio", title, "ratio", _points(found, ratios)))
    rows = [_row(name, figures_of, best) for name, figures_of in found.items()]
    return Section(
        "Ranking",
        [
            f"{summary.scenarios} scenarios on {summary.paths} paths, the same for every "
            "controller. Errors are pooled: the root of the mean square over all scenarios, each "
            "of the same weight. A run that ends early is charged the corridor's half width for "
            "all that it did not drive.",
            "In brackets: 95 % intervals of a bootstrap in which whole paths are drawn, the same "
            "for every controller"
            + (
                ", and seeds of its tuning or training where it has several. "
                if shown is None
                else f". Of a method with several seeds this is the median one alone: {shown}. "
            )
            + "Typical is the geometric mean over the scenarios. Scenarios that ask for more grip "
            "than there is are counted in their own column alone."
            " A diamond marks a controller with a learned policy."
            + _regret_words(summary)
            + (
                " The typical ratio is the geometric mean over the scenarios, which hard ones do "
                "not dominate."
                if best
                else ""
            ),
        ],
        tables=[Table("Controllers, best first", rows)],
        figures=figures,
        warnings=_few_paths(found)
        + [said for name, one in found.items() if (said := one.failed_words(name))],
    )


def _regret_words(summary: Summary) -> str:
    known = next((one.regret for one in summary.controllers.values() if one.regret), None)
    if known is None:
        return ""
    return (
        " Regret is what a drive costs beyond the oracle's, which knows car, delay, road and"
        " future: RMS error plus 0.05 m s times the RMS steering rate. The oracle is optimised"
        f" on the plant itself. Its mean cost in {known.runs} drives:"
        f" {text(_MM * known.oracle_m, 3)} mm."
    )


def _few_paths(found: Mapping[str, ControllerSummary]) -> list[str]:
    """Which of the ranking's intervals rest on so few paths that they say little about others."""
    counts: dict[int, list[str]] = {}
    for group, words in _GROUPS.items():
        known = [n for one in found.values() if (n := one.errors(group).paths) is not None]
        if known and min(known) < FEW_PATHS:
            counts.setdefault(min(known), []).append(words)
    return [_few_words(count, words) for count, words in counts.items()]


def _few_words(count: int, what: Sequence[str]) -> str:
    where = f"{', '.join(what)}:"
    if count <= 1:
        return f"{where} all on one path, so there are no intervals over paths."
    return (
        f"{where} the intervals rest on only {count} paths, below {FEW_PATHS}: they are rough, "
        "and say little about other roads."
    )


def _row(name: str, found: ControllerSummary, best: str | None) -> dict[str, Any]:
    row = {
        "controller": name + (" (learned)" if found.learned else ""),
        **{
            f"RMS, {words} [mm]": interval_text(found.errors(group).rms_m, _MM)
            for group, words in _GROUPS.items()
        },
        "typical, disturbed [mm]": interval_text(found.disturbed.typical_m, _MM),
        "95 % of |d| [mm]": scaled(found.all.p95_m, _MM),
        "failed": f"{found.failures} of {found.runs}",
        "failed [%]": interval_text(found.all.lost_share, _PERCENT),
        "beyond grip": _beyond(found),
        **_regret(found),
        **measured(found, "steer_change_rms", "steering change [1/1000]", _MM),
        "reversals per minute": found.steer_reversals_per_min,
    }
    row |= _following(found)
    if best:
        ratio = None if found.ratio is None else found.ratio["all"]
        row[f"RMS over {best}'s"] = interval_text(None if ratio is None else ratio.rms)
        row["typical ratio"] = interval_text(None if ratio is None else ratio.typical)
    times = measured(found, "control_time_us_p50", "step time [us]")
    return row | times | {"p99 of it": text(found.control_time_us_p99, 3)}


def _following(found: ControllerSummary) -> dict[str, str]:
    """What tells of drives behind another car, if any was."""
    gap, jerk = map(found.figures.get, GAP_AND_JERK)
    if gap is None:
        return {}
    return {
        "collisions": f"{found.ends.get(COLLISION, 0)} of {found.runs}",
        "gap error, RMS [m]": interval_text(gap.rms),
        "jerk, RMS [m/s³]": "" if jerk is None else interval_text(jerk.rms),
    }


def measured(
    found: ControllerSummary, metric: str, words: str, factor: float = 1.0
) -> dict[str, Any]:
    """A metric's root mean square and median, with intervals."""
    known = found.figures.get(metric)
    return {
        f"{words}, {name}": "" if known is None else interval_text(getattr(known, key), factor)
        for name, key in (("RMS", "rms"), ("median", "median"))
    }


def _beyond(found: ControllerSummary) -> str:
    """Drives lost where more grip is asked for than there is."""
    return "" if found.beyond is None else f"{found.beyond.failures} of {found.beyond.runs}"


def _regret(found: ControllerSummary) -> dict[str, str]:
    """What drives cost beyond the oracle's, if any scenario has one."""
    known = found.regret
    if known is None:
        return {}
    return {
        "regret, mean [mm]": interval_text(known.mean_m, _MM),
        "median [mm]": interval_text(known.median_m, _MM),
    }


def _points(
    found: Mapping[str, ControllerSummary], values: Mapping[str, IntervalEstimate]
) -> list[ShownEstimate]:
    return [
        ShownEstimate(name, **values[name].model_dump(), look=k, diamond=one.learned)
        for k, (name, one) in enumerate(found.items())
    ]
