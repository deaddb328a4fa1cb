"""The worst and the median drive of every controller, driven once more to be shown."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from steersman.bench.drive import Row, drive
from steersman.bench.entrants import Entrant
from steersman.bench.suite import Scenario
from steersman.episode import Episode
from steersman.types import FloatArray

# What is shown of a drive: so far before and behind the place where it went wrong [m].
_BEFORE, _BEHIND = 90.0, 40.0


def worst_cases(
    rows: Sequence[Row], scenarios: Sequence[Scenario], entrants: Sequence[Entrant]
) -> list[dict[str, Any]]:
    """For each controller the scenario of its largest error, and who drove that one best.

    Returns:
        For each: ``which`` (``"worst"``), ``controller``, ``scenario``, ``end``, ``rms_m``,
        ``best`` and ``best_rms_m``; ``episodes``: by name, of the controller and of who was best;
        ``lines``: by ``driven``, ``best`` (another's, if there is a better one) and ``path``, x
        and y [m] around the place where the drive ended early, or where the error was largest;
        for who drove also ``along``, the distance driven, and ``offset`` from the path [m].
    """
    cases = _cases("worst", rows, scenarios, entrants)
    return [{**case, "lines": _lines(*case["episodes"].values())} for case in cases]


def median_cases(
    rows: Sequence[Row], scenarios: Sequence[Scenario], entrants: Sequence[Entrant]
) -> list[dict[str, Any]]:
    """For each controller a scenario that it drives neither well nor badly, for its measure.

    None for plants that are not embedded: every drive there takes the server's time.

    Returns:
        As :func:`worst_cases`, with ``which`` as ``"median"``, and without ``lines``.
    """
    if not all(scenario.run.plant.embedded for scenario in scenarios):
        return []
    return _cases("median", rows, scenarios, entrants)


def _cases(
    which: str, rows: Sequence[Row], scenarios: Sequence[Scenario], entrants: Sequence[Entrant]
) -> list[dict[str, Any]]:
    by_name = {s.name: s for s in scenarios}
    by_entrant = {e.name: e for e in entrants}
    cases = []
    for entrant in entrants:
        own = [row for row in rows if row["controller"] == entrant.name]
        own.sort(key=lambda row: (row["charged_rms_m"], -row["driven_share"]))
        if not own:
            continue
        row = own[-1] if which == "worst" else own[(len(own) - 1) // 2]
        rivals = [r for r in rows if r["scenario"] == row["scenario"]]
        best = min(rivals, key=lambda r: r["charged_rms_m"])
        scenario = by_name[row["scenario"]]
        cases.append(
            {
                "which": which,
                "controller": entrant.name,
                "scenario": scenario.name,
                "end": row["end"],
                "rms_m": row["charged_rms_m"],
                "best": best["controller"],
                "best_rms_m": best["charged_rms_m"],
                "episodes": {
                    one.name: drive(scenario, one)
                    for one in (entrant, by_entrant[best["controller"]])
                },
            }
        )
    return cases


def _lines(episode: Episode, other: Episode | None = None) -> Mapping[str, Any]:
    if not len(episode):
        return {}
    place = _place(episode)
    shown = {"driven": _driven(episode, place), "path": _path(episode, place)}
    if other is not None and len(other):
        # The better one has seen more of the road.
        shown |= {"best": _driven(other, place), "path": _path(other, place)}
    return shown


def _place(episode: Episode) -> float:
    """Distance driven where it went wrong [m]."""
    row = int(np.argmax(np.abs(episode["lateral_error"]))) if episode.completed else -1
    return float(_distance(episode)[row])


def _distance(episode: Episode) -> FloatArray:
    """Distance driven at each row [m]."""
    speed = np.hypot(episode["v_x"], episode["v_y"])
    return np.concatenate([[0.0], np.cumsum(speed[:-1] * episode.dt)])


def _driven(episode: Episode, place: float) -> dict[str, list[float]]:
    kept = _near(episode, place)
    line = _line(episode, "x", "y", kept)
    along = _distance(episode)[kept].round(2).tolist()
    return {**line, "along": along, "offset": episode["lateral_error"][kept].round(4).tolist()}


def _path(episode: Episode, place: float) -> dict[str, list[float]]:
    return _line(episode, "path_x", "path_y", _near(episode, place))


def _near(episode: Episode, place: float) -> Any:
    distance = _distance(episode)
    return (distance >= place - _BEFORE) & (distance <= place + _BEHIND)


def _line(episode: Episode, x: str, y: str, kept: Any) -> dict[str, list[float]]:
    return {"x": episode[x][kept].round(2).tolist(), "y": episode[y][kept].round(2).tolist()}
