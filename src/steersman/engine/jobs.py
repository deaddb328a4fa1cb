"""Run many jobs, on local processes or on a Ray cluster; results depend on neither."""

from __future__ import annotations

import itertools
import os
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any, TypeAlias

from steersman.engine.cluster import RayCluster
from steersman.engine.journal import Journal
from steersman.engine.processes import LocalProcesses
from steersman.engine.work import Job, Listener, Outcome, Work, WorkerDied, packed
from steersman.errors import ConfigError, SteersmanError, suggestion

ENGINES = ("local", "ray")
# Called with the size of the jobs that are done, and of all.
Progress: TypeAlias = Callable[[float, float], None]

# Size of a piece of work, if its jobs are measured in simulated seconds, and the most jobs in it:
# large enough that handing it out costs nothing, small enough that an interruption loses little.
PIECE_SIZE = 1200.0
_PIECE_JOBS = 24


def cores() -> int:
    """Cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def engine_name(engine: str | None) -> str:
    """The name of the backend; None: ``ray`` if ``RAY_ADDRESS`` is set, else ``local``.

    Raises:
        ConfigError: there is no such backend.
    """
    if engine is None:
        return "ray" if os.environ.get("RAY_ADDRESS") else "local"
    if engine not in ENGINES:
        raise ConfigError(f"unknown engine {engine!r}{suggestion(engine, ENGINES)}")
    return engine


class Workers:
    """Processes that do jobs; a context manager, at whose end all of them are gone.

    With one process at a time, or with little to do, jobs run in the calling process.
    """

    def __init__(
        self,
        engine: str | None = None,
        at_once: int | None = None,
        *,
        apart: bool = False,
        threads: int = 1,
        needs: Sequence[str] = ("steersman.rollout",),
    ) -> None:
        """Choose a backend; nothing starts before there is work for it.

        Args:
            engine: of :func:`engine_name`.
            at_once: jobs at a time; None: one for each core of this machine or of the cluster.
            apart: whether each job has a process of its own, as work needs that draws from random
                generators of its process. An error then concerns its job alone.
            threads: threads of the linear algebra in each process.
            needs: modules that the work imports, so that local processes have them at once.

        Raises:
            ConfigError: there is no such engine, or ``at_once`` is less than 1.
        """
        if at_once is not None and at_once < 1:
            raise ConfigError(f"{at_once} jobs at a time are not allowed; at least 1 is")
        self._engine, self._at_once = engine_name(engine), at_once
        self._apart, self._threads, self._needs = apart, threads, needs
        self._backend: LocalProcesses | RayCluster | None = None

    def __enter__(self) -> Workers:
        return self

    def __exit__(self, *_: object) -> None:
        if self._backend is not None:
            self._backend.close()
            self._backend = None

    @property
    def parallel(self) -> bool:
        """Whether jobs may run at the same time."""
        return self._engine != "local" or (self._at_once or cores()) > 1

    def outcomes(
        self,
        work: Work,
        jobs: Sequence[Job],
        *,
        listener: Listener = lambda *_: None,
        piece_size: float = PIECE_SIZE,
    ) -> Iterator[list[Outcome]]:
        """What came of the jobs, some at a time, in the order in which they end.

        Args:
            work: a function (payload, tell) -> result.
            jobs: the jobs; the largest are done first.
            listener: called with a job's key and whatever its work gives to ``tell``.
            piece_size: size from which jobs are handed out together; one piece alone is done in
                this process, unless jobs are apart.
        """
        pieces = [[job] for job in jobs] if self._apart else _pieces(jobs, piece_size)
        if not self._apart and (not self.parallel or len(pieces) <= 1):
            for job in itertools.chain(*pieces):
                yield [Outcome(job.key, work(job.payload, partial(listener, job.key)))]
            return
        if self._backend is None:
            self._backend = self._opened()
        yield from self._backend.outcomes([packed(work, piece) for piece in pieces], listener)

    def run(
        self,
        work: Work,
        jobs: Sequence[Job],
        *,
        journal: Journal[Any] | None = None,
        progress: Progress | None = None,
        listener: Listener = lambda *_: None,
        piece_size: float = PIECE_SIZE,
    ) -> dict[str, Any]:
        """The results of all jobs by their keys; the first error ends it.

        Jobs whose results the journal has are not done again; new results are added to it as they
        come, so that after an interruption the same call goes on.

        Raises:
            SteersmanError: a job raised it, or its process was killed, for want of memory for
                example.
            DataError: the journal cannot be written.
        """
        found: dict[str, Any] = {} if journal is None else dict(journal.results)
        todo = [job for job in jobs if job.key not in found]
        sizes = {job.key: job.size for job in jobs}
        total = sum(sizes.values())
        done = total - sum(job.size for job in todo)
        for outcomes in self.outcomes(work, todo, listener=listener, piece_size=piece_size):
            new = {each.key: each.result for each in outcomes if each.error is None}
            if journal is not None:
                journal.add(*new.values())
            found |= new
            done += sum(sizes[key] for key in new)
            if progress is not None:
                progress(done, total)
            _raise_first(outcomes)
        return {job.key: found[job.key] for job in jobs}

    def _opened(self) -> LocalProcesses | RayCluster:
        if self._engine == "local":
            at_once = self._at_once or cores()
            return LocalProcesses(
                at_once, apart=self._apart, threads=self._threads, needs=self._needs
            )
        return RayCluster(self._at_once, apart=self._apart, threads=self._threads, cores=cores())


def _raise_first(outcomes: Sequence[Outcome]) -> None:
    error = next((each.error for each in outcomes if each.error is not None), None)
    if isinstance(error, WorkerDied):
        raise SteersmanError(
            f"a process was lost ({error}); the same command goes on, with fewer --jobs if memory "
            "ran out"
        )
    if error is not None:
        raise error


def _pieces(jobs: Sequence[Job], most: float) -> list[list[Job]]:
    """Pieces of work of about equal size, the largest jobs first so that none ends last."""
    out: list[list[Job]] = []
    size = 0.0
    for job in sorted(jobs, key=lambda job: -job.size):
        if not out or size >= most or len(out[-1]) >= _PIECE_JOBS:
            out.append([])
            size = 0.0
        out[-1].append(job)
        size += job.size
    return out
