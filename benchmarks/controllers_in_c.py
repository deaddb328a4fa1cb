"""Controllers in C: proof that they are the Python ones, their size, and their time.

    python benchmarks/controllers_in_c.py [tuned/lqr ...] [--count 100000] [--out results/export]

Each is compiled by gcc and clang, those that there are, with -O2 and -O3, in float and in double,
and answers drawn observations, extremes and NaN among them, thirty to a drive; the largest distance
of its steering from Python's and the number of other statuses are recorded, and the largest number
of steps of a quadratic program. The first 5000 run under the sanitisers, too. A drive in which the
C code steers, with a tenth of the observations lost, is compared with Python's drive. For a
Cortex-M4F, if arm-none-eabi-gcc and qemu-system-arm are there: ROM, RAM, stack, and instructions a
step, counted by qemu.
"""

from __future__ import annotations

import argparse
import ctypes
import json
import shutil
import subprocess
import tempfile
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from steersman.commands import configuration
from steersman.delivery.compiled import CompiledController
from steersman.delivery.controller import Setting
from steersman.delivery.controller_package import write_controller
from steersman.delivery.controller_text import TOLERANCE, answers, counted_steps
from steersman.delivery.observations import Row, drawn, observations, single, with_gaps, with_wishes
from steersman.files import write_text
from steersman.kernels.active_set import MOST_STEPS
from steersman.provenance import provenance
from steersman.rollout import run
from steersman.types import FloatArray, Status
from steersman.words import short

CONTROLLERS = (
    "tuned/pid", "tuned/pid_feedforward", "tuned/bearing_pid", "tuned/pure_pursuit",
    "tuned/pure_pursuit_cm", "tuned/stanley", "tuned/stanley_cm", "tuned/lqr", "tuned/sliding_mode",
    "tuned/mpc", "tuned/mpc_pid", "tuned/mpc_pid_scheduled", "tuned/mpc_delay", "nmpc",
    "predicted/tuned/lqr", "estimated/tuned/lqr", "supervised/tuned/lqr",
    "supervised/estimated/predicted/tuned/lqr",
)  # fmt: skip
SLOW = ("mpc_delay", "nmpc")  # of more than half a millisecond a step in Python
DRIVE = 30
ROUNDS = 9
BUILDS = {
    False: ("gcc -O2", "gcc -O3", "clang -O2", "clang -O3"),
    True: ("gcc -O2", "clang -O3"),
}
BOUND = {False: 1e-9, True: 1e-6}
SANITISED = 5000
SANITISERS = ("-fsanitize=address,undefined", "-fno-sanitize-recover=all")
STRICT = ("-std=c99", "-Wall", "-Wextra", "-Wconversion", "-Werror", "-pedantic", "-Wshadow")
PORTABLE = "-ffp-contract=off"
M4 = ("-mcpu=cortex-m4", "-mthumb", "-mfloat-abi=hard", "-mfpu=fpv4-sp-d16", "-O2")
QEMU = (
    "-M", "mps2-an386", "-nographic", "-icount", "shift=0",
    "-semihosting-config", "enable=on,target=native",
)  # fmt: skip


def make(setting: Setting, folder: Path, words: Sequence[str], *more: str) -> Path:
    """Compile the C code in ``folder`` with ``batch.c.in``; ``words`` are compiler and flags."""
    text = Path(__file__).with_name("batch.c.in").read_text(encoding="ascii")
    text = text.replace("@PREFIX@", setting.prefix).replace("@UPPER@", setting.prefix.upper())
    write_text(folder / "batch.c", text.replace("@REAL@", "float" if setting.single else "double"))
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
        single=setting.single,
        limits=setting.limits_speed,
    )


