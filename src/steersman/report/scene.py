"""From episodes to what the page replays: roads, cars, drives and their signals, in a blob.

A page keeps every control step of its drives as long as they are no more than ``BUDGET`` in all
(a drive of 20 minutes at 20 Hz has 24 000). Beyond, the longest drives give up rows first: half of
what is left to them are even steps in time, the other half the extremes of every signal, so that
no peak is lost.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from steersman.bench.along import distance
from steersman.episode import Episode
from steersman.rendering import RoadLine, road_line
from steersman.report.marks import marks
from steersman.report.pack import Blob
from steersman.report.seen import path_of, vehicle_of, waypoints
from steersman.report.signals import PlotSignal, ShownDrive, decimate, look, signals_of, values_of
from steersman.types import FloatArray
from steersman.vehicles import Vehicle

# Control steps that a page keeps in all, and the least for one drive.
BUDGET, LEAST = 120_000, 300
# Coordinates of waypoints that a page keeps in all.
SEEN_BUDGET = 1_500_000
# Places, angles and waypoints are kept to this [m], [rad], [m].
_PLACE, _ANGLE, _SEEN = 1e-3, 2e-4, 1e-2
# From the path to the reach of waypoints, beyond which the end of a preview lies elsewhere [m].
_WHEEL_RADIUS, _WHEEL_WIDTH = 0.35, 0.22


class RoadGroup(NamedTuple):
    """Drives on the same road."""

    title: str
    drives: Sequence[ShownDrive]
    half_width: float
    """Of the corridor [m]."""
    looks: Sequence[int] | None = None
    """The number of each drive's colour and dash; in order where it is not given."""
    kind: str = ""
    """By which groups are chosen, where there are several kinds of them."""


def scenes(groups: Sequence[RoadGroup], blob: Blob, budget: int = BUDGET) -> list[dict[str, Any]]:
    """The groups as plain data; columns of numbers go into ``blob``."""
    lengths = [len(drive.episode) for group in groups for drive in group.drives]
    rows = iter(shares(lengths, budget))
    seen = SEEN_BUDGET * budget // BUDGET // max(len(lengths), 1)
    signals = signals_of(drive.episode for group in groups for drive in group.drives)
    return [
        _scene(group, [next(rows) for _ in group.drives], seen, signals, blob) for group in groups
    ]


def shares(lengths: Sequence[int], budget: int) -> list[int]:
    """Rows for each drive: all of the short ones', and for the long ones equally many.

    >>> shares([100, 5000, 9000], 7100)
    [100, 3500, 3500]
    """
    out = [0] * len(lengths)
    order = sorted(range(len(lengths)), key=lambda k: lengths[k])
    for place, k in enumerate(order):
        fair = max(budget // (len(order) - place), LEAST)
        out[k] = min(lengths[k], fair)
        budget -= out[k]
    return out


def _scene(
    group: RoadGroup, rows: Sequence[int], seen: int, signals: Sequence[PlotSignal], blob: Blob
) -> dict[str, Any]:
    episodes = [drive.episode for drive in group.drives]
    path = next((p for p in map(path_of, episodes) if p is not None), None)
    road = road_line(path) if path is not None else _driven_road(episodes)
    origin = [float(np.nan_to_num(v[:1]).sum()) for v in road]
    looks = group.looks or range(len(episodes))
    return {
        "title": group.title,
        "kind": group.kind,
        "half": group.half_width,
        "closed": bool(path is not None and path.closed),
        "origin": origin,
        "road": [blob.add(v - o, _PLACE) for v, o in zip(road, origin, strict=True)],
        "runs": [
            _run(drive, look(k), n, seen, origin, signals, blob)
            for drive, k, n in zip(group.drives, looks, rows, strict=True)
        ],
    }


def _driven_road(episodes: Sequence[Episode]) -> RoadLine:
    """The path beside the drive that saw most of it, one lap."""
    episode = max(episodes, key=lambda e: min(e.distance, e.path_length))
    s = distance(episode)
    kept = s - s[:1] <= episode.path_length * (1.0 + 1e-3)
    return RoadLine(episode["path_x"][kept], episode["path_y"][kept])


def _run(
    drive: ShownDrive,
    style: dict[str, str],
    count: int,
    seen: int,
    origin: Sequence[float],
    signals: Sequence[PlotSignal],
    blob: Blob,
) -> dict[str, Any]:
    episode = drive.episode
    values = [values_of(signal, episode) for signal in signals]
    found = marks(episode)
    rows = decimate(values, count)
    at_marks = np.array([m[k] for m in found for k in ("row", "until")], dtype=np.intp)
    rows = np.union1d(rows, at_marks)
    vehicle, known = vehicle_of(episode)
    return {
        "name": drive.name,
        **style,
        "end": episode.end.replace("_", " "),
        "completed": episode.completed,
        "dt": episode.dt,
        "kept": len(rows) == len(episode),
        "car": {**car_of(vehicle), "known": known},
        "columns": {
            **_place(episode, rows, origin, blob),
            **{
                s.key: blob.add(v[rows], s.step) for s, v in zip(signals, values, strict=True)
            },
        },
        "marks": [
            {**m, **{k: int(np.searchsorted(rows, m[k])) for k in ("row", "until")}} for m in found
        ],
        "seen": _seen(episode, rows, seen, blob) if drive.waypoints else None,
    }  # fmt: skip


def _place(
    episode: Episode, rows: NDArray[np.intp], origin: Sequence[float], blob: Blob
) -> dict[str, Any]:
    """Columns that place the car: time, distance, pose, tangent, directions, how it was decided."""
    tangent = episode["psi"] - episode["heading_error"]
    slip = np.arctan2(episode["v_y"], episode["v_x"])
    columns = {
        "time": (episode["time"], 1e-3),
        # The script searches in it, so it never falls.
        "along": (_rising(distance(episode)), 1e-2),
        "x": (episode["x"] - origin[0], _PLACE),
        "y": (episode["y"] - origin[1], _PLACE),
        "psi": (episode["psi"], _ANGLE),
        "tangent": (tangent, _ANGLE),
        "slip": (slip, _ANGLE),
        "wheel": (episode["wheel_angle"], _ANGLE),
        "status": (episode["status"], 1.0),
    }
    return {name: blob.add(values[rows], step) for name, (values, step) in columns.items()}


def _rising(values: FloatArray) -> FloatArray:
    known = np.where(np.isfinite(values), values, -np.inf)
    top = np.maximum.accumulate(known)
    return np.where(np.isfinite(top), top, 0.0)


def car_of(vehicle: Vehicle) -> dict[str, Any]:
    """What is drawn of a car [m]; lengths from the centre of mass, the body's middle mid-axle."""
    return {
        "lf": vehicle.l_f,
        "lr": vehicle.l_r,
        "track": vehicle.track_width,
        "length": vehicle.body_length,
        "width": vehicle.width,
        "ackermann": vehicle.ackermann,
        "wheel": [2.0 * _WHEEL_RADIUS, _WHEEL_WIDTH],
    }


def _seen(
    episode: Episode, rows: NDArray[np.intp], budget: int, blob: Blob
) -> dict[str, Any] | None:
    """Waypoints of as many of these rows as the budget allows, one column for each coordinate."""
    points = waypoints(episode, path_of(episode))
    if points is None or not len(points):
        return None
    size = points.shape[1] * 2
    every = max(-(-len(rows) * size // max(budget, size)), 1)
    kept = np.arange(0, len(rows), every)
    columns = points[rows[kept]].reshape(len(kept), size).T
    return {"count": points.shape[1], "every": every, "points": blob.add(columns, _SEEN)}
