"""Single drives of a benchmark: each controller's worst and median one, and those of each class."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from steersman.bench.replay import ShownCase
from steersman.bench.results import Summary
from steersman.report.article import LinePlot, PlotLine, Section, Table
from steersman.report.html import CORRIDOR
from steersman.report.scene import RoadGroup
from steersman.report.seen import recorded
from steersman.report.signals import GREY_DOTS, ShownDrive

_MM = 1e3
# What the cases of a kind are called where one chooses among them.
_KINDS = {"worst": "worst of each controller", "median": "median of each controller"}


def places(summary: Summary) -> dict[str, int]:
    """The rank of every controller, which is the number of its colour in every figure."""
    return {name: k for k, name in enumerate(summary.controllers)}


def replays(summary: Summary, cases: Sequence[ShownCase]) -> list[RoadGroup]:
    """The drives to replay: each controller's worst and median, the best one's first; classes."""
    rank, order = places(summary), list(_KINDS)
    of_one = [case for case in cases if case.which in _KINDS]
    of_one.sort(key=lambda case: (order.index(case.which), rank[case.controller]))
    of_class = [case for case in cases if case.which not in _KINDS]
    return [_group(case, rank) for case in (*of_one, *of_class)]


def _group(case: ShownCase, rank: Mapping[str, int]) -> RoadGroup:
    episodes = case.episodes
    alone = case.which in _KINDS
    drives = [
        ShownDrive(f"best there: {name}" if alone and name != case.controller else name, episode)
        for name, episode in episodes.items()
    ]
    width = float(recorded(drives[0].episode).get("corridor", CORRIDOR))
    title = f"{case.controller}: {case.scenario}" if alone else case.scenario
    kind = _KINDS[case.which] if alone else case.scenario.rsplit("/", 3)[1]
    return RoadGroup(title, drives, width, [rank[name] for name in episodes], kind)


def worst(summary: Summary, cases: Sequence[ShownCase]) -> list[Section]:
    """The section of the worst cases; none without them."""
    shown = [case for case in cases if case.which == "worst"]
    if not shown:
        return []
    rows = [
        {
            "controller": case.controller,
            "scenario": case.scenario,
            "ended by": case.end.replace("_", " "),
            **({"what was raised": case.error or ""} if any(c.error for c in shown) else {}),
            "RMS, charged [mm]": _MM * case.rms_m,
            "best there": case.best,
            "its RMS [mm]": _MM * case.best_rms_m,
        }
        for case in shown
    ]
    rank = places(summary)
    text = (
        "The scenario of each controller's largest error, but those beyond grip, driven once "
        "more: the road "
        "around the place where the drive ended early, or where the error was largest."
    )
    figures = [figure for k, case in enumerate(shown) for figure in _figures(case, k, rank)]
    return [
        Section(
            "Worst cases", [text], tables=[Table("Worst scenario of each", rows)], figures=figures
        )
    ]


def _figures(case: ShownCase, k: int, rank: Mapping[str, int]) -> list[LinePlot]:
    """The driven line on the road, and how far from it."""
    who = {
        "driven": (case.controller, rank[case.controller]),
        "best": (f"best: {case.best}", rank[case.best]),
        "path": ("path", GREY_DOTS),
    }
    lines, offsets = [], []
    if not (found := case.lines()):  # it failed before its first step
        return []
    for key, line in found.items():
        name, look = who[key]
        lines.append(PlotLine(name, line.x, line.y, look=look))
        if line.offset:
            offsets.append(PlotLine(name, line.along, line.offset, look=look))
    title = f"{case.controller}: {case.scenario.rpartition('/')[0]}"
    axes = ("distance driven [m]", "offset, left positive [m]")
    return [
        LinePlot(f"worst_{k}", title, "x [m]", "y [m]", lines, equal=True),
        LinePlot(f"offset_{k}", title, *axes, offsets),
    ]
