"""Every entrant drives every scenario: in parallel, resumable, in the same order every time."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path as FilePath
from typing import NamedTuple

from steersman.bench import drive
from steersman.bench.entrants import Entrant
from steersman.bench.results import BenchRow
from steersman.bench.suite import Scenario
from steersman.engine.jobs import Progress, Workers
from steersman.engine.journal import Journal, LineFormat, read_journal
from steersman.engine.work import Job
from steersman.files import alone

ROWS = "rows.jsonl"
_FORMAT: LineFormat[BenchRow] = LineFormat(
    "a row of a benchmark", BenchRow.model_validate_json, BenchRow.plain, lambda row: row.key
)


def read_rows(folder: FilePath) -> dict[str, BenchRow]:
    """The finished rows of a benchmark's folder by their key; nothing in it is changed.

    Raises:
        DataError: the file is no journal of a benchmark.
    """
    return read_journal(folder / ROWS, _FORMAT)


class Task(NamedTuple):
    """One run of the plan, and the key of its row."""

    scenario: Scenario
    entrant: Entrant
    key: str


def plan(scenarios: Sequence[Scenario], entrants: Sequence[Entrant]) -> list[Task]:
    """All runs, scenario by scenario."""
    tasks = []
    for scenario in scenarios:
        digest = drive.digest(scenario)
        for entrant in entrants:
            key = drive.key(digest, drive.fitted(scenario, entrant), entrant)
            tasks.append(Task(scenario, entrant, key))
    return tasks


@alone("out")
def bench(
    scenarios: Sequence[Scenario],
    entrants: Sequence[Entrant],
    out: FilePath,
    *,
    engine: str | None = None,
    jobs: int | None = None,
    progress: Progress | None = None,
) -> list[BenchRow]:
    """Drive what is not yet driven, and return the rows of all tasks, scenario by scenario.

    Rows are kept in ``out`` as they come, under keys that change with scenario and controller:
    interrupted anywhere, the same call goes on, and a further controller costs only its own runs.
    The rows do not depend on the engine, on the number of jobs or on interruptions, but for the
    computing times.

    Args:
        scenarios: what is driven.
        entrants: the controllers.
        out: folder of the journal.
        engine: ``local`` or ``ray``, see :class:`steersman.engine.jobs.Workers`.
        jobs: drives at a time; None: one for each core.
        progress: called with the simulated seconds done and in all, both as planned.

    Raises:
        ConfigError: a controller does not fit the suite, or the engine is unknown.
        DataError: the journal cannot be read or written.
    """
    tasks = plan(scenarios, entrants)
    journal = Journal(out / ROWS, _FORMAT)
    todo = [task for task in tasks if task.key not in journal.results]
    for entrant in {task.entrant.digest: task.entrant for task in todo}.values():
        drive.check(scenarios[0], entrant)
    each = [Job(task.key, task, drive.planned_seconds(task.scenario.run)) for task in tasks]
    with Workers(engine, jobs) as workers:
        rows = workers.run(_row, each, journal=journal, progress=progress)
    # A journal may hold the row of the same controller under another name.
    return [rows[task.key].model_copy(update=_names(task.entrant)) for task in tasks]


def _names(entrant: Entrant) -> dict[str, str]:
    return {"controller": entrant.name, "replicate": entrant.replicate}


def _row(task: Task, _: object) -> BenchRow:
    return drive.measure(task.scenario, task.entrant, task.key)
