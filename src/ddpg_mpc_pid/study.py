"""The whole study: stage after stage, each written to a file of its own, and their results."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path as FilePath
from typing import Any, NamedTuple

import steersman as sm
from ddpg_mpc_pid.drives import circle, robustness
from ddpg_mpc_pid.learning_curves import learning_curves
from ddpg_mpc_pid.plan import DEPARTURES, METHODS, Plan
from ddpg_mpc_pid.timing import timing
from ddpg_mpc_pid.tracks import WRONG, away, monza
from ddpg_mpc_pid.trainings import AT_ONCE, Progress, jobs, run_trainings

_GUARD = "plan.json"
_DIGITS = 6
Say = Callable[[str], None]

# The stages that drive, in their order. Computing time comes when no training runs beside it.
STAGES: dict[str, Callable[[Plan, FilePath], dict[str, Any]]] = {
    "circle": circle,
    "robustness": robustness,
    "monza": monza,
    "away": away,
    "timing": timing,
}
# Measured on a laptop-class core, two trainings at a time: seconds for each update with the
# networks of the preset, and for what surrounds a training; minutes for the drives.
_UPDATE, _AROUND, _DRIVES = 0.0072, 8.0, 3.0


# Curves are many numbers; more digits would only be noise.
_CURVE_DIGITS = 4


class Folder(NamedTuple):
    """Where a reproduction lives, and of which plan it is."""

    root: FilePath
    digest: str

    def file(self, stage: str) -> FilePath:
        """The file of a stage."""
        return self.root / "stages" / f"{stage}.json"

    def finished(self, stage: str) -> dict[str, Any] | None:
        """What a stage recorded; None if it is still to do.

        Raises:
            sm.DataError: the file is of another plan, or damaged.
        """
        file = self.file(stage)
        if not file.exists():
            return None
        record = _read(file)
        if record.get("plan") != self.digest:
            raise sm.DataError(f"{file}: made by another plan; delete it, or give another --out")
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
            "commit": sm.provenance()["commit"],
            "versions": sm.provenance()["versions"],
            "result": result,
        }
        sm.files.write_text(self.file(stage), json.dumps(record, allow_nan=False) + "\n")
        return record


def open_folder(root: FilePath, plan: Plan, *, other_version: bool = False) -> Folder:
    """The folder of a reproduction, made or gone on with.

    Raises:
        sm.DataError: it belongs to another plan or, unless ``other_version``, was begun by another
            version of the program.
    """
    digest, origin = plan.digest(), sm.provenance()
    file = sm.files.make_folder(root) / _GUARD
    if not file.exists():
        data = {"digest": digest, **origin, "plan": plan.data()}
        sm.files.write_text(file, json.dumps(data, indent=1) + "\n")
    begun = _read(file)
    if begun.get("digest") != digest:
        raise sm.DataError(
            f"{root}: holds a reproduction of another plan (other trainings, other tests, or "
            "--quick); give another --out"
        )
    for name in ("commit", "versions"):
        if begun.get(name) != origin[name] and not other_version:
            raise sm.DataError(
                f"{root}: begun with {name} {begun.get(name)}, now it is {origin[name]}; "
                "--other-version goes on all the same and records both"
            )
    return Folder(root, digest)


def _read(file: FilePath) -> dict[str, Any]:
    try:
        data = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise sm.DataError(f"{file}: cannot be read ({error}); delete it to do it again") from None
    if not isinstance(data, dict):
        raise sm.DataError(f"{file}: not a record of this study; delete it to do it again")
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


class StudyEstimate(NamedTuple):
    """What is to be done."""

    trainings: int
    updates: int
    """Of each training."""
    minutes: float


def estimate(plan: Plan) -> StudyEstimate:
    """How long the plan takes on two cores, roughly."""
    configs = [t.config for t in plan.trainings()]
    agents: list[Any] = [c.agent for c in configs]
    updates = [c.steps // a.vehicles * a.updates for c, a in zip(configs, agents, strict=True)]
    size = [a.hidden[0] * a.hidden[1] * a.batch / (400 * 300 * 256) for a in agents]
    training = sum(n * max(s, 0.02) * _UPDATE for n, s in zip(updates, size, strict=True))
    around = len(configs) * _AROUND
    drives = _DRIVES if plan.monza_seconds is None else 0.2
    return StudyEstimate(len(configs), max(updates), (training + around) / AT_ONCE / 60.0 + drives)


@sm.files.alone("root")
def reproduce(
    plan: Plan,
    root: FilePath,
    progress: Progress,
    say: Say,
    *,
    other_version: bool = False,
) -> dict[str, Any]:
    """Do what is not done yet, and write and return ``results.json``.

    Interrupted anywhere, the same call goes on from there: trainings from their last checkpoint,
    driving stages from the last that was finished.

    Raises:
        DataError: the folder belongs to another plan or version.
        SteersmanError: a training failed for another reason than that it diverged.
    """
    folder = open_folder(root, plan, other_version=other_version)
    runs = root / "runs"
    train = partial(run_trainings, plan, runs, progress)
    records = {"trainings": folder.run("trainings", train, say)}
    for name, stage in STAGES.items():
        records[name] = folder.run(name, partial(stage, plan, runs), say)
    trained = records["trainings"]["result"]
    found = {name: records[name]["result"] for name in STAGES}
    results = {
        "format": 1,
        **sm.provenance(),
        "made_by": sorted({str(record["commit"]) for record in records.values()}),
        "seconds": {name: record["seconds"] for name, record in records.items()},
        "plan": _plan(plan),
        "learning": plain(learning_curves(plan, trained), _CURVE_DIGITS),
        **found,
    }
    sm.files.write_text(
        root / "results.json", json.dumps(results, allow_nan=False, separators=(",", ":")) + "\n"
    )
    return results


def _plan(plan: Plan) -> dict[str, Any]:
    """The plan in short: the preset, what differs from it, methods, seeds."""
    return {
        **plan._asdict(),
        "digest": plan.digest(),
        "preset": "paper",
        "departures": [{"setting": s, "why": why} for s, why in DEPARTURES],
        "training_methods": {name: METHODS[name]._asdict() for name in plan.methods},
        "trainings": [job.name for job in jobs(plan, FilePath())],
        "wrong_parameters": WRONG,
    }
