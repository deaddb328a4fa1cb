"""Hours of work with flat memory, and kills at random moments that lose nothing.

    python benchmarks/soak.py [--minutes 60] [--kills 100] [--seed 0] [--out results/soak]

A part that is given 0 is left out; each has its record.

Memory: a training, benchmarks one after another in one process, a CARLA stand-in with clients
that come and go, and a drive of ten hours run side by side for that time, the drive to its end.
The resident memory of each (with its workers) is read twice a second. A job is flat if the median
of the last fifth exceeds that of the second fifth by at most 5 % or 10 MB; of the drive, that of
the last but one, since what is written at its end is no growth.

Kills, at the same time: each command that resumes is run whole, then again, killed (SIGKILL, its
workers too) at moments drawn over its whole length, every second one after the first checkpoint is
there, until its share of the kills is spent; then it runs to its end, and its results must be those
of the whole run, to the bit, but for times.
"""

from __future__ import annotations

import argparse
import json
import os
import queue
import shutil
import signal
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from steersman.files import write_text
from steersman.provenance import provenance

Row = dict[str, object]
RESUMED = [sys.executable, "-m", "steersman"]
FLAT, FLAT_MB = 1.05, 10.0
SETTLED = 0.5
"""Checkpoints must be there at that share of the kills."""
DRIVE = 36_000
"""Simulated time of the long drive [s]."""
SMALL = """problem:
  roads: [{kind: circle, radius: 40.0}]
  speeds: [{kind: random_profile, low: 5.0, high: 12.0}]
  episode_time: 4.0
agent: {hidden: [16, 16], batch: 32, buffer: 4000, vehicles: 4, updates: 1, learning_starts: 200}
validation: {roads: [{kind: random_road, seed: 1000}], vehicles: 2, interval: 400}
steps: 1600
checkpoint_interval: 200
"""
COPIED = """problem:
  roads: [{kind: circle, radius: 40.0}]
  speeds: [{kind: random_profile, low: 5.0, high: 12.0}]
  episode_time: 4.0
fit: {hidden: [16, 16], updates: 800, batch: 32}
validation: {roads: [{kind: random_road, seed: 1000}], vehicles: 2}
steps: 3000
rounds: 8
"""
SUITE = """courses:
  circle: {path: circle, duration: 10, speeds: {slow: {kind: constant_speed, speed: 8}}}
  eight: {path: figure_eight, duration: 10, speeds: {slow: {kind: constant_speed, speed: 8}}}
disturbances: {clean: {}, soft: {c_f: 0.7}, late: {delay: 0.1}}
"""
BENCHES = """
import sys, tempfile, steersman as sm
while True:
    with tempfile.TemporaryDirectory() as out:
        sm.bench("tuned/lqr", "tuned/pid_feedforward", suite=sys.argv[1], out=out, jobs=1)
"""
CLIENTS = """
import sys, carla
client = carla.Client("127.0.0.1", int(sys.argv[1]))
client.set_timeout(20.0)
while True:
    world = client.get_world()
    settings = world.get_settings()
    settings.synchronous_mode, settings.fixed_delta_seconds = True, 0.05
    world.apply_settings(settings)
    kinds = world.get_blueprint_library()
    car = world.spawn_actor(kinds.filter("model3")[0], world.get_map().get_spawn_points()[0])
    imu = world.spawn_actor(kinds.find("sensor.other.imu"), carla.Transform(), attach_to=car)
    heard = []
    imu.listen(heard.append)
    for k in range(200):
        car.apply_control(carla.VehicleControl(throttle=0.4, steer=0.1))
        world.tick()
    imu.stop()
    imu.destroy()
    car.destroy()
"""


class Command(NamedTuple):
    """A command that resumes, and what is compared of what it writes."""

    name: str
    words: tuple[str, ...]
    again: tuple[str, ...]
    """Further words when its folder is there already."""
    kept: tuple[str, ...]
    """Files that show that something would be resumed."""
    results: tuple[str, ...]


COMMANDS = (
    Command("train", ("train", "small.yaml"), ("--resume",), ("resume/*.npz",), ("policy.onnx",)),
    Command(
        "train seeds",
        ("train", "small.yaml", "seeds=0..1", "steps=1200", "--jobs", "1"),
        ("--resume",),
        ("seed_*/resume/*.npz", "seed_*/policy.onnx"),
        ("seed_0/policy.onnx", "seed_1/policy.onnx"),
    ),
    Command(
        "imitate", ("imitate", "copied.yaml"), ("--resume",), ("resume/*.npz",), ("policy.onnx",)
    ),
    Command(
        "search",
        (
            "search",
            "small.yaml",
            "steps=600",
            "agent.gamma=0.9..0.99",
            "seeds=0",
            "--trials",
            "4",
            "--jobs",
            "1",
        ),
        (),
        ("study.jsonl",),
        ("best.yaml",),
    ),
    Command(
        "tune",
        ("tune", "tuned/pid", "suite=suite.yaml", "--trials", "24", "--jobs", "1"),
        (),
        ("study.jsonl",),
        ("tuned.yaml",),
    ),
    Command(
        "bench",
        (
            "bench",
            "suite.yaml",
            "--controllers",
            "tuned/lqr,tuned/mpc_pid,tuned/stanley",
            "--jobs",
            "1",
        ),
        (),
        ("rows.jsonl",),
        ("results.json",),
    ),
)


