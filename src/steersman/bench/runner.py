"""Every entrant drives every scenario: in parallel, resumable, in the same order every time."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from pathlib import Path as FilePath
from typing import Any, NamedTuple

from steersman.bench import drive
from steersman.bench.engines import ENGINES
from steersman.bench.entrants import Entrant
from steersman.bench.journal import Journal
from steersman.bench.results import BenchRow
from steersman.bench.suite import Scenario
from steersman.errors import ConfigError, suggestion
from steersman.files import alone

# Simulated time that one piece of work holds [s], and the most runs in it: large enough that
# handing it out costs nothing, small enough that an interruption loses little.
_CHUNK_SECONDS = 1200.0
_CHUNK_RUNS = 24


class Task(NamedTuple):
    """One run of the plan, and the key of its row."""

    scenario: Scenario
    entrant: Entrant
    key: str


Progress = Callable[[float, float], None]


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
    engine: str = "local",
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
        engine: where it is computed: ``local``, or on a cluster with ``ray``.
        jobs: processes at a time on this machine; None: one for each core.
        progress: called with about (simulated seconds done, simulated seconds in all).

    Raises:
        ConfigError: a controller does not fit the suite, or the engine is unknown.
        DataError: the journal cannot be read or written.
    """
    if engine not in ENGINES:
        raise ConfigError(f"unknown engine {engine!r}{suggestion(engine, ENGINES)}")
    tasks = plan(scenarios, entrants)
    journal = Journal(out)
    todo = [task for task in tasks if task.key not in journal.rows]
    for entrant in {task.entrant.name: task.entrant for task in todo}.values():
        drive.check(scenarios[0], entrant)
    total = sum(drive.planned_seconds(task.scenario) for task in tasks)
    done = total - sum(drive.planned_seconds(task.scenario) for task in todo)
    seconds = {task.key: drive.planned_seconds(task.scenario) for task in todo}
    for rows in ENGINES[engine](_row, chunks(todo), jobs or os.cpu_count() or 1):
        journal.add(rows)
        done += sum(seconds[row.key] for row in rows)
        if progress is not None:
            progress(done, total)
    # A journal may hold the row of the same controller under another name.
    return [
        journal.rows[task.key].model_copy(update={"controller": task.entrant.name})
        for task in tasks
    ]


def _row(task: Any) -> BenchRow:
    return drive.measure(task.scenario, task.entrant, task.key)


def chunks(tasks: Sequence[Task]) -> list[list[Task]]:
    """Pieces of work of about equal length, the longest runs first so that none ends last."""
    out: list[list[Task]] = []
    seconds = 0.0
    for task in sorted(tasks, key=lambda task: -drive.planned_seconds(task.scenario)):
        if not out or seconds >= _CHUNK_SECONDS or len(out[-1]) >= _CHUNK_RUNS:
            out.append([])
            seconds = 0.0
        out[-1].append(task)
        seconds += drive.planned_seconds(task.scenario)
    return out
