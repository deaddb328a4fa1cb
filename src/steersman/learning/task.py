"""Tasks: what is rewarded. The reward is a sum of terms (:mod:`steersman.learning.rewards`)."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Callable
from typing import Annotated, Literal

import numpy as np

from steersman.config import Component, Of, param, register
from steersman.kernels import reward as kernel
from steersman.kernels.formula import Formula, check, numbers_of
from steersman.kernels.formula_slopes import slopes
from steersman.kernels.reward import RewardTable
from steersman.kernels.vehicle import STEER
from steersman.learning.rewards import (
    Imitation,
    Precision,
    Progress,
    RewardTerm,
    SteeringChange,
)
from steersman.types import FloatArray

_BLEND = {"none": kernel.NO_DEMONSTRATION, "fixed": kernel.FIXED, "adaptive": kernel.ADAPTIVE}
# A steering difference of this size makes the normalised r_diff one.
_DIFFERENCE = 0.1


class TaskComponent(Component):
    """Follow a path. The reward is c_track r_track - c_diff r_diff, the change's price, and terms.

    R = c_track r_track - c_diff r_diff - c_change/2 (change of steering)^2 + terms.
    """

    demonstration: Literal["none", "fixed", "adaptive"] = param(
        "adaptive", "-", "Coefficients of tracking and demonstration reward."
    )
    c_track: float = param(1.0, "-", "Fixed coefficient, or emphasis of the adaptive one.", ge=0)
    c_diff: float = param(1.0, "-", "Fixed coefficient, or emphasis of the adaptive one.", ge=0)
    c_change: float = param(0.0, "-", "Weight of half the squared change of steering.", ge=0)
    normalise: bool = param(
        False, "-", "Divide r_track by v_ref and r_diff by 0.1^2/2 before sigmoid and sum."
    )
    v_ref: float = param(10.0, "m/s", "Reference speed of the normalisation.", gt=0)
    terms: tuple[Annotated[RewardTerm, Of("reward")], ...] = param((), "-", "Further terms.")

    @abstractmethod
    def tracking(self) -> RewardTerm:
        """The tracking reward, r_track."""

    def sum_of(self) -> list[RewardTerm]:
        """All terms: tracking, demonstration (if it enters), change of steering, further ones."""
        scale = 0.5 * _DIFFERENCE**2 if self.normalise else 1.0
        shown = [] if self.demonstration == "none" else [Imitation(scale=scale)]
        return [self.tracking(), *shown, SteeringChange(weight=self.c_change), *self.terms]

    def table(self) -> RewardTable:
        """The sum as the kernels read it; only for this process."""
        return self._table(lambda formula: formula.address)

    def slopes(self) -> RewardTable:
        """Its derivatives, likewise; a ConfigError where a term has none."""
        return self._table(slopes)

    def _table(self, address: Callable[[Formula], int]) -> RewardTable:
        terms: list[list[int]] = []
        own: list[float] = []
        for term in self.sum_of():
            terms.append([address(term.formula()), len(own)])
            own += numbers_of(term).values()
        return RewardTable(
            np.array(terms, dtype=np.int64),
            np.array(own),
            _BLEND[self.demonstration],
            self.c_track,
            self.c_diff,
        )

    def rewards(
        self,
        states: FloatArray,
        tracking: FloatArray,
        steer: FloatArray,
        demonstrated: FloatArray,
        dt: float,
    ) -> FloatArray:
        """The rewards (n,) of a recorded drive of n steps.

        Args:
            states: (n + 1, N_STATE) states, the first before the first step.
            tracking: (n + 1, N_TRACKING) where the vehicle was on its path.
            steer: (n,) executed steering commands.
            demonstrated: (n,) the demonstrator's.
            dt: control period [s].
        """
        table, out = self.table(), np.empty((len(steer), 4))
        step = np.empty(kernel.N_JUDGED)
        previous = states[0, STEER]
        for k, command in enumerate(steer):
            place = states[k + 1], tracking[k + 1]
            kernel.describe(*place, command, previous, demonstrated[k], dt, math.nan, step)
            kernel.judge(table, step, out[k])
            previous = command
        check()
        return out[:, kernel.TOTAL].copy()


@register("task", "paper")
class PaperTask(TaskComponent):
    """The paper's reward, r_track = |v cos Phi| - |v sin Phi| - |v||d|."""

    phi: Literal["course", "sideslip"] = param(
        "course", "-", "Phi: course error, or side-slip as the paper words it."
    )

    def tracking(self) -> RewardTerm:
        """Progress along the path."""
        scale = self.v_ref if self.normalise else 1.0
        return Progress(side_slip=self.phi == "sideslip", scale=scale)


@register("task", "precise")
class PreciseTask(TaskComponent):
    """A tracking reward of size one whose slope does not fade near zero error.

    r_track = 1 - w sqrt(min(|d| / d_0, 1)) - k |d| - |sin(course error)|/2.
    """

    root_error: float = param(0.05, "m", "d_0, error at which the root is fully paid.", gt=0)
    root_weight: float = param(0.5, "-", "w, weight of the root.", ge=0)
    linear_weight: float = param(0.5, "1/m", "k, weight of the error itself.", ge=0)

    def tracking(self) -> RewardTerm:
        """Precision; it needs no normalisation."""
        return Precision(**self.model_dump(include={"root_error", "root_weight", "linear_weight"}))
