"""Controllers in C: proof that they are the Python ones, their size, and their time.

    python benchmarks/controllers_in_c.py [tuned/lqr ...] [--count 100000] [--jobs 2] [--out DIR]

``untrained/PRESET`` is a policy of the preset's kind with random weights and all that is around it.

Each is compiled by gcc and clang, those that there are, with -O2 and -O3, in double, in float, and
in double between floats (mixed), and answers drawn observations, extremes and NaN among them, 30 to
a drive; the largest distance of its steering from Python's and the number of other statuses are
recorded, and the largest number of steps of a quadratic program, here and in drives of the suite
``standard`` (sample=8). The first 5000 run under the
sanitisers, too. A drive in which the C code steers, with a tenth of the observations lost, is
compared with Python's drive, in each precision. For a Cortex-M4F, if arm-none-eabi-gcc and
qemu-system-arm are there: ROM, RAM, stack, and instructions a step, counted by qemu.
"""

from __future__ import annotations

import argparse
import ctypes
import json
import shutil
import subprocess
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from steersman.commands import configuration
from steersman.config import build
from steersman.delivery.compiled import CompiledController
from steersman.delivery.controller import Setting
from steersman.delivery.controller_package import write_controller
from steersman.delivery.controller_text import TOLERANCE
from steersman.delivery.measuring import cortex_m4, missing, programs_of
from steersman.delivery.observations import Row, drawn, observations, single, with_gaps, with_wishes
from steersman.delivery.vector_text import answers, counted_steps
from steersman.episode import Episode
from steersman.files import write_text
from steersman.kernels.active_set import MOST_STEPS
from steersman.learning.config import TrainConfig, load_preset
from steersman.learning.export import export_policy
from steersman.learning.networks import view_net
from steersman.provenance import provenance
from steersman.rollout import RunConfig, run
from steersman.types import FloatArray, Status
from steersman.words import short

CONTROLLERS = (
    "tuned/pid", "tuned/pid_feedforward", "tuned/bearing_pid", "tuned/pure_pursuit",
    "tuned/pure_pursuit_cm", "tuned/stanley", "tuned/stanley_cm", "tuned/lqr", "tuned/sliding_mode",
    "tuned/mpc", "tuned/mpc_pid", "tuned/mpc_pid_scheduled", "tuned/mpc_delay", "nmpc",
    "joint_nmpc speed=constant_speed",
    "predicted/tuned/lqr", "estimated/tuned/lqr", "supervised/tuned/lqr",
    "supervised/estimated/predicted/tuned/lqr", "precision",
    "grip_speed controller.inner=tuned/lqr speed=constant_speed", "untrained/pid_gains",
    "untrained/mpc_switch", "untrained/mpc_weights", "untrained/mpc_model",
    "untrained/joint speed=constant_speed sensor.count=41",
)  # fmt: skip
UNTRAINED = "untrained/"
HIDDEN = 64
DRIVE = 30
ROUNDS = 9
BUILDS = {
    "double": ("gcc -O2", "gcc -O3", "clang -O2", "clang -O3"),
    "single": ("gcc -O2", "clang -O3"),
    "mixed": ("clang -O3",),
}
BOUND = {"double": 1e-9, "single": 1e-6, "mixed": 1e-6}
SANITISED = 5000
SANITISERS = ("-fsanitize=address,undefined", "-fno-sanitize-recover=all")
STRICT = ("-std=c99", "-Wall", "-Wextra", "-Wconversion", "-Werror", "-pedantic", "-Wshadow")
PORTABLE = "-ffp-contract=off"


def untrained(preset: str, folder: Path) -> Path:
    """A policy of a preset's kind with random weights."""
    config = build(TrainConfig, load_preset(preset))
    problem = config.problem
    actions = len(problem.parameters) or 1 + problem.joint
    sizes = (len(problem.layout.scale), HIDDEN, HIDDEN, actions)
    count = sum((a + 1) * b for a, b in pairwise(sizes))
    weights = np.random.default_rng(0).normal(0.0, 0.1, count).astype(np.float32)
    folder = folder / preset
    folder.mkdir()
    return export_policy(view_net(weights, sizes), config, folder, {})