def main() -> None:
    """Both parts, and the record."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=60.0)
    parser.add_argument("--kills", type=int, default=100)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, default=Path("results/soak"))
    words = parser.parse_args()
    made = {"minutes": words.minutes, "kills": words.kills, "seed": words.seed, **provenance()}
    rows = defaultdict[str, list[Row]](list)
    rng = np.random.default_rng(words.seed)
    share = -(-words.kills // len(COMMANDS))
    found: queue.Queue[tuple[str, Row | None]] = queue.Queue()
    held = True
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for file, text in (("small", SMALL), ("copied", COPIED), ("suite", SUITE)):
            (folder / f"{file}.yaml").write_text(text)
        parts: dict[str, Iterator[Row]] = {}
        if share:
            parts["kills"] = (kills(command, folder, share, rng) for command in COMMANDS)
        if words.minutes:
            parts["memory"] = watched(begun(folder), 60.0 * words.minutes)
        for each in parts.items():
            threading.Thread(target=told, args=(found, *each), daemon=True).start()
        left = len(parts)
        while left:
            part, row = found.get()
            if row is None:
                left -= 1
                continue
            rows[part].append(row)
            held &= bool(row["held"])
            sys.stdout.write(json.dumps(row) + "\n")
            sys.stdout.flush()
            record = json.dumps({"made": made, "rows": rows[part]}, indent=1)
            write_text(words.out / f"{part}.json", record + "\n")
    raise SystemExit(not held)


def told(found: queue.Queue[tuple[str, Row | None]], part: str, rows: Iterator[Row]) -> None:
    """Put the rows of a part into the queue as they come, and None behind the last."""
    try:
        for row in rows:
            found.put((part, row))
    except BaseException as error:
        found.put((part, {"fails": repr(error), "held": False}))
        raise
    finally:
        found.put((part, None))


class Job:
    """Processes in sessions of their own, the first of which is watched."""

    def __init__(self, name: str, *processes: subprocess.Popen[bytes], whole: bool = False) -> None:
        """``whole``: it has to run to its end, however long that takes."""
        self.name, self.processes, self.whole = name, processes, whole
        self.sizes: list[float] = []
        self.begun = time.monotonic()
        self.seconds = 0.0

    def running(self, seconds: float) -> bool:
        """Whether it still runs and has time left."""
        self.seconds = time.monotonic() - self.begun
        in_time = self.whole or self.seconds < seconds
        return in_time and all(process.poll() is None for process in self.processes)

    def row(self) -> Row:
        """End what runs; its memory over time."""
        ended = [process.poll() for process in self.processes]
        for process in self.processes:
            killed(process)
        fifth = max(len(self.sizes) // 5, 1)
        early = statistics.median(self.sizes[fifth : 2 * fifth] or [0.0])
        last = self.sizes[-2 * fifth : -fifth] if self.whole else self.sizes[-fifth:]
        late = statistics.median(last or [np.inf])
        return {
            "job": self.name,
            "seconds": round(self.seconds),
            "early_mb": round(early, 1),
            "late_mb": round(late, 1),
            "largest_mb": round(max(self.sizes, default=0.0), 1),
            "exit": ended,
            "held": late <= max(FLAT * early, early + FLAT_MB)
            and ended == [0 if self.whole else None] * len(ended),
        }


def begun(folder: Path) -> list[Job]:
    """The jobs whose memory is watched."""
    training = ["train", "small.yaml", f"steps={10**8}", "--out", "long"]
    drive = ["drive", "tuned/lqr", "path=circle", f"duration={DRIVE}", "--out", "drive"]
    bench = [sys.executable, "-c", BENCHES, "suite.yaml"]
    jobs = [
        Job("training", start([*RESUMED, *training], folder)),
        Job("benchmarks", start(bench, folder)),
        Job(f"drive of {DRIVE} s", start([*RESUMED, *drive], folder), whole=True),
    ]
    if has_carla():
        served = [*RESUMED, "carla", "serve", "--port", "0"]
        server = start(served, folder, stdout=subprocess.PIPE)
        assert server.stdout is not None
        port = server.stdout.readline().partition(b"127.0.0.1:")[2].partition(b",")[0]
        client = start([sys.executable, "-c", CLIENTS, port.decode()], folder)
        jobs.append(Job("stand-in", server, client))
    return jobs


def has_carla() -> bool:
    """Whether CARLA's client is installed."""
    words = [sys.executable, "-c", "import carla, msgpack"]
    return not subprocess.run(words, capture_output=True, check=False).returncode


