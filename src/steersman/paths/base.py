"""What all paths share: a table of clothoid pieces, evaluation and projection."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Mapping
from functools import cached_property
from typing import Any, NamedTuple, Self

from pydantic import ConfigDict

from steersman.config import Built, Component, Settings, param
from steersman.kernels import path as kernel
from steersman.kernels.path import PathTable
from steersman.types import FloatArray, PathPoint, Pose, Surface


class Corner(NamedTuple):
    """A named stretch of a path."""

    name: str
    s_start: float
    """Arc length where it begins [m]."""
    s_end: float
    """Arc length where it ends [m]."""


class PathComponent(Component):
    """A path: its configuration, and, built when first used, its geometry."""

    model_config = ConfigDict(frozen=True, extra="forbid", validate_default=True)

    @abstractmethod
    def build_table(self) -> PathTable:
        """The pieces of the path; called once."""

    @cached_property
    def geometry(self) -> Built[PathTable]:
        """What was built when first used."""
        return Built(self.build_table())

    @property
    def table(self) -> PathTable:
        """The path as pieces of linear curvature, one path in the table."""
        return self.geometry.value

    @property
    def length(self) -> float:
        """Arc length [m]."""
        return float(self.table.meta[0, kernel.LENGTH])

    @property
    def closed(self) -> bool:
        """Whether the end joins the start."""
        return bool(self.table.meta[0, kernel.CLOSED])

    def at(self, s: float) -> PathPoint:
        """Point at arc length s [m]; closed paths wrap, open ones go on straight."""
        return PathPoint(*kernel.at(self.table, 0, float(s)))

    def project(self, x: float, y: float, near: float | None = None) -> tuple[float, float]:
        """Arc length s and signed lateral offset d (left positive) of the closest point [m].

        Without ``near`` the whole path is searched; with it, downhill from that arc length,
        so that the right branch is found where a path crosses itself.
        """
        if near is None:
            s, d = kernel.project(self.table, 0, float(x), float(y))
        else:
            s, d, _, _ = kernel.project_near(self.table, 0, float(x), float(y), float(near))
        return float(s), float(d)

    def notes(self) -> tuple[str, ...]:
        """What was assumed about its source, and what was changed; a clause each."""
        return ()

    def whereabouts(self, s: float) -> str:
        """Where in its source an arc length is, besides s; empty without a source."""
        return ""

    def surface(self) -> Surface | None:
        """Height and banking, if its source gives any; None: the road is flat."""
        return None

    def cure(self) -> str:
        """What makes bends wider that no car can follow."""
        return "a road for this car has wider bends"

    def speeds(self) -> tuple[FloatArray, FloatArray] | None:
        """Arc lengths [m] and speeds [m/s] there, if its source gives any."""
        return None

    def corners(self) -> list[Corner]:
        """The named stretches in driving order; none unless the path has names."""
        return []

    def model_copy(self, *, update: Mapping[str, Any] | None = None, deep: bool = False) -> Self:
        """A copy, as pydantic's, that does not inherit geometry built for other fields."""
        copy = super().model_copy(update=update, deep=deep)
        for made in ("geometry", "course", "followed"):
            copy.__dict__.pop(made, None)
        return copy


class Start(Settings):
    """Where a run starts; in a configuration a number stands for ``s`` alone."""

    s: float = param(0.0, "m", "Arc length.", ge=0)
    offset: float = param(0.0, "m", "Distance from the path, left positive.")
    heading: float = param(
        0.0,
        "rad",
        "Direction of the velocity (at rest: yaw) less the path's tangent.",
        ge=-math.pi,
        le=math.pi,
    )

    def pose(self, path: PathComponent) -> Pose:
        """Centre of mass and direction of the velocity."""
        at = path.at(self.s)
        x, y = at.x - self.offset * math.sin(at.psi), at.y + self.offset * math.cos(at.psi)
        return Pose(x, y, at.psi + self.heading)
