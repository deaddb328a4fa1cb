"""Options of an environment's ``reset``: what an episode has, instead of drawing it."""

from __future__ import annotations

import math
from typing import Annotated

from pydantic import field_validator

from steersman.config import Of, Settings, param
from steersman.errors import ConfigError
from steersman.learning.starts import FleetStart
from steersman.paths.base import PathComponent, Start
from steersman.speed import FASTEST, ConstantSpeed


class EpisodeOptions(Settings):
    """What is not drawn."""

    path: Annotated[PathComponent | None, Of("path", optional=True)] = param(
        None, "-", "Path of the episode; null: drawn from the problem's roads."
    )
    speed: float | None = param(
        None, "m/s", "Speed to keep; null: drawn from the problem's sources.", gt=0, le=FASTEST
    )
    start: Start | None = param(
        None, "-", "Where it starts; a number is the arc length [m]; null: drawn."
    )

    @field_validator("start", mode="before")
    @classmethod
    def _arc_length(cls, value: object) -> object:
        return {"s": value} if isinstance(value, float | int) else value

    def check(self, path: PathComponent, corridor: float) -> None:
        """Refuse a start that is not on the road.

        Raises:
            ConfigError: it lies behind the end of the path, or outside the corridor.
        """
        if self.start is None:
            return
        if self.start.s > path.length:
            raise ConfigError(
                f"{self.start.s:g} is not allowed; the path is {path.length:.4g} long [m]",
                ("options", "start", "s"),
            )
        if abs(self.start.offset) >= corridor:
            raise ConfigError(
                f"{self.start.offset:g} is not allowed; the corridor's half width is "
                f"{corridor:g} [m]",
                ("options", "start", "offset"),
            )

    def applied(self, drawn: FleetStart, road: int | None) -> FleetStart:
        """The start of the episode: what is given, on the road of that number, else as drawn."""
        start = drawn if road is None else drawn._replace(road=road)
        if self.start is not None:
            given = self.start
            start = start._replace(s=given.s, offset=given.offset, heading=given.heading)
        if self.speed is not None:
            profile = ConstantSpeed(speed=self.speed).profile()
            start = start._replace(profile=profile, speed=math.nan, share=1.0)
        return start
