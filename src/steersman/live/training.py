"""A training as it goes on: its curves and alarms, its newest drive and policy, pause and stop."""

from __future__ import annotations

from pathlib import Path as FilePath
from typing import Any, Literal

from pydantic import BaseModel

from steersman.episode import load_episode
from steersman.errors import DataError
from steersman.learning import running
from steersman.learning.running import read_state
from steersman.live.drives import answer_of
from steersman.live.form import ChosenPart
from steersman.report.curves import curves
from steersman.report.runs import ReportRun, read_progress

_GOES_ON = "running", "paused"


class TrainingRequest(BaseModel):
    """What the page knows already, and what it wants."""

    seen: float = 0.0
    """Stamp of the latest answer."""
    ask: Literal["pause", "go on", "stop"] | None = None
    """Asked of every training that is running or paused."""
    drive: float | None = None
    """Stamp of the validation drive that is shown; None: none is wanted."""


class FollowedTraining:
    """A folder of ``steersman train`` or ``imitate``, or of several seeds of one."""

    def __init__(self, folder: FilePath) -> None:
        """Follow what is, or will be, in the folder."""
        self._folder = folder

    def answer(self, given: TrainingRequest) -> dict[str, Any]:
        """States; curves, with bands over seeds, and the newest policy as a word if they are new.

        Raises:
            DataError: a record is malformed, or a folder cannot be written.
        """
        if given.ask is not None:
            self._ask(given.ask)
        files = sorted(self._folder.rglob("progress.csv"))
        policies = sorted(self._folder.rglob("policy.onnx"), key=_stamp)
        stamp = max(map(_stamp, [*files, *policies]), default=0.0)
        out: dict[str, Any] = {"seen": given.seen, "states": self._states()}
        if given.drive is not None:
            out["drive"] = self._drive(given.drive)
        if stamp <= given.seen:
            return out
        runs = [
            ReportRun(self._name(file), training=table)
            for file in files
            if (table := _progress(file)) is not None
        ]
        policy = ChosenPart(word="policy", fields={"file": str(policies[-1])}) if policies else None
        return out | {
            "seen": stamp,
            "training": curves(runs),
            "policy": None if policy is None else policy.model_dump(),
        }

    def _name(self, file: FilePath) -> str:
        """The training's folder: below the one that is followed, or its own name."""
        inner = str(file.parent.relative_to(self._folder))
        return self._folder.resolve().name if inner == "." else inner

    def _ask(self, what: Literal["pause", "go on", "stop"]) -> None:
        for file in self._folder.rglob(running.STATE):
            state = read_state(file.parent)
            if state is not None and state.state in _GOES_ON:
                running.ask(file.parent, None if what == "go on" else what)

    def _states(self) -> list[dict[str, Any]]:
        """How far each training is, in words, and what gives reason to doubt it."""
        out = []
        for file in sorted(self._folder.rglob(running.STATE)):
            state = read_state(file.parent)
            if state is None:
                continue
            words = f"{self._name(file)}: {state.state}, {state.steps} of {state.total} steps"
            why = [state.why] * bool(state.why)
            out.append({"state": state.state, "words": words, "alarms": [*why, *state.alarms]})
        return out

    def _drive(self, shown: float) -> dict[str, Any] | None:
        """The worst drive of the newest validation of all trainings; None: the one shown."""
        file = max(self._folder.rglob(running.DRIVE), key=_stamp, default=None)
        if file is None or (stamp := _stamp(file)) <= shown:
            return None
        title = f"validation of {self._name(file)}"
        return {"stamp": stamp, **answer_of(title, load_episode(file))}


def _stamp(file: FilePath) -> float:
    """When a file was written [s]; 0 if it is gone."""
    try:
        return file.stat().st_mtime
    except OSError:
        return 0.0


def _progress(file: FilePath) -> Any:
    """The record; None while it has no line or is just being replaced."""
    try:
        return read_progress(file)
    except DataError:
        if file.is_file() and file.stat().st_size:
            raise
        return None
