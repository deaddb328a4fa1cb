"""Performance profiles of a benchmark: how often each controller is within a factor of the best."""

from __future__ import annotations

from collections.abc import Sequence

from steersman.bench.results import Summary
from steersman.report.article import LinePlot, PlotLine, Section
from steersman.report.cases import places


def performance_profiles(summary: Summary) -> Section:
    """The section with the profiles."""
    found, title = summary.profiles, "Performance profiles"
    axes = ("factor of the best RMS error", "share of scenarios")
    looks = places(summary).items()
    lines = [
        PlotLine(name, *_stepped(found.factors, found.shares[name]), look=k) for name, k in looks
    ]
    text = (
        "The share of scenarios that a controller drives with at most so many times the error "
        "of the best in that scenario. At 1: how often it is the best itself; to the right: "
        "how many scenarios it completes at all within that factor."
    )
    return Section(title, [text], figures=[LinePlot("profiles", title, *axes, lines, log_x=True)])


def _stepped(x: Sequence[float], y: Sequence[float]) -> tuple[list[float], list[float]]:
    """The corners of a step function that takes each value at its place.

    >>> _stepped([1.0, 2.0], [0.3, 0.5])
    ([1.0, 2.0, 2.0], [0.3, 0.3, 0.5])
    """
    return [v for v in x for _ in "ab"][1:], [v for v in y for _ in "ab"][:-1]
