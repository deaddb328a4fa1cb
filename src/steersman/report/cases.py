"""Single drives of a benchmark: every controller's worst and median one, beside the best there."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from steersman.bench.replay import ShownCase
from steersman.bench.results import Summary
from steersman.report.html import CORRIDOR
from steersman.report.scene import RoadGroup
from steersman.report.seen import recorded
from steersman.report.signals import GREY_DOTS, ShownDrive

_MM = 1e3


def places(summary: Summary) -> dict[str, int]:
    """The rank of every controller, which is the number of its colour in every figure."""
    return {name: k for k, name in enumerate(summary.controllers)}


def replays(summary: Summary, cases: Sequence[ShownCase]) -> list[RoadGroup]:
    """The drives to replay: those of the best controller first, its worst before its median."""
    rank = places(summary)
    order = sorted(cases, key=lambda case: rank[case.controller])
    return [_group(case, rank) for case in order]


def _group(case: ShownCase, rank: Mapping[str, int]) -> RoadGroup:
    episodes = case.episodes
    drives = [
        ShownDrive(name if name == case.controller else f"best there: {name}", episode)
        for name, episode in episodes.items()
    ]
    width = recorded(drives[0].episode).get("corridor", CORRIDOR)
    title = f"{case.controller}, {case.which}: {case.scenario}"
    return RoadGroup(title, drives, float(width), [rank[name] for name in episodes])


def worst(summary: Summary, cases: Sequence[ShownCase]) -> list[dict[str, Any]]:
    """The section of the worst cases; none without them."""
    shown = [case for case in cases if case.which == "worst"]
    if not shown:
        return []
    columns = {
        "controller": "controller",
        "scenario": "scenario",
        "end": "ended by",
        "rms": "RMS, charged [mm]",
        "best": "best there",
        "best_rms": "its RMS [mm]",
    }
    rows = [
        {
            "controller": case.controller,
            "scenario": case.scenario,
            "end": case.end.replace("_", " "),
            "rms": _MM * case.rms_m,
            "best": case.best,
            "best_rms": _MM * case.best_rms_m,
        }
        for case in shown
    ]
    rank = places(summary)
    return [
        {
            "title": "Worst cases",
            "text": [
                "The scenario of each controller's largest error, driven once more: the road "
                "around the place where the drive ended early, or where the error was largest."
            ],
            "tables": [{"title": "Worst scenario of each", "columns": columns, "rows": rows}],
            "figures": [
                figure for k, case in enumerate(shown) for figure in _figures(case, k, rank)
            ],
        }
    ]


def _figures(case: ShownCase, k: int, rank: Mapping[str, int]) -> list[dict[str, Any]]:
    """The driven line on the road, and how far from it."""
    who = {
        "driven": (case.controller, rank[case.controller]),
        "best": (f"best: {case.best}", rank[case.best]),
        "path": ("path", GREY_DOTS),
    }
    found = {who[key]: line for key, line in case.lines().items()}
    looks = [{"name": name, "look": style} for name, style in found]
    lines = [{**one, "x": line.x, "y": line.y}
             for one, line in zip(looks, found.values(), strict=True)]  # fmt: skip
    offsets = [{**one, "x": line.along, "y": line.offset}
               for one, line in zip(looks, found.values(), strict=True) if line.offset]  # fmt: skip
    title = f"{case.controller}: {case.scenario.rpartition('/')[0]}"
    line = {"file": f"worst_{k}", "title": title, "x": "x [m]", "y": "y [m]", "equal": True}
    offset = {"file": f"offset_{k}", "title": title, "x": "distance driven [m]",
              "y": "offset, left positive [m]"}  # fmt: skip
    return [{**line, "lines": lines}, {**offset, "lines": offsets}]
