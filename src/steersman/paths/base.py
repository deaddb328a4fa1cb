"""What all paths share: a table of clothoid pieces, evaluation and projection."""

from __future__ import annotations

from abc import abstractmethod
from functools import cached_property

from pydantic import ConfigDict

from steersman.config import Component
from steersman.kernels import path as kernel
from steersman.kernels.path import PathTable
from steersman.types import PathPoint


class PathComponent(Component):
    """A path: its configuration, and, built when first used, its geometry."""

    model_config = ConfigDict(frozen=True, extra="forbid", validate_default=True)

    @abstractmethod
    def build_table(self) -> PathTable:
        """The pieces of the path; called once."""

    @cached_property
    def table(self) -> PathTable:
        """The path as pieces of linear curvature, one path in the table."""
        return self.build_table()

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
        """Arc length s and signed lateral offset d (left positive) of the closest point [m]."""
        if near is None:
            return kernel.project(self.table, 0, float(x), float(y))
        s, d, _, _ = kernel.project_near(self.table, 0, float(x), float(y), float(near))
        return s, d
