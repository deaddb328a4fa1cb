"""What paths and plants have to offer; controllers, sensors and speeds are components."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol

from steersman.types import (
    Command,
    FloatArray,
    PathPoint,
    Pose,
    Surface,
    VehicleState,
)

if TYPE_CHECKING:
    from steersman.kernels.path import PathTable


class Path(Protocol):
    """A curve to follow, parametrised by arc length s."""

    @property
    def length(self) -> float:
        """Arc length [m]."""
        ...

    @property
    def closed(self) -> bool:
        """Whether the end joins the start."""
        ...

    @property
    def table(self) -> PathTable:
        """The path as pieces of linear curvature, as the kernels read it."""
        ...

    def at(self, s: float) -> PathPoint:
        """The point at arc length s [m]; closed paths wrap, open ones go on straight."""
        ...

    def surface(self) -> Surface | None:
        """Height and banking of the road under it; None: it is flat."""
        ...

    def speeds(self) -> tuple[FloatArray, FloatArray] | None:
        """Arc lengths [m] and speeds [m/s] that the path's source gives; None: it gives none."""
        ...

    def project(self, x: float, y: float, near: float | None = None) -> tuple[float, float]:
        """Arc length s and signed lateral offset d (left positive) of the closest point [m].

        ``near`` is an arc length to search from; without it the whole path is searched.
        """
        ...


class Plant(Protocol):
    """Something that drives: the embedded simulator, or CARLA."""

    vehicle: Any
    """What is known of the vehicle that is driven (``vehicles.Vehicle``)."""
    source: str
    """The plant in words, as results state it: the embedded simulator, or a server's version."""
    delay: int
    """Steering delay in the steps of the plant's configuration, from the next ``reset`` on."""

    @property
    def dt(self) -> float:
        """Control period [s]."""
        ...

    def enter(self, path: Path) -> None:
        """Prepare for driving on ``path``, before ``reset``."""
        ...

    def reset(self, pose: Pose, speed: float, curvature: float) -> VehicleState:
        """Put the vehicle at ``pose`` in the steady turn of that curvature at that speed."""
        ...

    def resume(self, state: VehicleState) -> None:
        """Put the vehicle back where it was in ``state``; as nearly as can be, in CARLA."""
        ...

    def step(self, command: Command) -> VehicleState:
        """Hold ``command`` for one control period."""
        ...

    def accelerations(self) -> FloatArray:
        """a_x and a_y at the integration steps so far [m/s^2], (n, 2); empty if not kept."""
        ...

    def rolled_over(self) -> bool:
        """Whether the vehicle has rolled over, or its inner wheels have lifted."""
        ...

    def close(self) -> None:
        """Release whatever the plant holds; may be called twice."""
        ...
