"""Workers: end with their parent, import from where it does, fail one by one."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path as FilePath
from typing import Any

import pytest

from steersman.engine import fork_server
from steersman.engine.jobs import Workers
from steersman.engine.journal import Journal, LineFormat
from steersman.engine.work import Job
from steersman.errors import ConfigError, DataError, SteersmanError

posix = pytest.mark.skipif(sys.platform == "win32", reason="needs POSIX signals")
JOBS = [Job(str(x), x) for x in range(4)]
LINES: LineFormat[dict[str, int]] = LineFormat(
    "a square",
    lambda line: {"x": int(line.split(b'"x": ')[1][:1])},
    dict,
    lambda row: str(row["x"]),
)
# A program whose workers write their process ids, and then sleep.
SLEEPING = """
import os, sys, time
from steersman.engine import fork_server
from steersman.engine.jobs import Workers
from steersman.engine.work import Job
def sleep(file, tell):
    open(file, "w").write(str(os.getpid()))
    time.sleep(600)
with Workers("local", 2) as workers:
    workers.run(sleep, [Job(f, f) for f in sys.argv[1:]], piece_size=1)
"""


def test_results_do_not_depend_on_processes() -> None:
    def square(x: int, tell: Any) -> int:
        tell(-x)
        return x * x

    told: list[tuple[str, int]] = []
    done: list[float] = []
    for at_once in (1, 2):
        with Workers("local", at_once) as workers:
            found = workers.run(
                square,
                JOBS,
                listener=lambda *event: told.append(event),
                progress=lambda part, _: done.append(part),
                piece_size=1.0,
            )
        assert found == {"0": 0, "1": 1, "2": 4, "3": 9}
    assert sorted(told) == sorted(2 * [(str(x), -x) for x in range(4)])
    assert done[3] == done[-1] == 4.0


def test_apart_each_has_a_process_of_its_own() -> None:
    def process(x: int, _: Any) -> int:
        return os.getpid()

    with Workers("local", 1, apart=True) as workers:
        assert len({os.getpid(), *workers.run(process, JOBS).values()}) == 5


def test_an_error_is_that_of_the_job_and_what_is_finished_stays(tmp_path: FilePath) -> None:
    def fail(x: int, _: Any) -> dict[str, int]:
        if x == 2:
            raise DataError("x: too large")
        return {"x": x}

    journal = Journal(tmp_path / "squares.jsonl", LINES)
    with Workers("local", 2) as workers, pytest.raises(DataError, match="too large"):
        workers.run(fail, JOBS[:3], journal=journal, piece_size=3.0)
    with Workers("local", 1) as workers, pytest.raises(DataError, match="too large"):
        workers.run(fail, JOBS[:3], journal=journal)
    assert Journal(tmp_path / "squares.jsonl", LINES).results == {"0": {"x": 0}, "1": {"x": 1}}


def test_an_unexpected_error_keeps_its_traceback() -> None:
    def crash(x: int, _: Any) -> float:
        return 1 / x

    with Workers("local", 1, apart=True) as workers, pytest.raises(ZeroDivisionError) as caught:
        workers.run(crash, JOBS[:1])
    assert "in crash" in caught.value.__notes__[0]


@posix
def test_a_killed_worker_is_named() -> None:
    def die(x: int, _: Any) -> None:
        os.kill(os.getpid(), signal.SIGKILL)

    told = r"killed by SIGKILL\); the same command goes on"
    with Workers("local", 1, apart=True) as workers, pytest.raises(SteersmanError, match=told):
        workers.run(die, JOBS[:1])


def test_an_exit_code_is_told() -> None:
    def leave(x: int, _: Any) -> None:
        os._exit(3)

    with Workers("local", 1, apart=True) as workers, pytest.raises(SteersmanError, match="code 3"):
        workers.run(leave, JOBS[:1])


@pytest.mark.skipif(not fork_server.AVAILABLE, reason="needs Linux")
def test_workers_have_what_they_need_and_a_lost_server_is_replaced() -> None:
    def looks(x: int, _: Any) -> tuple[bool, str]:
        there = "steersman.paths.random_road" in sys.modules
        stat = FilePath(f"/proc/{os.getppid()}/stat").read_text()
        return there, stat.rpartition(") ")[2].split()[1]

    def found() -> tuple[bool, str]:
        with Workers("local", 1, apart=True, needs=("steersman.paths.random_road",)) as workers:
            (result,) = workers.run(looks, JOBS[:1]).values()
        assert isinstance(result, tuple)
        return result

    (there, server), (_, same) = found(), found()
    assert there
    assert server == same
    os.kill(int(server), signal.SIGKILL)
    while alive(int(server)):
        time.sleep(0.01)
    assert found()[1] != server


@posix
@pytest.mark.parametrize("end", [signal.SIGKILL, signal.SIGINT])
def test_workers_end_with_their_parent(tmp_path: FilePath, end: signal.Signals) -> None:
    files = [tmp_path / name for name in ("a", "b")]
    parent = subprocess.Popen(
        [sys.executable, "-c", SLEEPING, *map(str, files)], stderr=subprocess.DEVNULL
    )
    deadline = time.monotonic() + 60.0
    while not all(file.exists() and file.read_text() for file in files):
        assert time.monotonic() < deadline
        time.sleep(0.05)
    parent.send_signal(end)
    parent.wait(10.0)
    processes = [int(file.read_text()) for file in files]
    deadline = time.monotonic() + 10.0
    while any(alive(process) for process in processes):
        assert time.monotonic() < deadline
        time.sleep(0.05)


def alive(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    stat = FilePath(f"/proc/{process}/stat")  # one that ended and that nobody waited for is none
    return not (stat.exists() and stat.read_text().rpartition(") ")[2].startswith("Z"))


def test_workers_do_not_import_from_the_working_directory(
    tmp_path: FilePath, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "queue.py").write_text("raise SystemExit('of the working directory')\n")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [p for p in sys.path if p not in {"", str(tmp_path)}])

    def where(x: int, _: Any) -> tuple[str, list[str]]:
        import queue

        return str(queue.__file__), sys.path

    with Workers("local", 1, apart=True) as workers:
        file, path = workers.run(where, JOBS[:1])["0"]
    assert FilePath(file).parent != tmp_path
    assert path == sys.path


def test_wrong_words_are_refused() -> None:
    with pytest.raises(ConfigError, match="unknown engine 'rey'; did you mean 'ray'"):
        Workers("rey")
    with pytest.raises(ConfigError, match="at least 1"):
        Workers("local", 0)
