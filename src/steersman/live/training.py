"""A training as it goes on: its curves, and what its newest policy drives."""

from __future__ import annotations

from pathlib import Path as FilePath
from typing import Any

from pydantic import BaseModel

from steersman.errors import DataError
from steersman.live.form import ChosenPart
from steersman.report.curves import curves
from steersman.report.runs import ReportRun, read_progress


class TrainingRequest(BaseModel):
    """What the page knows already."""

    seen: float = 0.0
    """Stamp of the latest answer."""


class FollowedTraining:
    """A folder of ``steersman train`` or ``imitate``, or of several seeds of one."""

    def __init__(self, folder: FilePath) -> None:
        """Follow what is, or will be, in the folder."""
        self._folder = folder

    def answer(self, given: TrainingRequest) -> dict[str, Any]:
        """The curves, with bands over seeds, if something is new; the newest policy as a word.

        Raises:
            DataError: a record is malformed.
        """
        files = sorted(self._folder.rglob("progress.csv"))
        policies = sorted(self._folder.rglob("policy.onnx"), key=_stamp)
        stamp = max(map(_stamp, [*files, *policies]), default=0.0)
        if stamp <= given.seen:
            return {"seen": given.seen}
        runs = [
            ReportRun(str(file.parent.relative_to(self._folder)), training=table)
            for file in files
            if (table := _progress(file)) is not None
        ]
        policy = ChosenPart(word="policy", fields={"file": str(policies[-1])}) if policies else None
        return {
            "seen": stamp,
            "training": curves(runs),
            "policy": None if policy is None else policy.model_dump(),
        }


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
