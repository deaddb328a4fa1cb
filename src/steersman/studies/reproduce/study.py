"""The whole study: stage after stage, and what they found as one file."""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import partial
from pathlib import Path as FilePath
from typing import Any, NamedTuple, cast

from steersman.files import alone, write_text
from steersman.learning.algorithms.ddpg import Ddpg
from steersman.provenance import provenance
from steersman.studies.reproduce.away import WRONG, away
from steersman.studies.reproduce.circle import circle
from steersman.studies.reproduce.learning_curves import learning_curves
from steersman.studies.reproduce.monza import monza
from steersman.studies.reproduce.plan import DEPARTURES, METHODS, Plan
from steersman.studies.reproduce.robustness import robustness
from steersman.studies.reproduce.stages import Folder, Say, open_folder, plain
from steersman.studies.reproduce.timing import timing
from steersman.studies.reproduce.trainings import AT_ONCE, Progress, jobs, run_trainings

# The stages that drive, in their order. Computing time comes when no training runs beside it.
STAGES: dict[str, Callable[[Plan, Folder], dict[str, Any]]] = {
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


class Estimate(NamedTuple):
    """What is to be done."""

    trainings: int
    updates: int
    """Of each training."""
    minutes: float


def estimate(plan: Plan) -> Estimate:
    """How long the plan takes on two cores, roughly."""
    configs = [t.config for t in plan.trainings()]
    agents = [cast(Ddpg, c.agent) for c in configs]
    updates = [c.steps // a.vehicles * a.updates for c, a in zip(configs, agents, strict=True)]
    size = [a.hidden[0] * a.hidden[1] * a.batch / (400 * 300 * 256) for a in agents]
    training = sum(n * max(s, 0.02) * _UPDATE for n, s in zip(updates, size, strict=True))
    around = len(configs) * _AROUND
    drives = _DRIVES if plan.monza_seconds is None else 0.2
    return Estimate(len(configs), max(updates), (training + around) / AT_ONCE / 60.0 + drives)


@alone("root")
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
    records = {
        "trainings": folder.run("trainings", partial(run_trainings, plan, folder, progress), say)
    }
    for name, stage in STAGES.items():
        records[name] = folder.run(name, partial(stage, plan, folder), say)
    trained = records["trainings"]["result"]
    found = {name: records[name]["result"] for name in STAGES}
    results = {
        "format": 1,
        **provenance(),
        "made_by": sorted({str(record["commit"]) for record in records.values()}),
        "seconds": {name: record["seconds"] for name, record in records.items()},
        "plan": _plan(plan),
        "learning": plain(learning_curves(plan, trained), _CURVE_DIGITS),
        **found,
    }
    write_text(
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
        "trainings": [job.name for job in jobs(plan, Folder(FilePath(), ""))],
        "wrong_parameters": WRONG,
    }
