"""What the drives of a falsification show: the mildest failure and how much was tried below it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from steersman.provenance import provenance
from steersman.rollout import RunConfig
from steersman.studies.perturbation import AXES, Ranges, shown
from steersman.studies.tried import Tried


def findings(
    ranges: Ranges,
    run: RunConfig,
    tried: Sequence[Tried],
    singles: Sequence[Mapping[str, Any]],
) -> dict[str, Any]:
    """The content of ``falsify.json``, its configuration apart.

    Args:
        ranges: how far was disturbed.
        run: the undisturbed one.
        tried: everything that was driven, the nominal first.
        singles: of :meth:`steersman.studies.hunt.Search.singles`.

    Returns:
        ``falsified``: whether anything failed; ``mildest``: the failure with the smallest norm
        (None without one) with coordinates and physical values; ``safe_radius``: the largest norm
        below which nothing that was tried failed, without a failure that of the farthest point
        tried; ``tried_within``: drives below it; ``singles``: each quantity alone, with failing
        and holding values; ``drives``: all of them; ``simulated_seconds``; versions and commit.
    """
    failed = [row for row in tried if row.failed]
    mildest = min(failed, key=lambda row: row.norm, default=None)
    radius = max(row.norm for row in tried) if mildest is None else mildest.norm
    within = sum(row.norm < radius or mildest is None for row in tried)
    return {
        "falsified": mildest is not None,
        "nominal_failed": tried[0].failed,
        "mildest": None if mildest is None else _described(mildest, ranges, run),
        "safe_radius": radius,
        "tried_within": within,
        "singles": [_single(one, ranges, run) for one in singles],
        "failures": len(failed),
        "simulated_seconds": sum(row.seconds for row in tried),
        "ends": {end: sum(r.end == end for r in failed) for end in sorted({r.end for r in failed})},
        "drives": [row._asdict() for row in tried],
        **provenance(),
    }


def _described(row: Tried, ranges: Ranges, run: RunConfig) -> dict[str, Any]:
    values = ranges.values(row.point, run)
    return {**row._asdict(), "values": shown(values)}


def _single(one: Mapping[str, Any], ranges: Ranges, run: RunConfig) -> dict[str, Any]:
    name = str(one["name"])
    values = {
        f"{key}_value": None if one[key] is None else ranges.values({name: one[key]}, run)[name]
        for key in ("failing", "holding")
    }
    return {**one, **values, "unit": AXES[name].unit}
