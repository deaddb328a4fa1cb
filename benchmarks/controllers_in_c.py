"""Controllers in C: proof that they are the Python ones, their size, and their time.

    python benchmarks/controllers_in_c.py [tuned/lqr ...] [--count 100000] [--out results/export]

Each is compiled by every compiler there is (gcc, clang) with -O2 and -O3, in float and in double,
and answers drawn observations, extremes and NaN among them, thirty to a drive; the largest distance
of its steering from Python's and the number of other statuses are recorded. A drive in which the
C code steers is compared with Python's drive. For a Cortex-M4F, if arm-none-eabi-gcc and
qemu-system-arm are there: ROM, RAM, stack, and instructions a step, counted by qemu.
"""

from __future__ import annotations

import argparse
import ctypes
import json
import shutil
import statistics
import subprocess
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from pydantic import Field

from steersman.commands import configuration
from steersman.controllers.base import ControllerComponent
from steersman.delivery.controller import Setting
from steersman.delivery.controller_package import write_controller
from steersman.delivery.controller_text import TOLERANCE, answers
from steersman.delivery.observations import Row, drawn, observations, single, with_gaps
from steersman.files import write_text
from steersman.provenance import provenance
from steersman.rollout import run
from steersman.types import Decision, Observation, Status
from steersman.vehicles import Vehicle
from steersman.words import short

CONTROLLERS = (
    "tuned/pid", "tuned/pid_feedforward", "tuned/bearing_pid", "tuned/pure_pursuit",
    "tuned/pure_pursuit_cm", "tuned/stanley", "tuned/stanley_cm", "tuned/lqr", "tuned/sliding_mode",
    "tuned/mpc", "tuned/mpc_pid", "tuned/mpc_pid_scheduled", "tuned/mpc_delay", "nmpc",
)  # fmt: skip
DRIVE = 30
ROUNDS = 9
BUILDS = ("gcc -O2", "gcc -O3", "clang -O2", "clang -O3")
STRICT = ("-std=c99", "-Wall", "-Wextra", "-Wconversion", "-Werror", "-pedantic", "-Wshadow")
PORTABLE = "-ffp-contract=off"
M4 = ("-mcpu=cortex-m4", "-mthumb", "-mfloat-abi=hard", "-mfpu=fpv4-sp-d16", "-O2")
QEMU = (
    "-M", "mps2-an386", "-nographic", "-icount", "shift=0",
    "-semihosting-config", "enable=on,target=native",
)  # fmt: skip


class InC(ControllerComponent):
    """A compiled controller, called from Python; the bytes of its C state are its state."""

    code: Any = Field(exclude=True)
    prefix: str
    single: bool

    def function(self, name: str) -> Any:
        """One of its functions."""
        found = getattr(self.code, f"{self.prefix}_{name}")
        found.restype = ctypes.c_int if name in {"step", "size"} else None
        return found

    def packed(self, seen: Observation) -> Any:
        """An observation as C has it."""
        given = [*seen[:8], *seen.preview.ravel()]
        return np.array(given, np.float32 if self.single else np.float64)

    def real(self, value: float = 0.0) -> Any:
        """A number as C has it."""
        return ctypes.c_float(value) if self.single else ctypes.c_double(value)

    def init(self, vehicle: Vehicle, dt: float) -> bytes:
        """The state before the first step."""
        state = ctypes.create_string_buffer(self.function("size")())
        self.function("init")(state, None)
        return state.raw

    def decide(self, state: bytes, observation: Observation) -> Any:
        """Not called: a step of C is whole."""
        raise NotImplementedError

    def step(self, state: bytes, observation: Observation | None) -> tuple[Decision, bytes]:
        """The decision of the C code."""
        steer, after = self.real(), ctypes.create_string_buffer(state, len(state))
        given = None if observation is None else self.packed(observation)
        at = None if given is None else ctypes.c_void_p(given.ctypes.data)
        status = self.function("step")(after, at, ctypes.byref(steer))
        return Decision(float(steer.value), Status(status)), after.raw

    def executed(self, state: bytes, steer: float) -> bytes:
        """Another command was executed."""
        after = ctypes.create_string_buffer(state, len(state))
        self.function("executed")(after, self.real(steer))
        return after.raw


def compiled(setting: Setting, folder: Path, words: Sequence[str]) -> InC:
    """Compile the C code in ``folder``; ``words`` are compiler and flags."""
    file, prefix = folder / f"{'_'.join(words)}.so", setting.prefix
    size = f"int {prefix}_size(void);\nint {prefix}_size(void)\n{{\n"
    text = f'#include "{prefix}.h"\n{size}    return (int)sizeof({prefix}_state);\n}}\n'
    write_text(folder / "size.c", text)
    made = [*words, *STRICT, PORTABLE, "-shared", "-fPIC", "-o", str(file), f"{prefix}.c", "size.c"]
    subprocess.run([*made, "-lm"], check=True, cwd=folder)
    return InC(code=ctypes.CDLL(str(file)), prefix=prefix, single=setting.single)


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
        rows.append(Row(len(rows) % DRIVE == 0, drawn(setting, rng, size), 0.0, overruled))
    rows = rows[:count]
    return with_gaps(rows) if setting.controller.gaps else rows


class Parity(NamedTuple):
    """How far C is from Python."""

    observations: int
    usable: int
    """Of which no fallback answers."""
    steering: float
    """Largest distance of the steering, over its size where that is above one."""
    other_statuses: int


