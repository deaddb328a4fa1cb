"""What the drives of a falsification show: the mildest failure and how much was tried below it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, ClassVar

from steersman.bench.grip import demanded_grip
from steersman.config import dump
from steersman.naming import names_of, recorded_name
from steersman.provenance import provenance
from steersman.stored import ShownResult, SourcedResult, StoredResult, optional
from steersman.studies.hunt import Bracket
from steersman.studies.perturbation import AXES, Point, norm, shown
from steersman.studies.tried import Tried
from steersman.table_file import Columns, columns_of

if TYPE_CHECKING:
    from steersman.studies.falsify import FalsifyConfig


class MildestFailure(Tried):
    """The failure with the smallest norm."""

    values: dict[str, float]
    """Physical values of the quantities, under names with their units."""


class SingleFailure(StoredResult):
    """A quantity disturbed alone, to one of its sides; None where nothing failed."""

    name: str
    failing: float | None
    """Smallest coordinate that was found to fail."""
    holding: float
    """Largest coordinate below it that was driven and does not fail."""
    failing_value: float | None
    holding_value: float
    unit: str
    """Of the two values."""
    at_grip: bool | None = optional()
    """Whether its range ended where the road at these speeds asks an axle for over 90 % of its
    grip."""


class FalsifyResult(ShownResult, SourcedResult):
    """The content of ``falsify.json``; its table has a row for each drive."""

    shown_by: ClassVar[str] = "steersman.report.falsification:shown_falsification"

    falsified: bool
    """Whether anything failed."""
    nominal_failed: bool
    """Whether the undisturbed drive failed."""
    mildest: MildestFailure | None
    safe_radius: float
    """Largest norm below which nothing that was tried failed; the farthest tried, if none did."""
    tried_within: int
    """Drives below it."""
    singles: list[SingleFailure]
    failures: int
    simulated_seconds: float
    ends: dict[str, int]
    """Failures by how the drives ended."""
    drives: list[Tried]
    """The nominal drive first."""
    grip_share: float | None = optional()
    """Largest share of grip that the undisturbed run asks of an axle."""
    config: dict[str, Any]
    plant: str
    names: dict[str, str] | None = optional()
    """What controller, path, speed and vehicle are called."""

    @property
    def name(self) -> str:
        """What the controller is called."""
        return recorded_name({"names": self.names, **self.config}, "controller")

    def nearest_holding(self) -> Tried | None:
        """The drive that holds nearest to the mildest failure; None where there is none."""
        if self.mildest is None:
            return None
        failed = self.mildest.point
        held = [row for row in self.drives if not row.failed]
        return min(held, key=lambda row: norm(_apart(row.point, failed)), default=None)

    def line(self) -> str:
        """The mildest failure, or that there was none."""
        found = "does not fail up to"
        if self.mildest is not None:
            found = f"fails ({self.mildest.end}) at"
        norm = self.safe_radius
        return f"FalsifyResult: {self.name} {found} norm {norm:.3g}, {len(self.drives)} drives"

    def table(self) -> Columns:
        """All drives, the nominal one first."""
        return columns_of(row.plain() for row in self.drives)


def _apart(one: Point, other: Point) -> Point:
    return {name: u - other[name] for name, u in one.items()}


def findings(
    config: FalsifyConfig, tried: Sequence[Tried], singles: Sequence[Bracket]
) -> FalsifyResult:
    """The result of a search from everything that was driven, the nominal drive first."""
    failed = [row for row in tried if row.failed]
    mildest = min(failed, key=lambda row: row.norm, default=None)
    radius = max(row.norm for row in tried) if mildest is None else mildest.norm
    ends = sorted({row.end for row in failed})
    return FalsifyResult(
        falsified=mildest is not None,
        nominal_failed=tried[0].failed,
        mildest=None if mildest is None else _described(mildest, config),
        safe_radius=radius,
        tried_within=sum(row.norm < radius or mildest is None for row in tried),
        singles=[_single(narrowed(one, tried), config) for one in singles],
        failures=len(failed),
        simulated_seconds=sum(row.seconds for row in tried),
        ends={end: sum(row.end == end for row in failed) for end in ends},
        drives=list(tried),
        grip_share=demanded_grip(config.run()),
        **provenance(),
        config=dump(config) or {},
        names=names_of(config),
        plant=config.plant.source(),
    )


def _described(row: Tried, config: FalsifyConfig) -> MildestFailure:
    values = config.ranges.values(row.point, config.run())
    return MildestFailure(**row.model_dump(), values=shown(values))


def narrowed(one: Bracket, tried: Sequence[Tried]) -> Bracket:
    """The bracket with what later drives of this quantity alone, to this side, have shown."""
    side = math.copysign(1.0, one.holding if one.failing is None else one.failing)
    alone = [
        (side * row.point[one.name], row.failed)
        for row in tried
        if side * row.point[one.name] > 0.0
        and not any(u for name, u in row.point.items() if name != one.name)
    ]
    fails = min((u for u, failed in alone if failed), default=math.inf)
    holds = max((u for u, failed in alone if not failed and u < fails), default=0.0)
    failing = side * fails if fails < math.inf else None
    return Bracket(one.name, failing, side * holds, one.at_grip)


def _single(one: Bracket, config: FalsifyConfig) -> SingleFailure:
    def value(coordinate: float) -> float:
        return config.ranges.values({one.name: coordinate}, config.run())[one.name]

    return SingleFailure(
        name=one.name,
        failing=one.failing,
        holding=one.holding,
        at_grip=one.at_grip or None,
        failing_value=None if one.failing is None else value(one.failing),
        holding_value=value(one.holding),
        unit=AXES[one.name].unit,
    )
