"""From episodes to what the page plots: grouped by path, decimated, rounded, in shown units."""

from __future__ import annotations

import html
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from steersman.bench.along import distance, same_path
from steersman.episode import Episode
from steersman.report.runs import Run
from steersman.types import FloatArray

# Okabe and Ito's palette without yellow and black, which vanish on white and on black.
PALETTE = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#7F7F7F")
DASHES = ("solid", "dash", "dot", "dashdot")
# Points a page may hold in all, and the least and most for one run.
BUDGET, LEAST, MOST = 90_000, 600, 4000


class Signal(NamedTuple):
    """A panel of the plots over time: its title and values, rounded to ``digits`` decimals."""

    key: str
    title: str
    values: Callable[[Episode], FloatArray]
    digits: int


SIGNALS = (
    Signal("lateral", "lateral error [mm]", lambda e: 1e3 * e["lateral_error"], 2),
    Signal("heading", "heading error [°]", lambda e: np.degrees(e["heading_error"]), 3),
    Signal("course", "course error [°]", lambda e: np.degrees(e["course_error"]), 3),
    Signal("steer", "steering command [-]", lambda e: e["steer_command"], 4),
    Signal("speed", "speed [m/s]", lambda e: np.hypot(e["v_x"], e["v_y"]), 3),
    Signal("a_y", "lateral acceleration [m/s²]", lambda e: e["a_y"], 2),
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


def rounded(values: FloatArray, digits: int) -> list[float | None]:
    """Values as JSON takes them: None where not finite, whole numbers without a point."""
    out = np.round(values, digits)
    return [
        None if not ok else int(v) if v == int(v) else v
        for v, ok in zip(out.tolist(), np.isfinite(out), strict=True)
    ]


class Drive(NamedTuple):
    """A run that has an episode."""

    name: str
    episode: Episode


def group_by_path(runs: Sequence[Run]) -> list[list[Drive]]:
    """The runs with episodes, those on the same path together, in order of appearance."""
    groups: list[list[Drive]] = []
    for run in runs:
        if run.episode is None:
            continue
        drive = Drive(run.name, run.episode)
        for group in groups:
            if same_path(group[0].episode, drive.episode):
                group.append(drive)
                break
        else:
            groups.append([drive])
    return groups


def plotted(groups: Sequence[Sequence[Drive]], corridors: Sequence[float]) -> list[dict[str, Any]]:
    """The data of all plots of drives; each group has a corridor of half that width [m]."""
    total = sum(len(group) for group in groups)
    points = int(np.clip(BUDGET // max(total, 1), LEAST, MOST))
    return [
        {
            "path": _path_lines([drive.episode for drive in group], corridor),
            "runs": [_trace(drive, k, points) for k, drive in enumerate(group)],
        }
        for group, corridor in zip(groups, corridors, strict=True)
    ]


def look(k: int) -> dict[str, str]:
    """Colour and dash of the k-th of several lines; all differ up to 28."""
    return {
        "color": PALETTE[k % len(PALETTE)],
        "dash": DASHES[k // len(PALETTE) % len(DASHES)],
    }


def _trace(drive: Drive, k: int, points: int) -> dict[str, Any]:
    episode = drive.episode
    values = {signal.key: signal.values(episode) for signal in SIGNALS}
    rows = decimate(list(values.values()), points)
    # The plotting library reads names as a small dialect of HTML.
    out: dict[str, Any] = {"name": html.escape(drive.name), **look(k)}
    out["time"] = rounded(episode["time"][rows], 3)
    out["distance"] = rounded(distance(episode)[rows], 2)
    for name in ("x", "y"):
        out[name] = rounded(episode[name][rows], 3)
    for signal in SIGNALS:
        out[signal.key] = rounded(values[signal.key][rows], signal.digits)
    return out


def _path_lines(episodes: Sequence[Episode], corridor: float) -> dict[str, Any]:
    """The path beside the run that saw most of it, and the corridor's edges."""
    episode = max(episodes, key=lambda e: min(e.distance, e.path_length))
    s = distance(episode)
    one_lap = s - s[:1] <= episode.path_length * (1.0 + 1e-3)
    kept = np.flatnonzero(one_lap) if s.size else np.arange(0)
    rows = kept[decimate([episode["path_x"][kept]], MOST)]
    x, y = episode["path_x"][rows], episode["path_y"][rows]
    tangent = episode["psi"][rows] - episode["heading_error"][rows]
    lines: dict[str, Any] = {"x": rounded(x, 3), "y": rounded(y, 3)}
    for side, d in (("left", corridor), ("right", -corridor)):
        lines[f"{side}_x"] = rounded(x - d * np.sin(tangent), 3)
        lines[f"{side}_y"] = rounded(y + d * np.cos(tangent), 3)
    return lines
