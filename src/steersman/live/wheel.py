"""A person at the wheel: a drive in real time, recorded as a demonstration.

The drive is the one that every controller drives (:mod:`steersman.rollout`), in a thread; its
controller waits until the moment of each control step and takes the steering that the page sent
last. What is kept is an episode, which ``steersman imitate method=bc data=FOLDER`` learns from.
"""

from __future__ import annotations

import threading
import time
from dataclasses import dataclass, field, replace
from itertools import count
from pathlib import Path as FilePath
from typing import Any, ClassVar, Literal

import numpy as np
from pydantic import BaseModel, Field

from steersman.controllers.base import ControllerComponent
from steersman.errors import SteersmanError
from steersman.files import make_folder
from steersman.live.drives import LONGEST, answer_of
from steersman.live.form import Choices
from steersman.outcome import Interrupted
from steersman.rollout import RunConfig, attempt
from steersman.types import Observation, Status
from steersman.vehicles import Vehicle

PATIENCE = 2.0
"""Without a message from the page for so long the drive ends [s]."""
# What a person sees and may leave at least: waypoints, half width of the corridor [m].
_WAYPOINTS, _CORRIDOR = 25, 3.0


class WheelInput(BaseModel):
    """A message of the page."""

    act: Literal["start", "steer", "stop"]
    steer: float | None = Field(0.0, ge=-1.0, le=1.0, allow_inf_nan=False)
    """Normalised steering, left positive; None: no hands on the wheel of a training."""
    choices: Choices | None = None
    """What is driven, to start."""


@dataclass
class Hand:
    """What the page and the drive's thread tell each other."""

    steer: float = 0.0
    heard: float = field(default_factory=time.monotonic)
    """When the page sent something [s]."""
    began: float | None = None
    seen: Observation | None = None
    stop: bool = False


class HandController(ControllerComponent):
    """Steers as the page says, in real time; its state is a :class:`Hand`."""

    kind: ClassVar[str] = "hand"
    hand: Any = Field(exclude=True)

    def init(self, vehicle: Vehicle, dt: float) -> Hand:
        """The hand at the wheel."""
        found: Hand = self.hand
        return found

    def decide(self, state: Hand, observation: Observation) -> tuple[float, Status, Hand]:
        """Wait for the moment of the observation, and return the present steering.

        Raises:
            KeyboardInterrupt: the person stopped, or the page is gone.
        """
        now = time.monotonic()
        if observation.time <= 0.0 or state.began is None:
            state.began = now - observation.time
        time.sleep(max(state.began + observation.time - now, 0.0))
        state.seen = observation
        if state.stop or time.monotonic() - state.heard > PATIENCE:
            raise KeyboardInterrupt
        return state.steer, Status.SOLVED, state


class WheelDrive:
    """The one drive by hand of a server."""

    def __init__(self, base: RunConfig, folder: str) -> None:
        """Choices are laid over ``base``; episodes go into ``folder``."""
        self._base, self._folder = base, FilePath(folder)
        self._hand = Hand()
        self._thread: threading.Thread | None = None
        self._answer: dict[str, Any] = {}

    def answer(self, given: WheelInput) -> dict[str, Any]:
        """Start, steer or stop; what is seen now, and at the end where the drive is kept.

        Raises:
            ConfigError: a word or a value is unknown or not allowed.
            DataError: a file is missing, or the record cannot be written.
            SteersmanError: another page drives, or no drive has begun.
        """
        running = self._thread is not None and self._thread.is_alive()
        if given.act == "start":
            if running:
                raise SteersmanError("another page of this server is driving; stop it there")
            self._start(given.choices or Choices())
        hand = self._hand
        hand.steer, hand.heard = given.steer or 0.0, time.monotonic()
        if given.act == "stop":
            hand.stop = True
            if self._thread is not None:
                self._thread.join(PATIENCE)
        thread = self._thread
        if thread is None:
            raise SteersmanError("nothing is driven by hand; start first")
        return self._seen() if thread.is_alive() else {"ended": True, **self._answer}

    def _start(self, choices: Choices) -> None:
        config = choices.config(self._base)
        self._hand = hand = Hand()
        sensor = config.sensor
        parts = {
            "controller": HandController(hand=hand),
            "estimator": None,
            "predictor": None,
            "sensor": sensor.model_copy(update={"count": max(sensor.count, _WAYPOINTS)}),
            "corridor": max(config.corridor, _CORRIDOR),
            "duration": min(config.duration or LONGEST, LONGEST),
            "laps": None,
        }
        config = config.model_copy(update=parts)
        make_folder(self._folder)
        self._answer = {}
        self._thread = threading.Thread(target=self._drive, args=(config,), daemon=True)
        self._thread.start()

    def _drive(self, config: RunConfig) -> None:
        try:
            episode = attempt(config).episode
        except Interrupted as stopped:
            episode = stopped.episode
        except SteersmanError as error:
            self._answer = {"error": str(error)}
            return
        if not len(episode):
            self._answer = {"error": "stopped before the first step"}
            return
        waited = np.zeros(len(episode))  # nothing was computed
        episode = replace(episode, columns={**episode.columns, "control_time": waited})
        names = (self._folder / f"hand_{k}" for k in count(1))
        place = next(name for name in names if not name.exists())
        try:
            episode.save(make_folder(place) / "episode.npz")
            self._answer = {"kept": str(place), **answer_of("by hand", episode)}
        except SteersmanError as error:
            self._answer = {"error": str(error)}

    def _seen(self) -> dict[str, Any]:
        """What a person sees, in the vehicle's frame; empty before the first step."""
        seen = self._hand.seen
        if seen is None:
            return {"ended": False}
        return {
            "ended": False,
            "time": seen.time,
            "speed": seen.speed,
            "lateral_error": seen.lateral_error,
            "heading_error": seen.heading_error,
            "steer": seen.steer,
            "preview": seen.preview.tolist(),
        }
