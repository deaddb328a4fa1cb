"""Encodings: the lists of features that a policy's network reads.

Features are in SI units; a fixed scale brings them to about unit size and is part of an exported
policy. Training and the controllers of exported policies use the same kernel.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, NamedTuple, final

import numpy as np
from pydantic import model_validator

from steersman.config import Component, Of, param, register
from steersman.features.base import UPDATES, Feature
from steersman.features.motion import (
    ActualSteering,
    FineHeadingError,
    FineLateralError,
    HeadingError,
    LateralError,
    LateralVelocity,
    LongitudinalVelocity,
    YawRate,
)
from steersman.features.past import (
    BaseCorrection,
    LastCommand,
    LateralErrorIntegral,
    PastCommands,
    PastErrors,
)
from steersman.features.road import RoadCurvatures, Waypoints
from steersman.features.wished import LastShare, SpeedError, WishedSpeeds
from steersman.kernels import encode as kernel
from steersman.kernels import observe
from steersman.kernels.encode import EncodingTable
from steersman.kernels.encode_slopes import EncodingSlopes
from steersman.kernels.formula import Formula, numbers_of
from steersman.kernels.formula_slopes import hands_on, reads, slopes
from steersman.types import FloatArray

# What of the loop's columns depends on the past.
_COMMANDS = kernel.LAST_COMMAND, kernel.BASE_COMMAND


class _Read(NamedTuple):
    """What a formula reads."""

    places: list[int]
    alone: bool
    """Whether it gives the one number that it reads, as it is."""


@dataclass(frozen=True)
class Layout:
    """A network's input: its features in their order."""

    features: tuple[Feature, ...]
    spacing: float
    """Distance between waypoints [m]."""
    dt: float
    """Control period [s]."""

    def _numbers(self) -> Iterable[tuple[Feature, int]]:
        return ((feature, i) for feature in self.features for i in range(feature.size))

    @cached_property
    def names(self) -> list[str]:
        """Name of each number, with its unit in brackets."""
        return [feature.label(i, self.spacing) for feature, i in self._numbers()]

    @cached_property
    def scale(self) -> FloatArray:
        """Factor on each number that brings it to about unit size."""
        return np.array([feature.factor(i, self.spacing) for feature, i in self._numbers()])

    @cached_property
    def mirror(self) -> FloatArray:
        """Factor on each number that gives that of the mirrored scene."""
        return np.array([feature.mirrored(i) for feature, i in self._numbers()])

    @property
    def reads(self) -> int:
        """How many waypoints it reads."""
        return max((feature.reads for feature in self.features), default=0)

    @property
    def cells(self) -> int:
        """How many numbers its features remember."""
        return sum(feature.cells for feature in self.features)

    @cached_property
    def table(self) -> EncodingTable:
        """The layout as the kernels read it; only for this process."""
        return self._table(lambda formula: formula.address)

    @cached_property
    def slopes(self) -> EncodingSlopes:
        """Its derivatives as the kernels read them; only for this process.

        Raises:
            ConfigError: numba cannot derive one of the formulas.
        """
        of_numbers: list[_Read] = []
        of_cells: list[_Read] = []
        first, last = kernel.CELLS, kernel.CELLS + self.cells
        for feature in self.features:
            own = list(numbers_of(feature).values())
            sizes = observe.O_PREVIEW + 2 * feature.reads, kernel.CELLS, feature.cells
            found = feature.formulas

            def read(name: str, i: int) -> _Read:
                if name not in found:  # noqa: B023
                    return _Read([], alone=False)
                formula = found[name]  # noqa: B023
                seen, loop, memory = reads(formula, own, i, sizes)  # noqa: B023
                cells = [first + k for k in memory]  # noqa: B023
                places = [*(k for k in loop if k in _COMMANDS), *cells, *(last + k for k in seen)]
                return _Read(places, alone=len(places) == 1 and hands_on(formula, own, i))  # noqa: B023

            of_numbers += [read("value", i) for i in range(feature.size)]
            for i in range(feature.cells):
                of_cells += [read(name, i) for name in UPDATES]
            first += feature.cells
        of_all = of_numbers + of_cells
        begins = np.cumsum([0, *(len(each.places) for each in of_all)])
        flat = [place for each in of_all for place in each.places]
        return EncodingSlopes(
            self._table(slopes),
            begins.astype(np.int64),
            np.array(flat, dtype=np.int64),
            np.array([each.alone for each in of_all], dtype=np.bool_),
        )

    def _table(self, address: Callable[[Formula], int]) -> EncodingTable:
        numbers: list[list[int]] = []
        cells: list[list[int]] = []
        own: list[float] = []
        for feature in self.features:
            at, first = len(own), kernel.CELLS + len(cells)
            found = {name: address(formula) for name, formula in feature.formulas.items()}
            numbers += [[found["value"], i, at, first] for i in range(feature.size)]
            updates = [found.get(name, 0) for name in UPDATES]
            cells += [[*updates, i, at, first] for i in range(feature.cells)]
            own += numbers_of(feature).values()
        return EncodingTable(
            np.array(numbers, dtype=np.int64).reshape(-1, 4),
            np.array(cells, dtype=np.int64).reshape(-1, 6),
            np.array(own),
            self.spacing,
            self.dt,
        )


