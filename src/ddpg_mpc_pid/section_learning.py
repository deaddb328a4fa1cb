"""The section about training methods."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from ddpg_mpc_pid.page import interval, number, percent, verdict
from ddpg_mpc_pid.plan import ALONE, FULL_METHOD, METHODS
from ddpg_mpc_pid.results import LearningCurves, MethodResult, StudyResult
from steersman import article

_CLAIMED = "both"
# Methods of which savings and spread are told in sentences.
_TOLD = (_CLAIMED, FULL_METHOD, "both_direct", "direct")
# What the paper's figure shows: the adaptive reward is a reward of its own.
_LOSSES = (("track", "tracking reward alone"), ("fixed", "demonstration reward, fixed"))
# A seed whose best error is above this has never driven [mm].
_LOST = 1000.0
# The largest error on the way to which a saving is reported [m].
_ASKED = 0.1


def _line(method: MethodResult, column: str) -> article.PlotLine:
    """A column over training: median and quartiles over seeds."""
    curve = method.curves[column]
    return article.PlotLine(method.label, curve.steps, curve.median, curve.low, curve.high)


def _against_time(method: MethodResult) -> article.PlotLine:
    error, clock = method.curves["validation_error_mm"], method.curves["seconds"].median
    count = min(len(error.median), len(clock))
    median, low, high = (values[:count] for values in (error.median, error.low, error.high))
    return article.PlotLine(method.label, clock[:count], median, low, high)


def over_steps(
    file: str, title: str, unit: str, methods: Iterable[MethodResult], column: str, log: bool
) -> article.LinePlot:
    """A column over training, a line for each method."""
    lines = [_line(method, column) for method in methods]
    return article.LinePlot(file, title, "environment steps", unit, lines, log)


def method_row(method: MethodResult) -> dict[str, Any]:
    """A row of the table of methods."""
    low, _, high = method.best_quartiles
    return {
        "method": method.label,
        "seeds": method.seeds,
        "diverged": method.diverged,
        "never drove": lost(method),
        "best error, IQM [mm]": interval(method.best_iqm),
        "its quartiles [mm]": f"{number(low)} to {number(high)}",
        "last error, IQM [mm]": interval(method.last_iqm),
        "mean over training, IQM [mm]": interval(method.mean_over_training_iqm),
        "off-track resets, median": _median(method.resets),
        "computing time, median [s]": _median(method.seconds),
    }


def _median(values: Sequence[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return float(np.median(known)) if known else None


def lost(method: MethodResult) -> int:
    """How many seeds have never driven."""
    return sum(best is None or best > _LOST for best in method.best_mm)


def learning_section(results: StudyResult) -> article.Section:
    """The paper's figure of losses, and what matters more: errors, resets, savings, spread."""
    learning = results.learning
    methods = {k: m for k, m in learning.methods.items() if not m.ablation}
    every = methods.values()
    direct = [name for name in methods if METHODS[name].direct]
    apart = direct if len(direct) > 1 else []
    figures = _curve_figures([m for k, m in methods.items() if k not in apart], "", "")
    if apart:
        figures += _curve_figures([methods[k] for k in apart], "_direct", ", direct action")
    for reward, words in _LOSSES:
        same = [m for m in every if m.reward == reward]
        if not same:
            continue
        for column, name in (("actor_loss", "Actor loss"), ("critic_loss", "Critic loss")):
            file, title = f"{column}_{reward}", f"{name}: {words}"
            figures.append(over_steps(file, title, name.lower(), same, column, False))
    return article.Section(
        "Training methods (the paper's figure of losses)",
        [
            "Median and quartiles over seeds. Losses stand together only where the reward is the "
            "same. The validation set are random roads that no training sees; a drive that "
            "fails is charged 1.5 m for its remaining time.",
            "Savings: 1 - (restricted mean with demonstration) / (restricted mean of DDPG alone). "
            "A seed that never gets to the error is charged all that the longest training spent, "
            "so a saving holds up to that horizon; how many seeds got there stands beside it. "
            "Where no seed of either got there, nothing is said.",
        ],
        [
            *_saving_findings(learning),
            *_spread_findings(learning),
            *_collapsed(learning.methods),
            *_smooth(methods),
        ],
        [article.Table("Methods", [method_row(m) for m in every]), _saving_table(learning)],
        figures,
    )


