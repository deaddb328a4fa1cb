"""What an exported controller costs on a Cortex-M4F, and its quadratic programs in a benchmark."""

from __future__ import annotations

import shutil
import subprocess
import tempfile
from pathlib import Path as FilePath
from typing import Any

from steersman.bench.suites import suite
from steersman.delivery.c_text import fill, identifier
from steersman.delivery.controller import Setting
from steersman.delivery.package import Tell
from steersman.delivery.vector_text import counted_steps
from steersman.errors import DataError, one_line
from steersman.files import write_text
from steersman.rollout import attempt

COMPILER, EMULATOR = "arm-none-eabi-gcc", "qemu-system-arm"
PROCESSOR = ("-mcpu=cortex-m4", "-mthumb", "-mfloat-abi=hard", "-mfpu=fpv4-sp-d16", "-O2")
FLAGS = (*PROCESSOR, "-std=c99", "-ffp-contract=off")
BOARD = (
    "-M", "mps2-an386", "-nographic", "-icount", "shift=0",
    "-semihosting-config", "enable=on,target=native",
)  # fmt: skip
# The dearest controller takes 15 million instructions a step, a minute for 200 of them [s].
_LONGEST = 600.0
# Drives in which quadratic programs are counted: so many of each kind of the suite.
SUITE, SAMPLE = "standard", 8


def missing() -> list[str]:
    """Programs that :func:`cortex_m4` needs and that are not on the path."""
    return [each for each in (COMPILER, EMULATOR) if shutil.which(each) is None]


def measured(setting: Setting, folder: FilePath, tell: Tell, *, solves: bool) -> dict[str, Any]:
    """What the card of a controller in ``folder`` has of :func:`cortex_m4` and of its programs.

    ``tell`` gets a sentence on each part. ``solves``: it solves quadratic programs.
    """
    found: dict[str, Any] = {}
    if absent := missing():
        tell(f"not measured on a Cortex-M4F: there is no {' and no '.join(absent)} here")
    else:
        costs = cortex_m4(setting, folder)
        tell(
            f"Cortex-M4F: ROM {costs['rom']} B, RAM {costs['ram']} B, stack {costs['stack']} B,"
            f" {costs['instructions']} instructions a step"
        )
        found["cortex_m4"] = {"compiled": " ".join((COMPILER, *FLAGS)), **costs}
    if solves:
        tell(f"driving the suite {SUITE}, sample={SAMPLE}, to count steps of quadratic programs")
        found["programs_in_benchmark"] = counts = programs_of(setting)
        tell(f"quadratic programs: at most {counts['largest']} steps in {counts['drives']} drives")
    return found


def cortex_m4(setting: Setting, folder: FilePath, *warnings: str) -> dict[str, int]:
    """On a Cortex-M4F under QEMU: sizes [bytes], instructions of a step, distance from Python.

    ROM is the size of the compiled controller without the functions of math.h, RAM that of its
    state. Instructions are the mean over 200 steps of a drive; ``steering_e9`` is 1e9 times the
    largest distance of the steering from Python's, ``other_statuses`` how many are not Python's.

    Args:
        setting: the controller.
        folder: where it was written to as C with its test vector.
        warnings: further flags of the compiler for the controller's file.

    Raises:
        DataError: a program that it needs fails; OSError: or is not there.
    """
    names = {"name": identifier(setting.name), "prefix": setting.prefix, "real": setting.handed}
    with tempfile.TemporaryDirectory() as scratch:

        def call(*words: str) -> str:
            done = subprocess.run(
                words, check=False, cwd=scratch, capture_output=True, text=True, timeout=_LONGEST
            )
            if done.returncode:
                raise DataError(f"{words[0]}: {one_line(done.stderr)[:160]}")
            return done.stdout + done.stderr  # QEMU writes what the program says to the latter

        write_text(FilePath(scratch, "main.c"), fill("cortex_m4.c.in", names))
        write_text(FilePath(scratch, "board.ld"), fill("cortex_m4.ld.in", {}))
        here, source = str(folder.resolve()), str(folder.resolve() / f"{setting.prefix}.c")
        call(COMPILER, *FLAGS, *warnings, "-c", source, "-o", "code.o")
        rom = int(call("arm-none-eabi-size", "code.o").splitlines()[1].split()[0])
        script = ("-nostartfiles", "-T", "board.ld", "-I", here)
        call(COMPILER, *PROCESSOR, *script, "main.c", "code.o", "-lm", "-o", "m4")
        said = call(EMULATOR, *BOARD, "-kernel", "m4")
    return {"rom": rom} | {k: int(v) for k, v in (line.split() for line in said.splitlines())}


def programs_of(setting: Setting, sample: int = SAMPLE) -> dict[str, int]:
    """The most steps that a quadratic program took in drives of the benchmark, beside the bound.

    Args:
        setting: a controller that solves some.
        sample: drives of each disturbance of the suite.
    """
    runs = [each.run for each in suite(SUITE, [f"sample={sample}"]).scenarios()]
    seen = {"count": setting.waypoints, "spacing": setting.spacing}
    with counted_steps() as steps:
        for one in runs:
            parts = {"controller": setting.controller, "sensor": one.sensor.model_copy(update=seen)}
            attempt(one.model_copy(update=parts))
    return {
        "drives": len(runs),
        "programs": len(steps),
        "largest": max(steps, default=0),
        "unsolved": steps.count(-1),
    }
