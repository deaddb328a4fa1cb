"""Tasks: what is rewarded, and how the demonstration enters the reward."""

from __future__ import annotations

from abc import abstractmethod
from typing import Literal

from steersman.config import Component, param, register
from steersman.kernels import reward as kernel
from steersman.kernels.reward import RewardTable

_BLEND = {"none": kernel.NO_DEMONSTRATION, "fixed": kernel.FIXED, "adaptive": kernel.ADAPTIVE}
# A steering difference of this size makes the normalised r_diff one.
_DIFFERENCE = 0.1


class TaskComponent(Component):
    """Follow a path. R = c_track r_track - c_diff r_diff - c_change/2 (change of steering)^2."""

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

    @abstractmethod
    def table(self) -> RewardTable:
        """The constants as the kernels read them."""

    def _table(
        self, shape: int, side_slip: bool, error: tuple[float, float, float], track_scale: float
    ) -> RewardTable:
        return RewardTable(
            shape,
            int(side_slip),
            *error,
            self.c_change,
            _BLEND[self.demonstration],
            self.c_track,
            self.c_diff,
            track_scale,
            0.5 * _DIFFERENCE**2 if self.normalise else 1.0,
        )


@register("task", "paper")
class PaperTask(TaskComponent):
    """The paper's reward, r_track = |v cos Phi| - |v sin Phi| - |v||d|."""

    phi: Literal["course", "sideslip"] = param(
        "course", "-", "Phi: course error, or side-slip as the paper words it."
    )

    def table(self) -> RewardTable:
        """The constants as the kernels read them."""
        scale = self.v_ref if self.normalise else 1.0
        return self._table(kernel.PAPER, self.phi == "sideslip", (1.0, 0.0, 0.0), scale)


@register("task", "precise")
class PreciseTask(TaskComponent):
    """A tracking reward of size one whose slope does not fade near zero error.

    r_track = 1 - w sqrt(min(|d| / d_0, 1)) - k |d| - |sin(course error)|/2.
    """

    root_error: float = param(0.05, "m", "d_0, error at which the root is fully paid.", gt=0)
    root_weight: float = param(0.5, "-", "w, weight of the root.", ge=0)
    linear_weight: float = param(0.5, "1/m", "k, weight of the error itself.", ge=0)

    def table(self) -> RewardTable:
        """The constants as the kernels read them; r_track needs no scaling here."""
        error = (self.root_error, self.root_weight, self.linear_weight)
        return self._table(kernel.FINITE_SLOPE, False, error, 1.0)