def _curve_figures(
    methods: Sequence[MethodResult], suffix: str, words: str
) -> list[article.LinePlot]:
    """Errors over steps and over time, and resets, a line for each method."""
    error, resets = "validation_error_mm", "off_track_resets"
    title = f"Mean error on the validation set{words}"
    clock = f"The same against computing time (wall time on a core of its own){words}"
    lines = list(map(_against_time, methods))
    return [
        over_steps(f"validation{suffix}", title, "mm", methods, error, True),
        article.LinePlot(f"validation_time{suffix}", clock, "s", "mm", lines, True),
        over_steps(
            f"resets{suffix}", f"Off-track resets so far{words}", "resets", methods, resets, False
        ),
    ]


def _saving_table(learning: LearningCurves) -> article.Table:
    rows = [
        {
            "mean error": f"{s.threshold_m} m",
            "method": learning.methods[s.method].label,
            "seeds that got there": f"{s.reached} of {s.seeds[1]}",
            "beside": learning.methods[s.alone].label,
            "there alone": f"{s.alone_reached} of {s.seeds[0]}",
            "steps saved [%]": interval(s.steps.saving, 100.0),
            "time saved [%]": interval(s.seconds.saving, 100.0),
            "resets saved [%]": interval(s.off_track_resets.saving, 100.0),
        }
        for s in learning.savings
    ]
    return article.Table("What the demonstration saves", rows)


def _told(method: str, alone: str) -> bool:
    """Whether sentences tell of it: DDPG alone has the same action."""
    return method in _TOLD and METHODS[method].direct == METHODS[alone].direct


def _saving_findings(learning: LearningCurves) -> list[article.PageFinding]:
    """The claim: training is accelerated. It holds where the interval lies above zero."""
    out = []
    for s in learning.savings:
        if not _told(s.method, s.alone) or s.threshold_m > _ASKED:
            continue
        label = learning.methods[s.method].label
        goal = f"On the way to {s.threshold_m} m"
        saving = s.steps.saving
        if saving is None:
            text = f"{goal}: no seed of '{label}' or of DDPG alone got there in this many steps."
            out.append(article.PageFinding(None, text))
            continue
        known = verdict(saving)
        end = {
            True: "the demonstration accelerates training",
            False: "the demonstration slows training down",
            None: "the interval holds zero, so these seeds do not decide it",
        }[known]
        others = ", ".join(
            f"{interval(getattr(s, cost).saving, 100.0)} % of {words}"
            for cost, words in (("seconds", "the time"), ("off_track_resets", "the resets"))
        )
        out.append(
            article.PageFinding(
                known,
                f"{goal} '{label}' saved {interval(saving, 100.0)} % of the steps, {others}; "
                f"{s.reached} of {s.seeds[1]} seeds got there, alone {s.alone_reached} "
                f"of {s.seeds[0]}: {end}.",
            )
        )
    return out


def _spread_findings(learning: LearningCurves) -> list[article.PageFinding]:
    """The claim: training is stabilised, read as a smaller spread over seeds."""
    out = []
    for s in learning.spread:
        if _told(s.method, s.alone):
            label = learning.methods[s.method].label
            text = (
                f"Interquartile range over seeds of the best error: {number(s.range_mm, 'mm')} "
                f"with '{label}' (median {number(s.median_mm, 'mm')}), "
                f"{number(s.alone_mm, 'mm')} alone (median "
                f"{number(s.alone_median_mm, 'mm')}); smaller by {interval(s.smaller_by)} mm "
                "(agrees: the interval lies above zero; note: it holds zero)."
            )
            out.append(article.PageFinding(verdict(s.smaller_by), text))
    return out


def _collapsed(methods: Mapping[str, MethodResult]) -> list[article.PageFinding]:
    """What the paper does not report: seeds that never learn to drive."""
    seeds = [f"{lost(m)} with '{m.label}'" for m in methods.values() if lost(m)]
    if not seeds:
        return []
    return [
        article.PageFinding(
            None,
            f"Seeds that never drove (best error over {_LOST / 1e3:g} m): {', '.join(seeds)}.",
        )
    ]


def _smooth(methods: Mapping[str, MethodResult]) -> list[article.PageFinding]:
    """The claim: with both parts the actor loss falls smoothly."""
    if not {ALONE, _CLAIMED} <= methods.keys():
        return []
    shares = []
    for name in (ALONE, _CLAIMED):
        steps = np.diff(methods[name].curves["actor_loss"].median)
        shares.append(float((steps > 0.0).mean()) if steps.size else None)
    alone, both = shares
    known = None if alone is None or both is None or alone == both else both < alone
    return [
        article.PageFinding(
            known,
            f"The median actor loss rose from one validation to the next in {percent(both)} of "
            f"the cases with both, in {percent(alone)} alone (the paper: smoother with both). A "
            "falling actor loss says that Q grows, not that the car drives better: see the errors.",
        )
    ]