def make(setting: Setting, folder: Path, words: Sequence[str], *more: str) -> Path:
    """Compile the C code in ``folder`` with ``batch.c.in``; ``words`` are compiler and flags."""
    text = Path(__file__).with_name("batch.c.in").read_text(encoding="ascii")
    text = text.replace("@PREFIX@", setting.prefix).replace("@UPPER@", setting.prefix.upper())
    write_text(folder / "batch.c", text.replace("@REAL@", setting.handed))
    file = folder / f"{'_'.join(words).replace('/', '_')}.out"
    more = (*more, *["-DWISHES"] * setting.limits_speed)
    made = [*words, *STRICT, PORTABLE, *more, "-o", str(file), f"{setting.prefix}.c", "batch.c"]
    subprocess.run([*made, "-lm"], check=True, cwd=folder)
    return file


def compiled(setting: Setting, folder: Path, words: Sequence[str]) -> CompiledController:
    """Compile the C code in ``folder`` as a library."""
    file = make(setting, folder, words, "-shared", "-fPIC")
    return CompiledController(
        code=ctypes.CDLL(str(file)),
        prefix=setting.prefix,
        single=setting.handed == "float",
        limits=setting.limits_speed,
    )


def setting_of(word: str, precision: str = "double") -> Setting:
    """A controller, with its settings if any, for the default drive's car, sensor and period."""
    name, *more = word.split()
    c = configuration("drive", [f"controller={name}", *more])
    nominal = c.nominal or c.vehicle
    sensor = c.sensor
    return Setting(
        short(name), c.controller, nominal, c.plant.dt, sensor.count, sensor.spacing, precision
    )


def drawn_rows(setting: Setting, count: int) -> list[Row]:
    """Drawn observations: usual ones, those of every size, and strange ones."""
    rng = np.random.default_rng(1)
    rows = observations(setting, rng)
    while len(rows) < count:
        size = rng.uniform(0.0, 2.0) if len(rows) % 2 else 10.0 ** rng.uniform(-42.0, 15.0)
        overruled = single(rng.uniform(-1.0, 1.0)) if len(rows) % 10 == 0 else None
        rows.append(Row(len(rows) % DRIVE == 0, drawn(setting, rng, size), overruled))
    rows = rows[:count]
    rows = with_wishes(rows) if setting.limits_speed else rows
    return with_gaps(rows) if setting.controller.gaps else rows


class Known(NamedTuple):
    """Observations and what Python answers."""

    rows: FloatArray
    """(n, width) as ``batch.c.in`` reads them."""
    answers: FloatArray
    """(n, 2) steering and status."""
    steps: list[int]
    """Of all quadratic programs."""


def known(setting: Setting, rows: Sequence[Row]) -> Known:
    """Let Python answer."""
    with counted_steps() as steps:
        said = answers(setting, rows)
    numbers = [
        [r.restart, r.missing, r.executed is not None, r.executed or 0.0, *r.seen[:8]] for r in rows
    ]
    previews = np.array([[*r.seen.preview.ravel(), *r.seen.wished] for r in rows])
    whole = np.ascontiguousarray(np.hstack([np.array(numbers, float), previews]))
    return Known(whole, np.array([each[:2] for each in said], float), steps)


class Parity(NamedTuple):
    """How far C is from Python."""

    observations: int
    usable: int
    """Of which no fallback answers."""
    steering: float
    """Largest distance of the steering."""
    beyond: int
    """Steps of which it is beyond the bound, 1e-9 in double and 1e-6 in float."""
    other_statuses: int


def in_batch(setting: Setting, code: CompiledController, rows: FloatArray) -> FloatArray:
    """What the C code answers, (n, 2)."""
    out = np.empty((len(rows), 2))
    state = ctypes.create_string_buffer(code.init(setting.vehicle, setting.dt))
    given, to = (ctypes.c_void_p(each.ctypes.data) for each in (rows, out))
    code.function("batch")(state, given, len(rows), to)
    return out


def compared(setting: Setting, said: FloatArray, expected: FloatArray) -> Parity:
    """Compare what C answered with what Python did."""
    fallback = int(Status.FALLBACK)
    apart = np.abs(said[:, 0] - expected[:, 0])
    # At full lock rounding decides whether a command was clipped.
    lock = np.abs(expected[:, 0]) > 1.0 - TOLERANCE[setting.precision]
    lock &= (said[:, 1] != fallback) & (expected[:, 1] != fallback)
    other = (said[:, 1] != expected[:, 1]) & ~lock
    usable = int((expected[:, 1] != fallback).sum())
    beyond = int((~(apart <= BOUND[setting.precision])).sum())
    return Parity(len(said), usable, float(apart.max()), beyond, int(other.sum()))


