"""The worst and the median drive of every controller, driven once more to be shown."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal, NamedTuple

import numpy as np

from steersman.bench.drive import drive
from steersman.bench.entrants import Entrant
from steersman.bench.results import BenchRow
from steersman.bench.suite import Scenario
from steersman.episode import Episode
from steersman.types import FloatArray

# What is shown of a drive: so far before and behind the place where it went wrong [m].
_BEFORE, _BEHIND = 90.0, 40.0


class DrivenLine(NamedTuple):
    """A stretch of a drive or of its path, in the plane [m]."""

    x: list[float]
    y: list[float]
    along: Sequence[float] = ()
    """Distance driven [m]; empty for a path."""
    offset: Sequence[float] = ()
    """Lateral error [m]; empty for a path."""


class ShownCase(NamedTuple):
    """A drive of a benchmark that is shown, beside the best one of the same scenario."""

    which: Literal["worst", "median"]
    controller: str
    scenario: str
    end: str
    rms_m: float
    best: str
    """The controller with the least error there."""
    best_rms_m: float
    episodes: dict[str, Episode]
    """By name, of the controller and of the best one."""

    def lines(self) -> dict[str, DrivenLine]:
        """Lines around the place where the drive ended early, or where its error was largest.

        Returns:
            ``driven``, ``best`` if there is a better controller, and ``path``.
        """
        episode, *others = self.episodes.values()
        if not len(episode):
            return {}
        place = _place(episode)
        shown = {"driven": _driven(episode, place), "path": _path(episode, place)}
        for other in others:
            if len(other):  # the better drive goes along more of the road
                shown |= {"best": _driven(other, place), "path": _path(other, place)}
        return shown


def worst_cases(
    rows: Sequence[BenchRow], scenarios: Sequence[Scenario], entrants: Sequence[Entrant]
) -> list[ShownCase]:
    """For each controller the scenario of its largest error."""
    return _cases("worst", rows, scenarios, entrants)


def median_cases(
    rows: Sequence[BenchRow], scenarios: Sequence[Scenario], entrants: Sequence[Entrant]
) -> list[ShownCase]:
    """For each controller the scenario of its median error.

    None for plants that are not computed here: every drive takes the server's time.
    """
    if not all(scenario.run.plant.computed for scenario in scenarios):
        return []
    return _cases("median", rows, scenarios, entrants)


def _cases(
    which: Literal["worst", "median"],
    rows: Sequence[BenchRow],
    scenarios: Sequence[Scenario],
    entrants: Sequence[Entrant],
) -> list[ShownCase]:
    by_name = {s.name: s for s in scenarios}
    by_entrant = {(e.name, e.replicate): e for e in entrants}
    cases = []
    for name in dict.fromkeys(e.name for e in entrants):
        own = [row for row in rows if row.controller == name]
        own.sort(key=lambda row: (row.charged_rms_m, -row.driven_share))
        if not own:
            continue
        row = own[-1] if which == "worst" else own[(len(own) - 1) // 2]
        rivals = [r for r in rows if r.scenario == row.scenario]
        best = min(rivals, key=lambda r: r.charged_rms_m)
        shown = [by_entrant[one.controller, one.replicate] for one in (row, best)]
        cases.append(
            ShownCase(
                which=which,
                controller=name,
                scenario=row.scenario,
                end=row.end,
                rms_m=row.charged_rms_m,
                best=best.controller,
                best_rms_m=best.charged_rms_m,
                episodes={one.name: drive(by_name[row.scenario], one) for one in shown},
            )
        )
    return cases


def _place(episode: Episode) -> float:
    """Distance driven where it went wrong [m]."""
    row = int(np.argmax(np.abs(episode["lateral_error"]))) if episode.completed else -1
    return float(_distance(episode)[row])


def _distance(episode: Episode) -> FloatArray:
    """Distance driven at each row [m]."""
    speed = np.hypot(episode["v_x"], episode["v_y"])
    return np.concatenate([[0.0], np.cumsum(speed[:-1] * episode.dt)])


def _driven(episode: Episode, place: float) -> DrivenLine:
    kept = _near(episode, place)
    along = _distance(episode)[kept].round(2).tolist()
    offset = episode["lateral_error"][kept].round(4).tolist()
    return _line(episode, "x", "y", kept)._replace(along=along, offset=offset)


def _path(episode: Episode, place: float) -> DrivenLine:
    return _line(episode, "path_x", "path_y", _near(episode, place))


def _near(episode: Episode, place: float) -> Any:
    distance = _distance(episode)
    return (distance >= place - _BEFORE) & (distance <= place + _BEHIND)


def _line(episode: Episode, x: str, y: str, kept: Any) -> DrivenLine:
    return DrivenLine(episode[x][kept].round(2).tolist(), episode[y][kept].round(2).tolist())