class EncodingComponent(Component):
    """What a policy's network reads."""

    @abstractmethod
    def features_for(self, action: str) -> tuple[Feature, ...]:
        """The features in their order; the action is ``rate``, ``direct`` or ``residual``."""

    @final
    def layout(self, spacing: float, dt: float, action: str, *, joint: bool = False) -> Layout:
        """The input for waypoints ``spacing`` [m] apart and the control period ``dt`` [s].

        A joint policy also reads wished speeds and what it made of them; a residual one the last
        command and, at the end, the base's.
        """
        features = list(self.features_for(action))
        if joint:
            wishes = WishedSpeeds(), SpeedError(), LastShare()
            features += [one for one in wishes if one not in features]
        if action == "residual":
            if LastCommand() not in features:
                features.append(LastCommand())
            features.append(BaseCorrection())
        return Layout(tuple(features), spacing, dt)


_MOTION = (LongitudinalVelocity(), LateralVelocity(), YawRate())


@register("encoding", "waypoints")
class WaypointEncoding(EncodingComponent):
    """The paper's observation: waypoints in the vehicle's frame and the physical state.

    The steering is added when the action is its rate, or when asked for.
    """

    waypoints: int = param(15, "-", "Waypoints among the features.", ge=1)
    steer: bool = param(False, "-", "Include the actual steering for direct actions too.")

    def features_for(self, action: str) -> tuple[Feature, ...]:
        """Waypoints, motion, perhaps steering."""
        steer = (ActualSteering(),) if action == "rate" or self.steer else ()
        return (Waypoints(count=self.waypoints), *_MOTION, *steer)


@register("encoding", "extended")
class ExtendedEncoding(EncodingComponent):
    """Explicit errors, their integral, the last command, road curvatures, a short history."""

    waypoints: int = param(0, "-", "Waypoints among the features.", ge=0)
    roads: int = param(7, "-", "Road curvatures: beside the car and over 4, 8, ... m.", ge=0)
    errors: bool = param(True, "-", "Lateral and heading error, plain and finely scaled.")
    integral: bool = param(True, "-", "Integral of the lateral error.")
    command: bool = param(True, "-", "Last command.")
    history: int = param(0, "-", "Past lateral errors and commands, this many of each.", ge=0)
    fine_error: float = param(0.05, "m", "Error at half range of the fine feature.", gt=0)
    fine_heading: float = param(0.02, "rad", "Heading at half range of the fine feature.", gt=0)
    integral_limit: float = param(0.25, "m s", "Bound of the integral.", gt=0)

    def features_for(self, action: str) -> tuple[Feature, ...]:
        """Those that are switched on."""
        out: list[Feature] = []
        if self.waypoints:
            out.append(Waypoints(count=self.waypoints))
        if self.roads:
            out.append(RoadCurvatures(count=self.roads))
        out += [*_MOTION, ActualSteering()]
        if self.errors:
            fine = FineLateralError(half=self.fine_error), FineHeadingError(half=self.fine_heading)
            out += [LateralError(), HeadingError(), *fine]
        if self.integral:
            out.append(LateralErrorIntegral(limit=self.integral_limit))
        if self.command or action == "residual":
            out.append(LastCommand())
        if self.history:
            out += [PastErrors(count=self.history), PastCommands(count=self.history)]
        return tuple(out)


@register("encoding", "list")
class FeatureList(EncodingComponent):
    """Any features in any order, those of other packages included."""

    features: tuple[Annotated[Feature, Of("feature")], ...] = param(
        ("road_curvatures", "v_x", "yaw_rate", "steer", "lateral_error", "heading_error"),
        "-",
        "Features in their order.",
        min_length=1,
    )

    @model_validator(mode="after")
    def _distinct(self) -> FeatureList:
        names = [feature.label(i, 1.0) for feature in self.features for i in range(feature.size)]
        twice = next((name for name in names if names.count(name) > 1), None)
        if twice is not None:
            raise ValueError(f"features: {twice} is there twice")
        if BaseCorrection() in self.features:
            raise ValueError(f"features: {BaseCorrection.kind} is added where a base is corrected")
        return self

    def features_for(self, action: str) -> tuple[Feature, ...]:
        """As listed."""
        return self.features
