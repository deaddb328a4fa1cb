"""A person at the wheel of a training: steps wait for their moment while a person holds it.

:mod:`steersman.live.relay` asks for each step of the training; the page sends the wheel's angle, or
that there are no hands on it. Without a page at the wheel the training runs on, unhindered.
"""

from __future__ import annotations

import math
import time
from typing import Any

from pydantic import BaseModel, Field

from steersman.live.wheel import PATIENCE, WheelInput

_Number = Field(allow_inf_nan=False)


class TrainingQuestion(BaseModel):
    """What ``controller=process`` says of a step, as far as it is shown; SI units."""

    drive: int
    dt: float = Field(gt=0.0, le=1.0)
    time: float = _Number
    v_x: float = _Number
    v_y: float = _Number
    yaw_rate: float = _Number
    lateral_error: float = _Number
    steer: float = _Number
    preview: list[tuple[float, float]]


class TrainingWheel:
    """The wheel of the one training that asks this server."""

    def __init__(self) -> None:
        """No person holds it."""
        self._steer: float | None = None
        self._heard = -math.inf
        self._next = 0.0
        self._seen: TrainingQuestion | None = None

    def ask(self, given: TrainingQuestion) -> dict[str, Any]:
        """Steering for a step, at its moment in real time; None: there are no hands on the wheel.

        Without a page at the wheel the answer comes at once.
        """
        now = time.monotonic()
        if now - self._heard > PATIENCE:
            return {"steer": None}
        self._seen = given
        # After an interruption (a validation, an update) time begins anew.
        self._next = max(self._next + given.dt, now)
        time.sleep(min(self._next - now, given.dt))
        return {"steer": self._steer}

    def answer(self, given: WheelInput) -> dict[str, Any]:
        """Take what the page sends; what the training's car sees now, empty before it asks."""
        if given.act == "stop":
            self._heard, self._seen = -math.inf, None
            return {"ended": True}
        self._steer, self._heard = given.steer, time.monotonic()
        seen = self._seen
        if seen is None:
            return {"ended": False}
        shown = seen.model_dump(exclude={"drive", "dt"})
        return {"ended": False, "speed": math.hypot(seen.v_x, seen.v_y), **shown}
