"""The whole study: stage after stage, each a line of a journal, and their results."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path as FilePath
from typing import Any, NamedTuple

import steersman as sm
from ddpg_mpc_pid.drives import ErrorDrives, circle, circle_tests, robustness, waypoint_errors
from ddpg_mpc_pid.learning_curves import learning_curves
from ddpg_mpc_pid.plan import METHODS, Plan
from ddpg_mpc_pid.results import (
    AwayResult,
    AwayTest,
    CircleResult,
    CircleTest,
    LearningCurves,
    MonzaResult,
    StudyResult,
    StudyTraining,
    TimingResult,
)
from ddpg_mpc_pid.timing import timing
from ddpg_mpc_pid.tracks import CAP, TUNED, WRONG, away, monza
from ddpg_mpc_pid.trainings import AT_ONCE, Progress, jobs, run_trainings

RESULTS = "results.json"
_GUARD, _JOURNAL = "plan.json", "stages.jsonl"
# Curves are many numbers; more digits would only be noise.
_DIGITS, CURVE_DIGITS = 6, 4
Say = Callable[[str], None]

# Measured on a laptop-class core, two trainings at a time: seconds for each update with the
# networks of the preset, and for what surrounds a training; minutes for the drives.
_UPDATE, _AROUND, _DRIVES = 0.0072, 8.0, 3.0
# About what a lap takes [s].
_LAP = 600.0


class Stage(NamedTuple):
    """A part of the study that is done on its own."""

    work: Callable[[], Any]
    size: float
    """About the simulated time [s]."""


class StageRecord(sm.StoredResult):
    """What a stage found, as a line of the journal."""

    stage: str
    seconds: float
    """Computing time."""
    commit: str | None
    versions: dict[str, str]
    result: Any


def open_journal(
    root: FilePath, plan: Plan, *, other_version: bool = False
) -> sm.Journal[StageRecord]:
    """The finished stages of a reproduction, begun or gone on with.

    Raises:
        sm.DataError: the folder belongs to another plan or, unless ``other_version``, was begun by
            another version of the program.
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
    line = sm.LineFormat(
        "a stage of this study; delete the file to do all stages again",
        StageRecord.model_validate_json,
        StageRecord.plain,
        lambda record: record.stage,
    )
    return sm.Journal(root / _JOURNAL, line)


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
    if isinstance(value, sm.StoredResult):
        value = value.model_dump()
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


def stages(plan: Plan, runs: FilePath) -> dict[str, Stage]:
    """The stages that drive, each of which needs the trainings and nothing else."""
    drivers, agents = len(plan.trainings()) + 2, plan.seeds
    whole = (plan.monza_seconds or _LAP, plan.away_seconds or _LAP)
    found: dict[str, Stage] = {
        f"circle, {test}": Stage(partial(circle, plan, runs, test), drivers * plan.circle_seconds)
        for test in circle_tests()
    }
    for redraw, words in ((True, "every step"), (False, "once")):
        for reach in plan.error_ranges:
            work = partial(waypoint_errors, plan, runs, redraw, reach)
            size = (agents + 1) * plan.circle_seconds
            found[f"waypoint errors to {reach:g} m, drawn {words}"] = Stage(work, size)
    found["monza"] = Stage(partial(monza, plan, runs), (agents + 2) * whole[0])
    for track in plan.away_tracks:
        for speed in plan.away_speeds:
            away_work = partial(away, plan, runs, track, speed)
            found[f"away, {track} at {speed:.3g} m/s"] = Stage(away_work, (agents + 4) * whole[1])
    return found


def done(
    todo: Mapping[str, Stage],
    journal: sm.Journal[StageRecord],
    say: Say,
    workers: sm.Workers | None = None,
) -> list[StageRecord]:
    """The records of stages, worked out now unless the journal has them; one by one by default."""
    for name in todo:
        if name in journal.results:
            say(f"{name}: finished already")
    work = [sm.Job(name, (name, stage.work), stage.size) for name, stage in todo.items()]
    with workers or sm.Workers("local", 1) as these:
        found = these.run(_recorded, work, journal=journal, listener=lambda name, _: say(name))
    return list(found.values())


