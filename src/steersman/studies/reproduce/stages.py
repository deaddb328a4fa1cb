"""Stages, each written to a file of its own: what is done is done, whenever the rest follows."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from pathlib import Path as FilePath
from typing import Any, NamedTuple

from steersman.errors import DataError
from steersman.files import make_folder, write_text
from steersman.provenance import provenance
from steersman.studies.reproduce.plan import Plan

_GUARD = "plan.json"
_DIGITS = 6
Say = Callable[[str], None]


class Folder(NamedTuple):
    """Where a reproduction lives, and of which plan it is."""

    root: FilePath
    digest: str

    @property
    def runs(self) -> FilePath:
        """Trainings."""
        return self.root / "runs"

    def file(self, stage: str) -> FilePath:
        """The file of a stage."""
        return self.root / "stages" / f"{stage}.json"

    def finished(self, stage: str) -> dict[str, Any] | None:
        """What a stage recorded; None if it is still to do.

        Raises:
            DataError: the file is of another plan, or damaged.
        """
        file = self.file(stage)
        if not file.exists():
            return None
        record = _read(file)
        if record.get("plan") != self.digest:
            raise DataError(f"{file}: made by another plan; delete it, or give another --out")
        return record

    def run(self, stage: str, work: Callable[[], Any], say: Say) -> dict[str, Any]:
        """The record of a stage, worked out now unless it is there."""
        record = self.finished(stage)
        if record is not None:
            say(f"{stage}: finished already")
            return record
        say(stage)
        begun = time.perf_counter()
        result = plain(work())
        record = {
            "plan": self.digest,
            "seconds": round(time.perf_counter() - begun, 2),
            "commit": provenance()["commit"],
            "versions": provenance()["versions"],
            "result": result,
        }
        write_text(self.file(stage), json.dumps(record, allow_nan=False) + "\n")
        return record


def open_folder(root: FilePath, plan: Plan, *, other_version: bool = False) -> Folder:
    """The folder of a reproduction, made or gone on with.

    Raises:
        DataError: it belongs to another plan or, unless ``other_version``, was begun by another
            version of the program.
    """
    digest, origin = plan.digest(), provenance()
    file = make_folder(root) / _GUARD
    if not file.exists():
        data = {"digest": digest, **origin, "plan": plan.data()}
        write_text(file, json.dumps(data, indent=1) + "\n")
    begun = _read(file)
    if begun.get("digest") != digest:
        raise DataError(
            f"{root}: holds a reproduction of another plan (other trainings, other tests, or "
            "--quick); give another --out"
        )
    for name in ("commit", "versions"):
        if begun.get(name) != origin[name] and not other_version:
            raise DataError(
                f"{root}: begun with {name} {begun.get(name)}, now it is {origin[name]}; "
                "--other-version goes on all the same and records both"
            )
    return Folder(root, digest)


def _read(file: FilePath) -> dict[str, Any]:
    try:
        data = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise DataError(f"{file}: cannot be read ({error}); delete it to do it again") from None
    if not isinstance(data, dict):
        raise DataError(f"{file}: not a record of this study; delete it to do it again")
    return data


def plain(value: Any, digits: int = _DIGITS) -> Any:
    """Data for JSON: numbers rounded to so many digits, what is not finite as None."""
    if isinstance(value, dict):
        return {str(k): plain(v, digits) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(v, digits) for v in value]
    if isinstance(value, bool) or value is None or isinstance(value, (str, int)):
        return value
    number = float(value)
    return float(f"{number:.{digits}g}") if abs(number) < float("inf") else None
