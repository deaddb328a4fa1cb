"""What is driven once more to be shown: each controller's worst and median, and each class."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal, NamedTuple

import numpy as np

from steersman.bench.apart import apart
from steersman.bench.drive import drive
from steersman.bench.entrants import Entrant
from steersman.bench.results import BenchRow
from steersman.bench.suite import Scenario
from steersman.episode import Episode
from steersman.types import FloatArray

# Drives that a page has of the classes' scenarios, all in all.
_MOST = 360
# What is shown of a drive: so far before and behind the place where it went wrong [m].
_BEFORE, _BEHIND = 90.0, 40.0
# Errors below this are nothing [m].
_LEAST_ERROR = 1e-6


class DrivenLine(NamedTuple):
    """A stretch of a drive or of its path, in the plane [m]."""

    x: list[float]
    y: list[float]
    along: Sequence[float] = ()
    """Distance driven [m]; empty for a path."""
    offset: Sequence[float] = ()
    """Lateral error [m]; empty for a path."""


class ShownCase(NamedTuple):
    """A drive of a benchmark that is shown, beside others of the same scenario."""

    which: Literal["worst", "median", "class"]
    """The controller's worst or median one; or the middle scenario of a class of disturbances."""
    controller: str
    """Whose case it is; of a class the best one there."""
    scenario: str
    end: str
    rms_m: float
    best: str
    """The controller with the least error there."""
    best_rms_m: float
    error: str | None
    """What its controller raised there."""
    episodes: dict[str, Episode]
    """By name: of the controller and of the best one, or of all that are shown of a class."""

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
    """For each controller the scenario of its largest error, of those that its figures count."""
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


def class_cases(
    rows: Sequence[BenchRow], scenarios: Sequence[Scenario], entrants: Sequence[Entrant]
) -> list[ShownCase]:
    """For each class of disturbances its middle scenario, driven by each controller.

    Middle by the mean of the logarithms of the errors there. Of many controllers those with the
    smallest errors over all scenarios, as many as the page has room for. None for plants that are
    not computed here.
    """
    if not all(scenario.run.plant.computed for scenario in scenarios):
        return []
    by_name = {s.name: s for s in scenarios}
    classes: dict[str, list[str]] = {}
    for scenario in scenarios:
        classes.setdefault(scenario.disturbance, []).append(scenario.name)
    out = apart(rows)
    counted = [row for row in rows if row.scenario not in out]
    first = {one.name: one for one in reversed(entrants)}
    known = {(row.scenario, row.controller): row for row in reversed(rows)}
    order = sorted(first, key=lambda name: _mean_square(counted, name))
    shown = order[: max(_MOST // len(classes), 2)]
    cases = []
    for names in classes.values():
        within = [name for name in names if name not in out] or names
        ranked = sorted(within, key=lambda name: _mean_log(rows, name))
        name = ranked[(len(ranked) - 1) // 2]
        own = [known[name, who] for who in shown if (name, who) in known]
        own.sort(key=lambda row: row.charged_rms_m)
        best = own[0]
        cases.append(
            ShownCase(
                which="class",
                controller=best.controller,
                scenario=name,
                end=best.end,
                error=best.error,
                rms_m=best.charged_rms_m,
                best=best.controller,
                best_rms_m=best.charged_rms_m,
                episodes={
                    row.controller: drive(by_name[name], first[row.controller]) for row in own
                },
            )
        )
    return cases


def _mean_square(rows: Sequence[BenchRow], controller: str) -> float:
    return float(np.mean([r.charged_rms_m**2 for r in rows if r.controller == controller]))


def _mean_log(rows: Sequence[BenchRow], scenario: str) -> float:
    errors = [r.charged_rms_m for r in rows if r.scenario == scenario]
    return float(np.mean(np.log(np.maximum(errors, _LEAST_ERROR))))


def _cases(
    which: Literal["worst", "median"],
    rows: Sequence[BenchRow],
    scenarios: Sequence[Scenario],
    entrants: Sequence[Entrant],
) -> list[ShownCase]:
    by_name = {s.name: s for s in scenarios}
    by_entrant = {(e.name, e.replicate): e for e in entrants}
    out, cases = apart(rows), []
    for name in dict.fromkeys(e.name for e in entrants):
        own = [row for row in rows if row.controller == name and row.scenario not in out]
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
                error=row.error,
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