def watched(jobs: list[Job], seconds: float) -> Iterator[Row]:
    """Read the jobs' memory until the time is up or they end by themselves; a row for each."""
    left = jobs
    while left:
        still = [job for job in left if job.running(seconds)]
        yield from (job.row() for job in left if job not in still)
        left = still
        sizes = resident()
        for job in left:
            job.sizes.append(sizes[job.processes[0].pid])
        time.sleep(0.5)


def resident() -> defaultdict[int, float]:
    """Resident memory of the processes of each session [MB]."""
    totals: defaultdict[int, float] = defaultdict(float)
    page = os.sysconf("SC_PAGE_SIZE")
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            words = stat.read_text().rpartition(")")[2].split()
        except OSError:
            continue
        totals[int(words[3])] += int(words[21]) * page / 1e6
    return totals


def kills(command: Command, folder: Path, share: int, rng: np.random.Generator) -> Row:
    """A row: a command killed so many times, and what became of its results."""
    whole, cut = folder / "whole", folder / "cut"
    for out in (whole, cut):
        shutil.rmtree(out, ignore_errors=True)
    started = time.monotonic()
    try:
        done(command, folder, whole)
    except ChildProcessError:
        return {"command": command.name, "fails": "by itself", "held": False}
    length = time.monotonic() - started
    spent, kept, ends, differ, failed = 0, 0, 0, 0, []
    while spent < share or cut.exists():
        fresh, started = not cut.exists(), time.monotonic()
        process = start(line(command, cut), folder)
        if spent < share:
            while spent % 2 and process.poll() is None and not resumable(command, cut):
                time.sleep(0.05)
            try:
                code = process.wait(rng.uniform(0.0, 0.5 * length if spent % 2 else length))
            except subprocess.TimeoutExpired:
                killed(process)
                spent += 1
                kept += resumable(command, cut) or finished(command, cut)
                continue
        else:
            code = process.wait()
        ends += 1
        if fresh:  # moments are drawn over the length that it has now
            length = time.monotonic() - started
        if code:
            failed.append(code)
        else:
            differ += digest(command, cut) != digest(command, whole)
        shutil.rmtree(cut)
    return {
        "command": command.name,
        "whole_s": round(length, 1),
        "kills": spent,
        "with_checkpoint": kept,
        "ends": ends,
        "differ": differ,
        "failed": failed,
        "held": not differ and not failed and kept >= SETTLED * spent,
    }


def resumable(command: Command, out: Path) -> bool:
    """Whether something is there that would be resumed."""
    return any(any(out.glob(pattern)) for pattern in command.kept)


def finished(command: Command, out: Path) -> bool:
    """Whether all results are there: what would be resumed goes when they are whole."""
    return all((out / name).exists() for name in command.results)


def line(command: Command, out: Path) -> list[str]:
    """The command's words, with those that make it resume where its folder is there."""
    again = command.again if out.exists() else ()
    return [*RESUMED, *command.words, *again, "--out", out.name]


def done(command: Command, folder: Path, out: Path) -> None:
    """Run a command whole.

    Raises:
        ChildProcessError: it fails by itself.
    """
    if start(line(command, out), folder).wait():
        raise ChildProcessError(command.name)


def digest(command: Command, out: Path) -> list[object]:
    """What is compared: bytes of policies; results without what is measured by the clock."""
    return [
        timeless(json.loads(file.read_bytes())) if file.suffix == ".json" else file.read_bytes()
        for file in (out / name for name in command.results)
    ]


def timeless(value: object) -> object:
    """A record without the figures of computing times."""
    if isinstance(value, dict):
        by_clock = ("time", "_us", "deadline")
        return {k: timeless(v) for k, v in value.items() if not any(w in k for w in by_clock)}
    return [timeless(each) for each in value] if isinstance(value, list) else value


def start(
    words: list[str], folder: Path, stdout: int = subprocess.DEVNULL
) -> subprocess.Popen[bytes]:
    """A process in a session of its own."""
    return subprocess.Popen(
        words, cwd=folder, stdout=stdout, stderr=subprocess.DEVNULL, start_new_session=True
    )


def killed(process: subprocess.Popen[bytes]) -> None:
    """End a process and all of its session."""
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            words = stat.read_text()
            if int(words.rpartition(")")[2].split()[3]) == process.pid:
                os.kill(int(words.split()[0]), signal.SIGKILL)
        except (OSError, ProcessLookupError):
            continue
    process.wait()


if __name__ == "__main__":
    main()