def setting_of(word: str, single_: bool = False) -> Setting:
    """A controller, with its settings if any, for the default drive's car, sensor and period."""
    name, *more = word.split()
    c = configuration("drive", [f"controller={name}", *more])
    nominal = c.nominal or c.vehicle
    sensor = c.sensor
    return Setting(
        short(name), c.controller, nominal, c.plant.dt, sensor.count, sensor.spacing, single_
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
    lock = np.abs(expected[:, 0]) > 1.0 - TOLERANCE[setting.single]
    lock &= (said[:, 1] != fallback) & (expected[:, 1] != fallback)
    other = (said[:, 1] != expected[:, 1]) & ~lock
    usable = int((expected[:, 1] != fallback).sum())
    beyond = int((~(apart <= BOUND[setting.single])).sum())
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


def drive_difference(word: str, code: CompiledController, duration: float = 60.0) -> float:
    """Largest difference of path, heading and steering between a drive by Python and one by C."""
    lost = "disturbances=[{kind: dropouts, share: 0.1}]"
    words = ["path=monza", f"duration={duration}", "sensor.position_noise=0.02", lost]
    config = configuration("drive", [f"controller={word}".split()[0], *words, *word.split()[1:]])
    here = run(config)
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


def cortex_m4(setting: Setting, folder: Path) -> dict[str, int] | None:
    """On a Cortex-M4F under QEMU, in float: sizes [bytes], instructions a step, parity; if there.

    Instructions are the mean over 200 steps of a drive; ``steering_e9`` is 1e9 times the largest
    distance of the steering from Python's.
    """
    if not all(map(shutil.which, ("arm-none-eabi-gcc", "qemu-system-arm"))):
        return None
    here, name = Path(__file__).parent / "cortex_m4", setting.prefix.removeprefix("steersman_")
    text = (here / "main.c.in").read_text(encoding="ascii")
    text = text.replace("@NAME@", name).replace("@PREFIX@", setting.prefix)
    write_text(folder / "main.c", text)

    def call(*words: str) -> str:
        done = subprocess.run(words, check=True, cwd=folder, capture_output=True, text=True)
        return done.stdout + done.stderr  # QEMU writes what the program says to the latter

    script = ("-nostartfiles", "-T", str(here / "mps2.ld"))
    call("arm-none-eabi-gcc", *M4, *STRICT, PORTABLE, "-c", f"{setting.prefix}.c", "-o", "code.o")
    rom = int(call("arm-none-eabi-size", "code.o").splitlines()[1].split()[0])
    call("arm-none-eabi-gcc", *M4, *script, "main.c", "code.o", "-lm", "-o", "m4")
    said = call("qemu-system-arm", *QEMU, "-kernel", "m4")
    return {"rom": rom} | {k: int(v) for k, v in (line.split() for line in said.splitlines())}


def measured(word: str, count: int, builds: Mapping[bool, Sequence[str]]) -> dict[str, Any]:
    """Everything of one controller."""
    double = setting_of(word)
    of = known(double, drawn_rows(double, count))
    found: dict[str, Any] = {}
    if of.steps:
        found["qp"] = {"programs": len(of.steps), "steps": max(of.steps), "bound": MOST_STEPS}
    for single_ in (False, True):
        setting, name = double._replace(single=single_), "single" if single_ else "double"
        with tempfile.TemporaryDirectory() as scratch:
            folder = Path(scratch)
            write_controller(setting, folder)
            lines = (folder / f"{setting.prefix}.c").read_text().count("\n")
            figures: dict[str, Any] = {"lines": lines}
            for build in builds[single_]:
                code = compiled(setting, folder, build.split())
                figures[build] = parity(setting, code, of)._asdict()
                if build == builds[single_][0]:
                    figures["us"] = microseconds(code, setting)
                    if not single_:
                        figures[build]["drive"] = drive_difference(word, code)
            if not single_ and "gcc -O2" in builds[single_]:
                figures["sanitised"] = sanitised(setting, folder, of)._asdict()
            if single_:
                figures["cortex_m4"] = cortex_m4(setting, folder)
        found[name] = figures
    return found


def table(found: dict[str, dict[str, Any]]) -> str:
    """The figures as a table: sizes and instructions of float on the Cortex-M4F."""
    lines = [
        "| controller | lines | ROM [B] | RAM [B] | stack [B] | instructions a step | us here: C, "
        "Python | observations | double from Python | beyond 1e-9 | drive | float from Python "
        "| beyond 1e-6 | statuses that differ: double, float | QP steps |",
        "|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    for word, both in found.items():
        double, single_ = both["double"], both["single"]
        m4 = single_["cortex_m4"] or dict.fromkeys(("rom", "ram", "stack", "instructions"), "-")
        builds = {k: [v for n, v in both[k].items() if "-O" in n] for k in ("double", "single")}
        worst, beyond, other = (
            {k: max(each[what] for each in v) for k, v in builds.items()}
            for what in ("steering", "beyond", "other_statuses")
        )
        drives = max(each.get("drive", 0.0) for each in builds["double"])
        us = f"{double['us']['c']:.1f}, {double['us']['python']:.0f}"
        sizes = [double["lines"], *(m4[k] for k in ("rom", "ram", "stack", "instructions"))]
        cells = [
            *(word, *sizes, us, builds["double"][0]["observations"], f"{worst['double']:.1e}"),
            *(beyond["double"], f"{drives:.1e}", f"{worst['single']:.1e}", beyond["single"]),
            f"{other['double']}, {other['single']}",
            f"{both['qp']['steps']} of {both['qp']['bound']}" if "qp" in both else "-",
        ]
        lines.append(f"| {' | '.join(map(str, cells))} |")
    return "\n".join(lines) + "\n"


def main() -> None:
    """Measure, print, and write if asked."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("controllers", nargs="*", default=CONTROLLERS)
    parser.add_argument("--count", type=int, default=100_000)
    parser.add_argument("--slow", type=int, default=10_000, help="the count of SLOW controllers")
    parser.add_argument("--out", type=Path)
    arguments = parser.parse_args()
    builds = {
        single_: [each for each in those if shutil.which(each.split()[0])]
        for single_, those in BUILDS.items()
    }
    found = {}
    if arguments.out is not None and (arguments.out / "controllers.json").is_file():
        before = json.loads((arguments.out / "controllers.json").read_text(encoding="utf-8"))
        found = {k: v for k, v in before["controllers"].items() if k in CONTROLLERS}
    for word in arguments.controllers:
        slow = any(each in word for each in SLOW)
        found[word] = measured(word, arguments.slow if slow else arguments.count, builds)
        print(word, json.dumps(found[word]))  # noqa: T201 - its output
        if arguments.out is not None:  # what is measured is kept, whatever comes after it
            record = {"builds": {"double": builds[False], "single": builds[True]}}
            record |= {"controllers": found, **provenance()}
            write_text(arguments.out / "controllers.json", json.dumps(record, indent=1) + "\n")
            write_text(arguments.out / "table.md", table(found))


if __name__ == "__main__":
    main()
