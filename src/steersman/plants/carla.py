"""CARLA as a plant; the one module that imports its client, within a function.

Tried against the stand-in of this package only (``steersman carla serve``), with the client as it
comes from PyPI; docs/carla.md says what that means for a real server.
"""

from __future__ import annotations

from typing import Any, ClassVar

from pydantic import model_validator

from steersman.config import param, register
from steersman.errors import ConfigError
from steersman.plants.base import PlantComponent
from steersman.plants.carla_plant import CarlaPlant
from steersman.plants.carla_server import Clock, Server, retried, whose
from steersman.plants.carla_session import Session
from steersman.vehicles import Vehicle

_SAME = 1e-9


def library() -> Any:
    """The client library.

    Raises:
        ModuleNotFoundError: it is not installed; the extra ``carla`` brings it.
    """
    import carla

    return carla


@register("plant", "carla")
class CarlaConfig(PlantComponent):
    """A CARLA server (0.9.15 or 0.9.16) in synchronous mode, or the stand-in for one."""

    # Its car is what it is, and its air is calm.
    cannot: ClassVar[frozenset[str]] = frozenset(
        {"mass", "yaw_inertia", "c_f", "c_r", "friction", "steer_rate", "steer_bias", "wind"}
    )

    dt: float = param(0.05, "s", "Control period: fixed_delta_seconds.", gt=0, le=0.5)
    steering_delay: float = param(
        0.0, "s", "Steering commands are held back by this here; whole control periods.", ge=0
    )
    host: str = param("127.0.0.1", "-", "Machine of the server.")
    port: int = param(
        2000, "-", "Port of the server; the next one carries its data.", ge=1, le=65534
    )
    timeout: float = param(10.0, "s", "Longest time for an answer.", gt=0, le=600)
    attempts: int = param(3, "-", "How often connecting and spawning are tried.", ge=1, le=20)
    vehicle: str = param("vehicle.tesla.model3", "-", "Blueprint of the vehicle.")
    map: str | None = param(
        None, "-", "Map of the server, e.g. Town04; null: the path becomes an OpenDRIVE world."
    )
    lane_width: float = param(6.0, "m", "Width of the lane of that world.", ge=3, le=400)
    max_substep_delta_time: float = param(0.01, "s", "Longest physics step.", gt=0)
    max_substeps: int = param(10, "-", "Most physics steps in a tick.", ge=1, le=16)
    warm_up: float = param(
        2.0, "s", "Time after spawning until the vehicle takes off as it should.", ge=0, le=60
    )
    run_up: float = param(
        1.0, "s", "Time in the steady turn before a run starts, held in place.", ge=0, le=60
    )
    read_physics: bool = param(
        True, "-", "Take mass, axles, steering curve and the like from the server, over vehicle."
    )
    rendering: bool = param(True, "-", "Draw the world; without it the server is faster.")

    @model_validator(mode="after")
    def _fits(self) -> CarlaConfig:
        longest = self.max_substep_delta_time * self.max_substeps
        if self.dt > longest + _SAME:
            raise ConfigError(
                f"{self.dt} s is not allowed; at most max_substep_delta_time x max_substeps, "
                f"{longest:g} s, or CARLA's physics falls behind",
                ("dt",),
            )
        whole = round(self.steering_delay / self.dt) * self.dt
        if abs(self.steering_delay - whole) > _SAME:
            raise ConfigError(
                f"{self.steering_delay} s is not allowed; a whole multiple of plant.dt, "
                f"{self.dt} s, is",
                ("steering_delay",),
            )
        return self

    @property
    def h(self) -> float:
        """Commands begin to act at ticks [s]."""
        return self.dt

    def source(self) -> str:
        """CARLA of some version, or the stand-in.

        Raises:
            PlantError: there is no server, or its version is not supported.
        """
        return whose(retried(self._server().knock, self.attempts))

    def car(self, vehicle: Vehicle) -> str:
        """The blueprint, and the vehicle it is taken for."""
        return f"{self.vehicle} (taken for {vehicle.title})"

    def _server(self) -> Server:
        return Server(self.host, self.port, self.timeout, self.attempts)

    def session(self) -> Session:
        """A session with the server, to be opened."""
        server = self._server()
        clock = Clock(self.dt, self.max_substep_delta_time, self.max_substeps, self.rendering)
        return Session(library(), server, clock)

    def make(self, vehicle: Vehicle) -> CarlaPlant:
        """Connect, and take over the server's clock.

        Raises:
            PlantError: there is no server, it is of another version, or another client drives it.
        """
        session = self.session()
        try:
            session.open()
        except BaseException:  # a Ctrl-C too: the server must not be left waiting for us
            session.close()
            raise
        return CarlaPlant(self, vehicle, session)