def parity(setting: Setting, code: CompiledController, of: Known) -> Parity:
    """Compare the C code with what Python answered."""
    return compared(setting, in_batch(setting, code, of.rows), of.answers)


def sanitised(setting: Setting, folder: Path, of: Known) -> Parity:
    """The same for the first observations in a program under the sanitisers, which end it."""
    rows = of.rows[:SANITISED]
    program = make(setting, folder, ("gcc", "-O1"), *SANITISERS, "-DPROGRAM")
    done = subprocess.run([program], input=rows.tobytes(), check=True, capture_output=True)
    said = np.frombuffer(done.stdout).reshape(-1, 2)
    return compared(setting, said, of.answers[: len(rows)])


def drive_of(word: str, duration: float = 60.0) -> RunConfig:
    """A drive on Monza with noise, in which a tenth of the observations is lost."""
    lost = "disturbances=[{kind: dropouts, share: 0.1}]"
    words = ["path=monza", f"duration={duration}", "sensor.position_noise=0.02", lost]
    return configuration("drive", [f"controller={word}".split()[0], *words, *word.split()[1:]])


def drive_difference(config: RunConfig, here: Episode, code: CompiledController) -> float:
    """Largest difference of path, heading and steering between a drive by Python and one by C."""
    there = run(config.model_copy(update={"controller": code}))
    names = ("x", "y", "psi", "steer")
    return max(float(np.abs(here.columns[k] - there.columns[k]).max()) for k in names)


def microseconds(code: CompiledController, setting: Setting) -> dict[str, float]:
    """Of one step in C, less that of the call from Python, and in Python; the sides take turns."""
    rows = [row.seen for row in drawn_rows(setting, 200)]
    packed = [code.packed(each) for each in rows]
    at = [ctypes.c_void_p(each.ctypes.data) for each in packed]
    state = ctypes.create_string_buffer(code.init(setting.vehicle, setting.dt))
    steer = ctypes.byref(code.real())
    times: dict[str, list[float]] = {"call": [], "c": [], "python": []}
    size, step = code.function("size"), code.function("step")
    for _ in range(ROUNDS):
        python, begun = setting.start(), time.thread_time()
        for _ in range(ROUNDS):
            for each in at:
                size(state, each, steer)
        times["call"].append((time.thread_time() - begun) / ROUNDS)
        begun = time.thread_time()
        for _ in range(ROUNDS):
            for each in at:
                step(state, each, steer)
        times["c"].append((time.thread_time() - begun) / ROUNDS)
        begun = time.thread_time()
        for seen in rows:
            _, python = setting.controller.step(python, seen)
        times["python"].append(time.thread_time() - begun)
    found = {k: 1e6 * min(each) / len(rows) for k, each in times.items()}
    return {"c": found["c"] - found["call"], "python": found["python"]}


def measured(
    named: str, count: int, builds: Mapping[str, Sequence[str]], made: Path
) -> dict[str, Any]:
    """Everything of one controller; a policy that is none of the package lies in ``made``."""
    word = named
    if named.startswith(UNTRAINED):
        preset, *settings = named.removeprefix(UNTRAINED).split()
        word = " ".join([str(untrained(preset, made)), *settings])
    double = setting_of(word)
    of = known(double, drawn_rows(double, count))
    config = drive_of(word)
    here = run(config)
    found: dict[str, Any] = {}
    if of.steps:
        found["qp"] = {"programs": len(of.steps), "steps": max(of.steps), "bound": MOST_STEPS}
        found["qp_in_benchmark"] = programs_of(double)
    for name in builds:
        setting = double._replace(precision=name)
        with tempfile.TemporaryDirectory() as scratch:
            folder = Path(scratch)
            write_controller(setting, folder)
            lines = (folder / f"{setting.prefix}.c").read_text().count("\n")
            figures: dict[str, Any] = {"lines": lines}
            for command in builds[name]:
                code = compiled(setting, folder, command.split())
                figures[command] = parity(setting, code, of)._asdict()
                if command == builds[name][0]:
                    figures["us"] = microseconds(code, setting)
                    figures[command]["drive"] = drive_difference(config, here, code)
            if name == "double" and "gcc -O2" in builds[name]:
                figures["sanitised"] = sanitised(setting, folder, of)._asdict()
            else:
                figures["cortex_m4"] = None if missing() else cortex_m4(setting, folder, *STRICT)
        found[name] = figures
    return found


