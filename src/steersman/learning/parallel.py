"""Several trainings at a time, each in a process of its own.

Stable-Baselines3 draws from generators of the whole process, so trainings that shared one would
not repeat.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path as FilePath
from queue import Queue
from typing import IO, Any, NamedTuple

from steersman.config import dump
from steersman.errors import one_line
from steersman.learning.checkpoint import check_folder
from steersman.learning.config import TrainConfig
from steersman.learning.progress import TrainRow

# Every library that might bring its own threads for linear algebra.
_THREADS = (
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "BLIS_NUM_THREADS",
    "VECLIB_MAXIMUM_THREADS",
)
_PATIENCE = 60.0  # seconds that a process has to go away, also on a machine that is overloaded


class Job(NamedTuple):
    """A training and the folder it goes to."""

    name: str
    config: TrainConfig
    out: FilePath


class Event(NamedTuple):
    """What a running training has to say."""

    job: Job
    steps: float | None = None
    row: TrainRow | None = None
    """The new row of ``progress.csv``, at a validation."""
    note: str | None = None


class _Worker(NamedTuple):
    job: Job
    process: subprocess.Popen[bytes]
    errors: IO[bytes]
    listener: threading.Thread


def cores() -> int:
    """Cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def train_all(
    jobs: Sequence[Job],
    at_once: int,
    tell: Callable[[Event], None],
    *,
    overwrite: bool = False,
    resume: bool = False,
) -> dict[str, str]:
    """Run all trainings, ``at_once`` at a time; why those that failed did, by name.

    A training that fails does not stop the others. If this function is left by an exception
    (Ctrl-C), or its process dies, all trainings stop; ``resume`` goes on with them.

    Raises:
        DataError: a folder holds a training already.
        ConfigError: a training to be resumed has another configuration.
    """
    for job in jobs:
        check_folder(job.config, job.out, overwrite=overwrite, resume=resume)
    waiting, running, failed = list(jobs), dict[str, _Worker](), dict[str, str]()
    messages: Queue[tuple[str, dict[str, Any] | None]] = Queue()
    try:
        while waiting or running:
            while waiting and len(running) < max(at_once, 1):
                job = waiting.pop(0)
                request = {"out": str(job.out), "overwrite": overwrite, "resume": resume}
                running[job.name] = _start(job, request, messages)
            name, message = messages.get()
            if message is None:
                worker = running.pop(name)
                fault = _fault(worker)
                if fault is not None:
                    failed.setdefault(name, fault)
            elif "error" in message:
                failed[name] = str(message["error"])
            else:
                if "row" in message:
                    message["row"] = TrainRow(**message["row"])
                tell(Event(running[name].job, **message))
    finally:
        for worker in running.values():
            worker.process.kill()
        for worker in running.values():
            _close(worker)
    return failed


def _start(
    job: Job, request: dict[str, Any], messages: Queue[tuple[str, dict[str, Any] | None]]
) -> _Worker:
    threads = dict.fromkeys(_THREADS, str(job.config.threads))
    errors = tempfile.TemporaryFile()  # noqa: SIM115 - lives as long as the process
    process = subprocess.Popen(
        [sys.executable, "-m", "steersman.learning.worker"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=errors,
        env=os.environ | threads,
    )
    assert process.stdin is not None
    with suppress(BrokenPipeError):  # its end says more
        process.stdin.write(json.dumps(request | {"config": dump(job.config)}).encode() + b"\n")
        process.stdin.flush()

    def listen() -> None:
        assert process.stdout is not None
        with suppress(ValueError):  # killed in the middle of a line
            for line in process.stdout:
                messages.put((job.name, json.loads(line)))
        messages.put((job.name, None))

    listener = threading.Thread(target=listen, daemon=True)
    listener.start()
    return _Worker(job, process, errors, listener)


def _close(worker: _Worker) -> tuple[int, str]:
    """Wait for a process to end; its exit code and what it wrote to its standard error."""
    try:
        code = worker.process.wait(_PATIENCE)
    except subprocess.TimeoutExpired:  # it hangs on its way out
        worker.process.kill()
        code = worker.process.wait()
    worker.listener.join(_PATIENCE)
    for stream in (worker.process.stdin, worker.process.stdout):
        if stream is not None:
            with suppress(OSError):
                stream.close()
    with worker.errors as errors:
        errors.seek(0)
        return code, errors.read().decode("utf-8", "replace").strip()


def _fault(worker: _Worker) -> str | None:
    """What went wrong in a process that closed its output; its traceback goes into the folder."""
    code, text = _close(worker)
    if code == 0:
        return None
    if code < 0:
        return f"killed by {signal.Signals(-code).name}"
    last = one_line(text.rpartition("\n")[2]) or f"exit code {code}"
    if "Traceback" in text and worker.job.out.is_dir():
        log = worker.job.out / "traceback.txt"
        log.write_text(text + "\n", encoding="utf-8")
        return f"{last} (see {log})"
    return last
