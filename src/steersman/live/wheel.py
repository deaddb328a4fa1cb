"""A person at the wheel: a drive in real time, recorded as a demonstration.

The drive is the one that every controller drives (:mod:`steersman.rollout`), in a thread; its
controller waits until the moment of each control step and takes the steering that the page sent
last. What is kept is an episode, which ``steersman imitate method=bc data=FOLDER`` learns from.
"""

from __future__ import annotations

import math
import threading
import time
from dataclasses import dataclass, field, replace
from itertools import count
from pathlib import Path as FilePath
from typing import Any, ClassVar, Literal

import numpy as np
from pydantic import BaseModel, Field

from steersman.controllers.base import ControllerComponent
from steersman.episode import END_OF_PATH, INTERRUPTED, OFF_TRACK, OVERRUN, ROLL_OVER
from steersman.errors import PlantError, SteersmanError
from steersman.files import make_folder
from steersman.live.drives import LONGEST, answer_of
from steersman.live.form import Choices
from steersman.rendering import road_line
from steersman.report.scene import car_of
from steersman.rollout import RunConfig, RunningDrive
from steersman.sensing import Tracking, to_state
from steersman.types import Observation, Status
from steersman.vehicles import Vehicle

PATIENCE = 2.0
"""Without a message from the page for so long the drive ends [s]."""
# Half width of the corridor that a person has at least [m].
_CORRIDOR = 3.0
# How a drive ended, for the person who drove.
_ENDS = {
    OFF_TRACK: "you left the road",
    ROLL_OVER: "the car rolled over",
    OVERRUN: "the car did not stand at the end of the road",
    END_OF_PATH: "finished, at the end of the road",
}


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
    drive: RunningDrive | None = None
    """What is driven."""
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
        if not thread.is_alive():
            return {"ended": True, **self._answer}
        return {**self._seen(), **({"road": self._road()} if given.act == "start" else {})}

    def _start(self, choices: Choices) -> None:
        config = choices.config(self._base)
        self._hand = hand = Hand()
        parts = {
            "controller": HandController(hand=hand),
            "estimator": None,
            "predictor": None,
            "corridor": max(config.corridor, _CORRIDOR),
            "duration": min(config.duration or LONGEST, LONGEST),
            "laps": None,
        }
        config = config.model_copy(update=parts)
        make_folder(self._folder)
        hand.drive, self._answer = RunningDrive(config), {}
        self._thread = threading.Thread(target=self._drive, args=(hand.drive,), daemon=True)
        self._thread.start()

    def _drive(self, drive: RunningDrive) -> None:
        try:
            end, error = drive.run(None)
        except KeyboardInterrupt:
            end, error = INTERRUPTED, None
        except SteersmanError as fault:
            end, error = INTERRUPTED, PlantError(str(fault))
        finally:
            drive.simulation.close()
        episode = drive.episode(end)
        if error is not None or not len(episode):
            self._answer = {"error": str(error or "stopped before the first step")}
            return
        waited = np.zeros(len(episode))  # nothing was computed
        episode = replace(episode, columns={**episode.columns, "control_time": waited})
        names = (self._folder / f"hand_{k}" for k in count(1))
        place = next(name for name in names if not name.exists())
        try:
            episode.save(make_folder(place) / "episode.npz")
            shown = answer_of("by hand", episode, self._words(end))
            how = f"{self._words(end)}, after {len(episode) * episode.dt:.1f} s"
            self._answer = {"kept": str(place), "how": how, **shown}
        except SteersmanError as fault:
            self._answer = {"error": str(fault)}

    def _words(self, end: str) -> str:
        """How the drive ended."""
        if end == INTERRUPTED:
            return "stopped by you" if self._hand.stop else "stopped, as the page was away"
        return _ENDS.get(end, "finished, at the end of its time")

    def _road(self) -> dict[str, Any]:
        """The line to follow from its start [m], the corridor's half width [m], and the car."""
        assert self._hand.drive is not None  # it has begun
        config = self._hand.drive.config
        x, y = road_line(config.path)
        return {
            "x": np.round(x - x[0], 2).tolist(),
            "y": np.round(y - y[0], 2).tolist(),
            "half": config.corridor,
            "car": car_of(config.vehicle),
        }

    def _seen(self) -> dict[str, Any]:
        """Where the car is in the frame of the road, how fast, and how far beside its line."""
        drive = self._hand.drive
        assert drive is not None  # it has begun
        simulation, start = drive.simulation, drive.config.path.at(0.0)
        state = to_state(simulation.fleet.state[0], simulation.time(0))
        return {
            "ended": False,
            "time": state.time,
            "x": state.x - start.x,
            "y": state.y - start.y,
            "psi": state.psi,
            "wheel": state.wheel_angle,
            "speed": math.hypot(state.v_x, state.v_y),
            "lateral_error": float(Tracking(*simulation.fleet.tracking[0]).lateral_error),
            "steer": state.steer,
        }