COSTS = (
    "size and time", "lines", "ROM [B]", "RAM [B]", "stack [B]", "instructions a step",
    "us here: C, Python", "QP steps: drawn, benchmark", "their bound",
)  # fmt: skip
_OF_EACH = ("largest", "beyond", "statuses", "in a drive")
PARITY = (
    "distance from Python",
    "observations",
    *(f"{k}: {what}" for k in ("double", "float", "mixed") for what in _OF_EACH),
)


def tables(found: Mapping[str, dict[str, Any]]) -> str:
    """The figures as two tables."""
    return f"{_table(COSTS, _costs, found)}\n{_table(PARITY, _distances, found)}"


def _table(
    heads: Sequence[str],
    cells: Callable[[dict[str, Any]], list[Any]],
    found: Mapping[str, dict[str, Any]],
) -> str:
    rows = [heads, ["---"] * len(heads), *([word, *cells(of)] for word, of in found.items())]
    return "".join(f"| {' | '.join(map(str, row))} |\n" for row in rows)


def _costs(of: dict[str, Any]) -> list[Any]:
    """Sizes and instructions on the Cortex-M4F in float, mixed; times here in double."""
    m4 = [of.get(k, {}).get("cortex_m4") or {} for k in ("single", "mixed")]
    sizes = [
        ", ".join(str(each.get(what, "-")) for each in m4)
        for what in ("rom", "ram", "stack", "instructions")
    ]
    us, drawn, driven = of["double"]["us"], of.get("qp"), of.get("qp_in_benchmark")
    steps = f"{drawn['steps']}, {driven['largest'] if driven else '-'}" if drawn else "-"
    bound = drawn["bound"] if drawn else "-"
    return [of["double"]["lines"], *sizes, f"{us['c']:.1f}, {us['python']:.0f}", steps, bound]


def _distances(of: dict[str, Any]) -> list[Any]:
    """Of the worst build of each precision."""
    out: list[Any] = [of["double"]["gcc -O2"]["observations"]]
    for k in BOUND:
        builds = [each for name, each in of.get(k, {}).items() if "-O" in name]
        if not builds:
            out += ["-"] * len(_OF_EACH)
            continue
        away, *counts = (
            max(each[what] for each in builds) for what in ("steering", "beyond", "other_statuses")
        )
        drive = next(each["drive"] for each in builds if "drive" in each)
        out += [f"{away:.1e}", *counts, f"{drive:.1e}"]
    return out


def main() -> None:
    """Measure, print, and write if asked."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("controllers", nargs="*", default=CONTROLLERS)
    parser.add_argument("--count", type=int, default=100_000)
    parser.add_argument("--jobs", type=int, default=1, help="controllers at a time")
    parser.add_argument("--out", type=Path)
    arguments = parser.parse_args()
    builds = {
        name: [each for each in those if shutil.which(each.split()[0])]
        for name, those in BUILDS.items()
    }
    found, failed = {}, list[str]()
    count, wanted = arguments.count, arguments.controllers
    with tempfile.TemporaryDirectory() as scratch, ProcessPoolExecutor(arguments.jobs) as pool:
        jobs = {pool.submit(measured, each, count, builds, Path(scratch)): each for each in wanted}
        for job in as_completed(jobs):
            if (fault := job.exception()) is not None:
                failed.append(jobs[job])
                print(jobs[job], repr(fault), flush=True)  # noqa: T201 - its output
                continue
            found[jobs[job]] = job.result()
            print(jobs[job], json.dumps(job.result()), flush=True)  # noqa: T201 - its output
            if arguments.out is not None:  # what is measured is kept, whatever comes after it
                rows = {k: found[k] for k in wanted if k in found}
                record = {"builds": builds, "controllers": rows, **provenance()}
                write_text(arguments.out / "controllers.json", json.dumps(record, indent=1) + "\n")
                write_text(arguments.out / "table.md", tables(rows))
    raise SystemExit(f"failed: {', '.join(failed)}" if failed else 0)


if __name__ == "__main__":
    main()