def parity(setting: Setting, code: InC, rows: Sequence[Row], known: Sequence[Decision]) -> Parity:
    """Compare the C code with what Python answered."""
    worst, other = 0.0, 0
    start = state = code.init(setting.vehicle, setting.dt)
    for row, expected in zip(rows, known, strict=True):
        decision, state = code.step(start if row.restart else state, row.given)
        # At full lock rounding decides whether a command was clipped.
        lock = Status.FALLBACK not in {decision.status, expected.status}
        lock = lock and abs(expected.steer) > 1.0 - TOLERANCE[setting.single]
        other += decision.status != expected.status and not lock
        worst = max(worst, abs(decision.steer - expected.steer))
        if row.executed is not None:
            state = code.executed(state, row.executed)
    usable = sum(each.status is not Status.FALLBACK for each in known)
    return Parity(len(rows), usable, worst, other)


def drive_difference(word: str, code: InC, duration: float = 60.0) -> float:
    """Largest difference of path, heading and steering between a drive by Python and one by C."""
    lost = "disturbances=[{kind: dropouts, share: 0.1}]"
    words = ["path=monza", f"duration={duration}", "sensor.position_noise=0.02", lost]
    config = configuration("drive", [f"controller={word}".split()[0], *words, *word.split()[1:]])
    here = run(config)
    there = run(config.model_copy(update={"controller": code}))
    names = ("x", "y", "psi", "steer")
    return max(float(np.abs(here.columns[k] - there.columns[k]).max()) for k in names)


def microseconds(code: InC, setting: Setting) -> dict[str, float]:
    """Of one step in C, less that of the call from Python, and in Python; the sides take turns."""
    rows = [row.seen for row in drawn_rows(setting, 200)]
    packed = [code.packed(each) for each in rows]
    at = [ctypes.c_void_p(each.ctypes.data) for each in packed]
    state = ctypes.create_string_buffer(code.init(setting.vehicle, setting.dt))
    steer = ctypes.byref(code.real())
    times: dict[str, list[float]] = {"call": [], "c": [], "python": []}
    size, step = code.function("size"), code.function("step")
    for _ in range(ROUNDS):
        python, begun = setting.start(), time.perf_counter()
        for _ in range(ROUNDS):
            for each in at:
                size(state, each, steer)
        times["call"].append((time.perf_counter() - begun) / ROUNDS)
        begun = time.perf_counter()
        for _ in range(ROUNDS):
            for each in at:
                step(state, each, steer)
        times["c"].append((time.perf_counter() - begun) / ROUNDS)
        begun = time.perf_counter()
        for seen in rows:
            _, python = setting.controller.step(python, seen)
        times["python"].append(time.perf_counter() - begun)
    found = {k: 1e6 * statistics.median(each) / len(rows) for k, each in times.items()}
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


def measured(word: str, count: int, builds: Sequence[str]) -> dict[str, Any]:
    """Everything of one controller."""
    found: dict[str, Any] = {}
    for single_ in (False, True):
        setting, name = setting_of(word, single_), "single" if single_ else "double"
        rows = drawn_rows(setting, count)
        known = answers(setting, rows)
        with tempfile.TemporaryDirectory() as scratch:
            folder = Path(scratch)
            write_controller(setting, folder)
            lines = (folder / f"{setting.prefix}.c").read_text().count("\n")
            figures: dict[str, Any] = {"lines": lines}
            for build in builds:
                code = compiled(setting, folder, build.split())
                figures[build] = parity(setting, code, rows, known)._asdict()
                if build == builds[0]:
                    figures["us"] = microseconds(code, setting)
                    if not single_:
                        figures[build]["drive"] = drive_difference(word, code)
            if single_:
                figures["cortex_m4"] = cortex_m4(setting, folder)
        found[name] = figures
    return found


def table(found: dict[str, dict[str, Any]]) -> str:
    """The figures as a table: sizes and instructions of float on the Cortex-M4F."""
    lines = [
        "| controller | lines | ROM [B] | RAM [B] | stack [B] | instructions a step | us here: C, "
        "Python | double from Python | drive | float from Python | statuses that differ |",
        "|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    for word, both in found.items():
        double, single_ = both["double"], both["single"]
        m4 = single_["cortex_m4"] or dict.fromkeys(("rom", "ram", "stack", "instructions"), "-")
        builds = {k: [v for n, v in both[k].items() if "-O" in n] for k in both}
        worst = {k: max(each["steering"] for each in v) for k, v in builds.items()}
        drives = max(each.get("drive", 0.0) for each in builds["double"])
        other = sum(each["other_statuses"] for v in builds.values() for each in v)
        us = f"{double['us']['c']:.1f}, {double['us']['python']:.0f}"
        sizes = [double["lines"], *(m4[k] for k in ("rom", "ram", "stack", "instructions"))]
        apart = [f"{x:.1e}" for x in (worst["double"], drives, worst["single"])]
        cells = [word, *sizes, us, *apart, other]
        lines.append(f"| {' | '.join(map(str, cells))} |")
    return "\n".join(lines) + "\n"


def main() -> None:
    """Measure, print, and write if asked."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("controllers", nargs="*", default=CONTROLLERS)
    parser.add_argument("--count", type=int, default=100_000)
    parser.add_argument("--out", type=Path)
    parser.add_argument("--builds", nargs="+", default=BUILDS, help="compilers with their level")
    arguments = parser.parse_args()
    builds = [each for each in arguments.builds if shutil.which(each.split()[0])]
    found = {}
    for word in arguments.controllers:
        found[word] = measured(word, arguments.count, builds)
        print(word, json.dumps(found[word]))  # noqa: T201 - its output
        if arguments.out is not None:  # what is measured is kept, whatever comes after it
            record = {"count": arguments.count, "controllers": found, **provenance()}
            write_text(arguments.out / "controllers.json", json.dumps(record, indent=1) + "\n")
            write_text(arguments.out / "table.md", table(found))


if __name__ == "__main__":
    main()
