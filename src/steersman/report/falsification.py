"""The page of a falsification: the mildest failure, each disturbance alone, what was tried."""

from __future__ import annotations

from collections.abc import Iterable
from importlib.util import find_spec
from pathlib import Path as FilePath

from steersman.report.article import (
    LinePlot,
    PlotLine,
    Section,
    Table,
    write_article,
)
from steersman.report.html import half_width
from steersman.report.scene import RoadGroup
from steersman.report.signals import ShownDrive
from steersman.report.tables import text
from steersman.report.view import ResultView, article_view
from steersman.studies.findings import FalsifyResult, MildestFailure, SingleFailure
from steersman.studies.hunt import MOST_GRIP
from steersman.studies.perturbation import Point

_MM = 1e3
_NAMES = {
    "mass": "mass and yaw inertia, factor",
    "friction": "tyre friction",
    "delay": "steering delay, added [s]",
    "waypoint_noise": "waypoint noise [m]",
    "speed": "speed, factor",
}
_SINGLE = {
    "name": "disturbance",
    "holds": "holds at",
    "fails": "fails at",
    "norm": "share of its range",
}
_PHRASES = {
    "mass": "mass x {}",
    "friction": "friction {}",
    "delay": "delay {} s more",
    "waypoint_noise": "waypoint noise {} m",
    "speed": "speed x {}",
}


def write_falsification(result: FalsifyResult, out: FilePath) -> bool:
    """Write the page, and its figure as a file into ``plots/`` beside it.

    Args:
        result: of the search.
        out: file of the page.

    Returns:
        Whether it was written: it needs the extra ``report``.

    Raises:
        DataError: the files cannot be written.
    """
    if find_spec("jinja2") is None:
        return False
    write_article(_sections(result), out, _title(result), replay=_replay(result))
    return True


def shown_falsification(result: FalsifyResult) -> ResultView:
    """What a falsification shows of itself: its page without the replay, which would drive."""
    return article_view(_sections(result), _title(result))


def _replay(result: FalsifyResult) -> list[RoadGroup]:
    """The mildest failure beside the drive that holds nearest to it."""
    from steersman.studies.falsify import driven_again

    drives = [
        ShownDrive(f"{one.what}: {_phrases(one.values.values(), one.point)}", one.episode)
        for one in driven_again(result)
    ]
    title = " and ".join(("the mildest failure", "the nearest drive that holds")[: len(drives)])
    return [RoadGroup(title.capitalize(), drives, half_width(drives))] if drives else []


def _title(result: FalsifyResult) -> str:
    return f"Falsification of {result.name}"


def _sections(result: FalsifyResult) -> list[Section]:
    mildest = result.mildest
    singles = Table("By bisection", single_rows(result), _SINGLE)
    sections = [
        Section(
            "The mildest failure",
            [*sentences(result), _explained(result)],
            tables=[_mildest(result, mildest)] if mildest else [],
        ),
        Section("One disturbance at a time", tables=[singles]),
        Section("What was tried", figures=[_figure(result)]),
    ]
    if not result.singles:
        del sections[1]
    return sections


def sentences(result: FalsifyResult) -> list[str]:
    """What was found, in words."""
    drives, name = len(result.drives), result.name
    spent = f"{drives} drives, {result.simulated_seconds:.0f} simulated seconds."
    within, radius = result.tried_within, text(result.safe_radius, 3)
    mildest = result.mildest
    if mildest is None:
        return [
            f"{name} did not fail in any of {within} drives, up to a norm of {radius}. That does"
            " not prove that it never does.",
            spent,
        ]
    end = mildest.end.replace("_", " ")
    if result.nominal_failed:
        share = result.grip_share or 0.0
        asks = f"; path and speeds ask an axle for {100 * share:.0f} % of its grip"
        asked = asks if share > MOST_GRIP else ""
        return [f"{name} fails without any disturbance: {end}{asked}.", spent]
    values = _phrases(mildest.values.values(), mildest.point)
    return [
        f"{name} fails at norm {radius} ({end}): {values}.",
        f"Safe radius {radius}: none of {within} milder drives failed. That does not prove that"
        " none can.",
        spent,
    ]


def _phrases(values: Iterable[float], point: Point) -> str:
    """The disturbances of a point in words; their values are in the point's order."""
    pairs = zip(point.items(), values, strict=True)
    words = [_PHRASES[name].format(text(value, 4)) for (name, u), value in pairs if u]
    return ", ".join(words) or "undisturbed"


def mildest_values(result: FalsifyResult) -> dict[str, str]:
    """The values of the mildest failure as text, by quantity."""
    mildest = result.mildest
    if mildest is None:
        return {}
    values = mildest.values.values()  # in the order of the point, with units in their names
    return {name: text(v, 4) for name, v in zip(mildest.point, values, strict=True)}


def single_rows(result: FalsifyResult) -> list[dict[str, str]]:
    """Each disturbance alone: ``name``, ``holds`` and ``fails``, values as text, ``norm``."""
    rows = []
    for one in result.singles:
        side = "" if one.name not in ("mass", "speed") else _side(one.holding_value, one)
        failing = one.failing
        rows.append(
            {
                "name": _NAMES[one.name] + side,
                "holds": text(one.holding_value, 4),
                "fails": _fails(one),
                "norm": "-" if failing is None else text(abs(failing), 3),
            }
        )
    return rows


def _fails(one: SingleFailure) -> str:
    if one.failing is not None:
        return text(one.failing_value, 4)
    return "not found; grip ends" if one.at_grip else "not found"


def _side(holding: float, one: SingleFailure) -> str:
    value = holding if one.failing_value is None else one.failing_value
    return ", more" if value > 1.0 else ", less"


def _explained(result: FalsifyResult) -> str:
    ranges = result.config["ranges"]
    return (
        "Each quantity is measured in shares of its range, and the norm is the Euclidean norm of"
        f" the shares: 1 is a mass {text(100 * ranges['mass'], 3)} % off, or a friction"
        f" coefficient of {text(ranges['friction'], 3)} (on a logarithmic scale), or"
        f" {text(ranges['delay'], 3)} s of delay, or waypoints shifted by up to"
        f" {text(ranges['waypoint_noise'], 3)} m, or speeds {text(100 * ranges['speed'], 3)} %"
        " off, alone; a range of 0 was left out. What would ask an axle for over 90 % of its grip"
        " (or for more than the undisturbed run does) was not driven: there the road is too fast"
        " for any controller. A search proves failures, never safety."
    )


def _mildest(result: FalsifyResult, mildest: MildestFailure) -> Table:
    rows = [
        {"quantity": _NAMES[name], "value": value, "share of its range": mildest.point[name]}
        for name, value in mildest_values(result).items()
    ]
    return Table("Its disturbance", rows)


def _figure(result: FalsifyResult) -> LinePlot:
    lines = []
    for name, failed in (("stayed on the road", False), ("failed", True)):
        rows = [row for row in result.drives if row.failed is failed]
        errors = [_MM * row.max_error_m for row in rows]
        lines.append(PlotLine(name, [row.norm for row in rows], errors, dots=3.0))
    return LinePlot(
        "tried",
        "Largest error of every drive",
        "norm of the disturbance [-]",
        "largest |lateral error| [mm]",
        lines,
        log=True,
    )
