"""From episodes to what the page plots: grouped by path, thinned, in shown units."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from steersman.bench.along import same_path
from steersman.episode import Episode
from steersman.report.runs import ReportRun
from steersman.types import FloatArray

# Okabe and Ito's palette without yellow and black, which vanish on white and on black.
PALETTE = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#7F7F7F")
DASHES = ("solid", "dash", "dot", "dashdot")
GREY_DOTS = 3 * len(PALETTE) - 1
"""The number of the look that paths have beside drives: grey and dotted."""


class PlotSignal(NamedTuple):
    """A panel over time: the column of the episode (or a name of its own), kept in steps."""

    key: str
    title: str
    unit: str
    values: Callable[[Episode], FloatArray]
    step: float
    shown: bool = True
    """Whether a page shows it at first."""
    column: str = "time"
    """A column of the episodes that have it."""


def signals_of(episodes: Iterable[Episode]) -> list[PlotSignal]:
    """The signals that at least one of the episodes has."""
    columns = set().union(*(episode.columns for episode in episodes))
    return [signal for signal in SIGNALS if signal.column in columns]


def values_of(signal: PlotSignal, episode: Episode) -> FloatArray:
    """A signal over an episode; NaN where it has none."""
    if signal.column in episode.columns:
        return signal.values(episode)
    return np.full(len(episode), np.nan)


SIGNALS = (
    PlotSignal("lateral_error", "lateral error", "mm", lambda e: 1e3 * e["lateral_error"], 0.01),
    PlotSignal(
        "heading_error", "heading error", "°", lambda e: np.degrees(e["heading_error"]), 1e-4
    ),
    PlotSignal("steer_command", "steering command", "-", lambda e: e["steer_command"], 1e-5),
    PlotSignal("speed", "speed", "m/s", lambda e: np.hypot(e["v_x"], e["v_y"]), 1e-3),
    PlotSignal("gap", "gap to the car ahead", "m", lambda e: e["gap"], 1e-2, column="gap"),
    PlotSignal("a_y", "lateral acceleration", "m/s²", lambda e: e["a_y"], 1e-3),
    PlotSignal(
        "course_error", "course error", "°", lambda e: np.degrees(e["course_error"]), 1e-4, False
    ),
    PlotSignal("steer", "steering, actual", "-", lambda e: e["steer"], 1e-5, False),
    PlotSignal("yaw_rate", "yaw rate", "°/s", lambda e: np.degrees(e["yaw_rate"]), 0.01, False),
    PlotSignal("a_x", "longitudinal acceleration", "m/s²", lambda e: e["a_x"], 1e-3, False),
    PlotSignal(
        "pedals", "throttle less brake", "-", lambda e: e["throttle"] - e["brake"], 1e-3, False
    ),
    PlotSignal("curvature", "path curvature", "1/m", lambda e: e["curvature"], 1e-5, False),
    PlotSignal(
        "control_time", "computing time", "µs", lambda e: 1e6 * e["control_time"], 0.1, False
    ),
)


def decimate(signals: Sequence[FloatArray], points: int) -> NDArray[np.intp]:
    """Rows to keep, about ``points`` of them: every n-th, and each signal's extremes.

    Half the budget goes to even steps, which keep shapes in the plane. The other half is shared
    among the signals: in every bucket the rows of the least and the largest value.
    """
    n = len(signals[0]) if signals else 0
    if n <= points:
        return np.arange(n)
    even = np.linspace(0, n - 1, max(points // 2, 2)).round().astype(np.intp)
    buckets = max(points // (4 * len(signals)), 1)
    edges = np.linspace(0, n, buckets + 1).astype(np.intp)[:-1]
    keep = [even, *(_extremes(np.nan_to_num(signal), edges) for signal in signals)]
    return np.unique(np.concatenate(keep))


def _extremes(values: FloatArray, edges: NDArray[np.intp]) -> NDArray[np.intp]:
    parts = np.split(np.arange(len(values)), edges[1:])
    rows = [(p[np.argmin(values[p])], p[np.argmax(values[p])]) for p in parts if p.size]
    return np.array(rows, dtype=np.intp).ravel()


class ShownDrive(NamedTuple):
    """A run that has an episode."""

    name: str
    episode: Episode
    waypoints: bool = True
    """Whether its waypoints are shown, which takes as long as driving to measure again."""


def group_by_path(runs: Sequence[ReportRun]) -> list[list[ShownDrive]]:
    """The runs with episodes, those on the same path together, in order of appearance."""
    groups: list[list[ShownDrive]] = []
    for run in runs:
        if run.episode is None:
            continue
        drive = ShownDrive(run.name, run.episode)
        for group in groups:
            if same_path(group[0].episode, drive.episode):
                group.append(drive)
                break
        else:
            groups.append([drive])
    return groups


def look(k: int) -> dict[str, str]:
    """Colour and dash of the k-th of several lines; all differ up to 28."""
    return {
        "color": PALETTE[k % len(PALETTE)],
        "dash": DASHES[k // len(PALETTE) % len(DASHES)],
    }
