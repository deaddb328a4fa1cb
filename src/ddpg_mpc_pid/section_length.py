"""The section about rewards by the length of the training: so that one is not taken for the other.

Effects are ratios of geometric means of errors, those of a two-by-two factorial on a log scale.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ddpg_mpc_pid.page import interval, number
from ddpg_mpc_pid.plan import BY_LENGTH
from ddpg_mpc_pid.results import MethodResult, SeedInterval
from ddpg_mpc_pid.section_learning import method_row, over_steps
from ddpg_mpc_pid.statistics import bootstrap
from steersman import article


def _times(first: Any, last: Any) -> float:
    return float(np.exp(last.mean() - first.mean()))


def _over(a: Any, b: Any, c: Any, d: Any) -> float:
    return _times(c, d) / _times(a, b)


def effects(cells: Sequence[Sequence[float | None]]) -> dict[str, SeedInterval]:
    """Factors on the error, by what is changed.

    Args:
        cells: errors of the seeds, any unit: first reward short and whole, second short and whole.
    """
    a, b, c, d = (np.log([float(error) for error in cell if error]) for cell in cells)
    paper, finite = BY_LENGTH
    return {
        f"{finite} in place of {paper}, short training": bootstrap(_times, a, c),
        f"{finite} in place of {paper}, whole training": bootstrap(_times, b, d),
        f"a whole training in place of a short one, {paper}": bootstrap(_times, a, b),
        f"a whole training in place of a short one, {finite}": bootstrap(_times, c, d),
        "the last of these factors over the one before it": bootstrap(_over, a, b, c, d),
    }


def _sentence(what: str, found: SeedInterval) -> str:
    inside = found.low is None or found.high is None or found.low <= 1.0 <= found.high
    end = "; these seeds do not tell it from 1" if inside else ""
    return f"{what[0].upper()}{what[1:]}: {interval(found)} times{end}."


def length_section(methods: Mapping[str, MethodResult]) -> article.Section | None:
    """Two rewards, each after a short and after a whole training; None where one is missing."""
    names = [name for pair in BY_LENGTH.values() for name in pair]
    if not set(names) <= set(methods):
        return None
    chosen = [methods[name] for name in names]
    best = effects([one.best_mm for one in chosen])
    last = effects([one.last_mm for one in chosen])
    rows = [
        {"factor on the error": what, "smallest": interval(found), "last": interval(last[what])}
        for what, found in best.items()
    ]
    short, whole = (number(_steps(one)) for one in chosen[:2])
    title, error = "Rewards by the length of the training", "validation_error_mm"
    return article.Section(
        title,
        [
            "Ratios of geometric means over seeds. A short training is one of its own, whose "
            "learning rate falls by its own length. Until then it is the beginning of the whole "
            "one of its seed, so that a smallest error from that time is the same, and the "
            "intervals, which take all trainings for independent, are rather too wide. A whole one "
            "has more validations of which the smallest error is taken; the last error has no such "
            "choice. "
            f"Steps, with one update after each: {short} and {whole}."
        ],
        [article.PageFinding(None, _sentence(what, found)) for what, found in best.items()],
        [
            article.Table("Rewards and lengths", [method_row(one) for one in chosen]),
            article.Table("Effects", rows),
        ],
        [over_steps("lengths", title, "mm", chosen, error, True)],
    )


def _steps(method: MethodResult) -> float:
    return float(method.curves["validation_error_mm"].steps[-1])
