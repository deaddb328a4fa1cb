"""Features of the observation: the numbers that a policy's network can read.

A feature is one class: name, unit, scale, sign under mirroring and formula. Training, exported
policies, their cards and their C code all follow from it (docs/rewards_and_features.md).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import ClassVar, Protocol, final

from steersman.config import Component
from steersman.kernels import encode as kernel
from steersman.kernels import observe
from steersman.kernels.formula import Formula, Group, compiled, own_group
from steersman.types import FloatArray

# The formulas that renew a feature's cells.
UPDATES = ("begin", "advance", "remember")
_SEEN = Group(
    {
        "lateral_error": observe.O_D,
        "heading_error": observe.O_HEADING,
        "v_x": observe.O_VX,
        "v_y": observe.O_VY,
        "yaw_rate": observe.O_RATE,
        "steer": observe.O_STEER,
        "curvature": observe.O_KAPPA,
    },
    ("preview", observe.O_PREVIEW),
)
_LOOP = Group(
    {
        "last_command": kernel.LAST_COMMAND,
        "base_command": kernel.BASE_COMMAND,
        "dt": kernel.DT,
        "spacing": kernel.SPACING,
        "last_share": kernel.LAST_SHARE,
        "gap": kernel.GAP,
        "relative_speed": kernel.RELATIVE_SPEED,
        "wished_gap": kernel.WISHED_GAP,
    },
    ("wishes", kernel.WISHES),
)


class Loop(Protocol):
    """What a feature can read beside the observation."""

    last_command: float
    """Steering command that was executed in the last step [-]."""
    base_command: float
    """Steering command of the base controller that the policy corrects [-]."""
    dt: float
    """Control period [s]."""
    spacing: float
    """Distance between waypoints [m]."""
    last_share: float
    """Share of the wished speed that the last joint action allowed [-]."""
    gap: float
    """Distance to the car ahead, bumper to bumper [m]; where there is one."""
    relative_speed: float
    """Its speed less the own one [m/s]."""
    wished_gap: float
    """Gap that is wished at the own speed [m]."""
    wishes: FloatArray
    """Rows of wished speed [m/s] and distance ahead [m]; under a joint action only."""


class Feature(Component):
    """One or several numbers that a network reads.

    ``value`` is a formula, see :mod:`steersman.kernels.formula`. It may take ``seen`` (an
    :class:`~steersman.types.Observation`), ``loop`` (a :class:`Loop`), ``memory`` (this feature's
    cells) and ``i`` (which of its numbers). A feature that remembers something has ``cells`` > 0
    and formulas for cell ``i``: ``begin`` at the first observation of a drive, ``advance`` at
    each later one, ``remember`` once the step's command is known. Cells are renewed in descending
    order, so that ``memory[i - 1]`` is still the old value.
    """

    unit: ClassVar[str] = "-"
    """Unit of its numbers."""
    sign: ClassVar[float] = -1.0
    """Factor under mirroring left and right: -1 for what is positive to the left, else 1."""
    scale: ClassVar[float] = 1.0
    """Factor that brings it to about unit size [1/unit]."""

    joint: ClassVar[bool] = False
    """Whether it needs a joint action, which alone knows the wished speed."""
    lead: ClassVar[bool] = False
    """Whether it needs a car ahead."""

    value: ClassVar[Callable[..., float]]
    begin: ClassVar[Callable[..., float] | None] = None
    advance: ClassVar[Callable[..., float] | None] = None
    remember: ClassVar[Callable[..., float] | None] = None

    @property
    def size(self) -> int:
        """How many numbers it has."""
        return 1

    @property
    def cells(self) -> int:
        """How many numbers it remembers."""
        return 0

    @property
    def reads(self) -> int:
        """How many waypoints it reads."""
        return 0

    def label(self, i: int, spacing: float) -> str:
        """Name of number ``i`` and its unit in brackets; waypoints are ``spacing`` [m] apart."""
        return f"{self.kind} [{self.unit}]"

    def factor(self, i: int, spacing: float) -> float:
        """Scale of number ``i``."""
        return self.scale

    def mirrored(self, i: int) -> float:
        """Sign under mirroring of number ``i``."""
        return self.sign

    @final
    @property
    def formulas(self) -> dict[str, Formula]:
        """The compiled formulas by name."""
        found = {name: getattr(type(self), name, None) for name in ("value", *UPDATES)}
        groups = {"seen": _SEEN, "loop": _LOOP, "self": own_group(self), "memory": Group({})}
        return {name: compiled(each, groups) for name, each in found.items() if each is not None}