def _recorded(payload: tuple[str, Callable[[], Any]], tell: Callable[[Any], None]) -> StageRecord:
    name, work = payload
    tell(None)
    begun = time.perf_counter()
    result = work()
    return StageRecord(
        stage=name,
        seconds=round(time.perf_counter() - begun, 2),
        **sm.provenance(),
        result=plain(result),
    )


@sm.files.alone("root")
def reproduce(
    plan: Plan,
    root: FilePath,
    progress: Progress,
    say: Say,
    *,
    other_version: bool = False,
    engine: str | None = None,
    at_once: int | None = None,
) -> StudyResult:
    """Do what is not done yet, and write and return ``results.json``.

    Interrupted anywhere, the same call goes on from there: trainings from their last checkpoint,
    the other stages from the last that was finished.

    Args:
        plan: what is trained and driven.
        root: folder of the study.
        progress: called with the trainings' progress.
        say: called with the name of each stage that begins.
        other_version: go on although another version of the program began.
        engine: "local" or "ray"; the results do not depend on it.
        at_once: trainings, and stages that drive, at a time; None: two trainings, and a stage for
            each core. Computing times are measured alone.

    Raises:
        DataError: the folder belongs to another plan or version.
        SteersmanError: a training failed for another reason than that it diverged.
    """
    journal, runs = open_journal(root, plan, other_version=other_version), root / "runs"
    train = Stage(partial(run_trainings, plan, runs, progress, engine, at_once), 1.0)
    trained = done({"trainings": train}, journal, say)
    driven = done(stages(plan, runs), journal, say, sm.Workers(engine, at_once))
    timed = done({"timing": Stage(partial(timing, plan, runs), 1.0)}, journal, say)
    found = {record.stage: record.result for record in driven}
    tests = [CircleTest(**found[f"circle, {test}"]) for test in circle_tests()]
    errors = [ErrorDrives(**v) for name, v in found.items() if name.startswith("waypoint errors")]
    ranges = len(plan.error_ranges)
    records = {name: StudyTraining(**value) for name, value in trained[0].result.items()}
    results = StudyResult(
        **sm.provenance(),
        made_by=sorted({str(record.commit) for record in (*trained, *driven, *timed)}),
        seconds={r.stage: r.seconds for r in (*trained, *driven, *timed)},
        plan=_plan(plan),
        learning=LearningCurves(**plain(learning_curves(plan, records), CURVE_DIGITS)),
        circle=CircleResult(tests=tests),
        robustness=robustness(plan, errors[:ranges], errors[ranges:]),
        monza=MonzaResult(**found["monza"]),
        away=AwayResult(
            tuned=TUNED,
            cap=CAP,
            tests=[AwayTest(**value) for name, value in found.items() if name.startswith("away,")],
        ),
        timing=TimingResult(**timed[0].result),
    )
    write_results(results, root)
    return results


def write_results(results: StudyResult, root: FilePath) -> None:
    """Write ``results.json`` into a study's folder."""
    text = json.dumps(results.plain(), allow_nan=False, separators=(",", ":"))
    sm.files.write_text(root / RESULTS, text + "\n")


def _plan(plan: Plan) -> dict[str, Any]:
    """The plan in short: the preset, what differs from it, methods, seeds."""
    return {
        **plan._asdict(),
        "digest": plan.digest(),
        "preset": "paper",
        "departures": [{"setting": s, "why": why} for s, why in plan.departures],
        "training_methods": {name: METHODS[name]._asdict() for name in plan.methods},
        "trainings": [job.name for job in jobs(plan, FilePath())],
        "wrong_parameters": WRONG,
    }
